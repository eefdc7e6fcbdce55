"""Judges the cells of a run under limits, from its tables."""

from collections.abc import Sequence

from harness.scenario import Cell
from harness.statistics import Finding, Judgement, Limits
from harness.statistics.limits import (
    JudgedLimit,
    Limit,
    all_judged,
    judged,
    numbers_of,
    one_sided,
    unless_failed,
)
from harness.studies.runs.run_data import RunData


def judged_limits(run: RunData, cell: Cell, limits: Sequence[Limit]) -> tuple[JudgedLimit, ...]:
    """Return each limit with its verdict on a cell; every bound holds alone.

    No limit is satisfied if the AV failed, or in hours and own simulations an arm; see
    ``unless_failed``.  With ``--until`` a bound holds for all looks together.
    """
    if not limits:
        return ()
    failures = "failed_av" if "failed_av" in numbers_of(run.kind.catalogue) else "failed"
    names = {limit.name for limit in limits} | {failures}
    rows, confidence = run.rows_of_cell(cell.number), one_sided(run.confidence)
    findings = run.kind.findings(rows, cell, confidence, names)
    return unless_failed(all_judged(limits, findings), findings[failures].count)


def judged_together(judgement: Judgement, limits: Limits) -> tuple[JudgedLimit, ...]:
    """Return μ0 and κ0 as limits with their verdicts, by bounds that hold for all cells together.

    Both are satisfied if the cell is allowed, and one is violated if it is denied.
    """
    swept, kappa = judgement.swept, judgement.swept.kappa
    return (
        judged(Limit("mu_all", limits.mu0, above=False), swept.mu_found),
        judged(
            Limit("kappa_all", limits.kappa0, above=False),
            Finding(kappa.value, kappa.low, kappa.high),
        ),
    )
