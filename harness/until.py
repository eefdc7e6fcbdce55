"""``--until``: look again and again until every interval is narrow enough, and pay for it."""

from collections.abc import Callable

import pyarrow as pa

from harness.comparison import CONFIDENCE, Interval
from harness.manifest import Batch
from harness.options import Options, Precision
from harness.study import Cell, Study
from harness.summaries import summarise_cell

FIRST_LOOK = 1_000
"""Pairs at the first look of ``--until``; each further look is at twice as many."""


def looks(pairs: int) -> list[int]:
    """Numbers of pairs at which ``--until`` looks: 1,000, 2,000, 4,000 … and at last ``pairs``."""
    numbers = []
    look = FIRST_LOOK
    while look < pairs:
        numbers.append(look)
        look *= 2
    return [*numbers, pairs]


def confidence_of(study: Study, options: Options) -> float:
    """Confidence of each interval.

    Looking L times and stopping at the best moment would spoil a 95 % interval, so with
    ``--until`` each look uses 1 − 0.05/L (Bonferroni): all of them together hold with 95 %.
    """
    if options.until is None:
        return CONFIDENCE
    most = max(cell.scenario.experiment.pairs for cell in study.cells)
    return 1 - (1 - CONFIDENCE) / len(looks(most))


def reach_precision(
    batch: Batch,
    until: Precision,
    reach: Callable[[dict[int, int]], None],
    episodes_of: Callable[[int], pa.Table],
) -> None:
    """Go on until every cell's interval is narrow enough, or all its pairs are done.

    Args:
        batch: what is run.
        until: what is narrow enough.
        reach: brings cells to a number of pairs, both by the cell's number.
        episodes_of: the ``episodes`` of a cell so far.
    """
    planned = batch.planned
    confidence = confidence_of(batch.study, batch.options)
    goals = dict.fromkeys(planned, 0)
    open_cells = list(batch.study.cells)
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
    interval: Interval = getattr(summarise_cell(episodes, cell, confidence), until.measure)
    if interval.low is None or interval.high is None:
        return False
    return (interval.high - interval.low) / 2 <= until.half_width
