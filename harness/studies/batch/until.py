"""``--until``: runs pairs until every interval is narrow enough, and corrects for the looks.

An interval with too few informative pairs is unreliable and does not stop a cell.
"""

from collections.abc import Callable

import pyarrow as pa

from harness.scenario import Cell, Precision
from harness.store.summaries import confidence_of, looks, summarise_cell
from harness.studies.batch.plan import Plan


def reach_precision(
    plan: Plan,
    until: Precision,
    reach: Callable[[dict[int, int]], None],
    episodes_of: Callable[[int], pa.Table],
) -> None:
    """Continue until the interval of every cell is narrow enough, or all its pairs are done.

    Args:
        plan: plan of the run.
        until: the required half-width.
        reach: runs cells up to given numbers of pairs, by cell number.
        episodes_of: returns the rows of ``episodes`` that a cell has so far.
    """
    planned = plan.planned
    confidence = confidence_of(plan.study, plan.options)
    goals = dict.fromkeys(planned, 0)
    open_cells = list(plan.study.cells)
    for look in looks(max(planned.values())):
        for cell in open_cells:
            goals[cell.number] = min(look, planned[cell.number])
        reach(goals)
        open_cells = [
            cell
            for cell in open_cells
            if goals[cell.number] < planned[cell.number]
            and not _narrow(episodes_of(cell.number), cell, until, confidence)
        ]
        if not open_cells:
            return


def _narrow(episodes: pa.Table, cell: Cell, until: Precision, confidence: float) -> bool:
    finding = summarise_cell(episodes, cell, confidence).findings[until.measure]
    if not finding.reliable or finding.half_width is None:
        return False
    return finding.half_width <= until.half_width
