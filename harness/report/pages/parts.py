"""The parts of a page that differ between the kinds of run."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol

from harness.report.drawing.style import Picture
from harness.report.pages.encounter_parts import EncounterParts
from harness.report.pages.hour_parts import HourParts
from harness.report.pages.traces import Encoded
from harness.report.screens.tables import Table
from harness.studies.runs.run_data import RunData
from harness.studies.runs.shown import ShownPair


class PageParts(Protocol):
    """The parts of a page that a kind of run has."""

    def opening(self, run: RunData) -> str:
        """What was simulated, in words."""
        ...

    def tables(self, run: RunData) -> list[Table]:
        """The folded tables of a run of one cell, beside those of its findings."""
        ...

    def pictures(
        self, run: RunData, shown: Sequence[ShownPair]
    ) -> tuple[Iterator[Picture], list[str]]:
        """The figures, and remarks on those that are left out."""
        ...

    def player_words(self, run: RunData, shown: Sequence[ShownPair], episodes: int) -> str:
        """What the player plays; ``episodes`` of the shown pairs fit on the page."""
        ...

    def scene(self, run: RunData, cell: int) -> Encoded:
        """The crosswalk of a cell, in metres."""
        ...

    def episode(self, run: RunData, pair: ShownPair) -> Encoded:
        """A pair for the player."""
        ...


PARTS: Mapping[str, PageParts] = {
    "encounters": EncounterParts(),
    "hours of traffic": HourParts(),
}
"""The parts of every kind of run, by the kind's name."""


def parts_of(run: RunData) -> PageParts:
    """The parts of a run's page."""
    return PARTS[run.kind.name]
