"""The page's parts of every kind of run."""

from collections.abc import Mapping

from harness.old.report.pages.hour_parts import HOUR_PARTS
from harness.old.report.pages.parts import PageParts
from harness.old.report.pages.simulation_parts import SIMULATION_PARTS
from harness.old.studies.runs.run_data import RunData

PARTS: Mapping[str, PageParts] = {
    "hours of traffic": HOUR_PARTS,
    "own simulations": SIMULATION_PARTS,
}
"""The parts of the page, by the kind's name."""


def parts_of(run: RunData) -> PageParts:
    """Return the parts of a run's page."""
    return PARTS[run.kind.name]
