"""The parts of a page that differ between the kinds of run."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from harness.report.drawing.style import Picture
from harness.report.pages.traces import Encoded
from harness.report.screens.tables import Table
from harness.studies.runs.run_data import RunData
from harness.studies.runs.shown import ShownPair

Shown = Sequence[ShownPair]


@dataclass(frozen=True)
class PageParts:
    """The parts of a page that a kind of run has.

    Attributes:
        opening: what was simulated, in words.
        tables: the folded tables of a run of one cell, beside those of its findings.
        pictures: the figures, and remarks on those that are left out.
        player_words: what the player plays, from the pairs and how many of them fit on the page.
        scene: the crosswalk of a cell, in metres.
        episode: a pair for the player.
    """

    opening: Callable[[RunData], str]
    tables: Callable[[RunData], list[Table]]
    pictures: Callable[[RunData, Shown], tuple[Iterator[Picture], list[str]]]
    player_words: Callable[[RunData, Shown, int], str]
    scene: Callable[[RunData, int], Encoded]
    episode: Callable[[RunData, ShownPair], Encoded]
