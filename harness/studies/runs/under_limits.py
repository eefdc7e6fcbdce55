"""Judges the cells of a run under limits, from its tables."""

from collections.abc import Sequence

from harness.scenario import Cell
from harness.statistics import Finding, Judgement, Limits
from harness.statistics.limits import JudgedLimit, Limit, all_judged, judged, one_sided
from harness.studies.runs.run_data import RunData


def judged_limits(run: RunData, cell: Cell, limits: Sequence[Limit]) -> tuple[JudgedLimit, ...]:
    """Return each limit with its verdict on a cell; every bound holds alone.

    With ``--until`` a bound holds for all looks together.
    """
    if not limits:
        return ()
    names = {limit.name for limit in limits}
    rows, confidence = run.rows_of_cell(cell.number), one_sided(run.confidence)
    return all_judged(limits, run.kind.findings(rows, cell, confidence, names))


def judged_together(judgement: Judgement, limits: Limits) -> tuple[JudgedLimit, ...]:
    """Return μ0 and κ0 as limits with their verdicts, by bounds that hold for all cells together.

    Both are satisfied if the cell is allowed, and one is violated if it is denied.
    """
    pairs = (
        (Limit("mu_all", limits.mu0, above=False), judgement.swept.mu),
        (Limit("kappa_all", limits.kappa0, above=False), judgement.swept.kappa),
    )
    return tuple(judged(limit, Finding(of.value, of.low, of.high)) for limit, of in pairs)
