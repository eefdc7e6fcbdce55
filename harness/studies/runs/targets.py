"""Finds the cells of a run in which ``--until`` missed its target."""

from dataclasses import dataclass

from harness.store.manifest import options_of
from harness.studies.runs.run_data import RunData


@dataclass(frozen=True)
class MissedTarget:
    """A cell whose interval is wider than the target of ``--until`` after all its pairs.

    ``half_width`` is None if there is no interval.
    """

    cell: int
    measure: str
    target: float
    half_width: float | None
    pairs: int


def missed_targets(run: RunData) -> list[MissedTarget]:
    """Return the cells of a run in which ``--until`` did not reach its target."""
    until = options_of(run.manifest).until
    if until is None:
        return []
    missed = []
    for result in run.results:
        half_width = result.summary.findings[until.measure].half_width
        if half_width is None or half_width > until.half_width:
            number, pairs = result.cell.number, result.summary.pairs
            missed.append(MissedTarget(number, until.measure, until.half_width, half_width, pairs))
    return missed
