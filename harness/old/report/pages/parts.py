"""The parts of a page that differ between the kinds of run."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from harness.old.report.drawing.style import Picture
from harness.old.report.pages.traces import Encoded
from harness.old.report.screens.tables import Table
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import ShownPair, choose_pairs

Shown = Sequence[ShownPair]


@dataclass(frozen=True)
class ShownEpisode:
    """An episode for the player, with its ``key`` in ``PageParts.groups`` and its scene's name."""

    key: Hashable
    scene_name: str
    scene: Encoded
    document: Encoded


@dataclass(frozen=True)
class PageParts:
    """The parts of a page that a kind of run has.

    Attributes:
        opening: returns a description of the simulation.
        tables: returns the folded tables other than the tables of the findings.
        pictures: returns the figures, and remarks on missing figures.
        player_words: returns a description of the player's content, from the pairs and the number
            of episodes that fit on the page.
        episodes: returns the player's episodes, the most important first.
        groups: returns the keys of episodes by the reason why they are shown.
        shown_noun: the noun for an episode's content.
    """

    opening: Callable[[RunData], str]
    tables: Callable[[RunData], list[Table]]
    pictures: Callable[[RunData, Shown], tuple[Iterator[Picture], list[str]]]
    player_words: Callable[[RunData, Shown, int], str]
    episodes: Callable[[RunData, Shown], Iterator[ShownEpisode]]
    groups: Callable[[RunData], Mapping[str, Sequence[Hashable]]] = choose_pairs
    shown_noun: str = "pairs"


def pair_by_pair(
    scene: Callable[[RunData, int], Encoded], episode: Callable[[RunData, ShownPair], Encoded]
) -> Callable[[RunData, Shown], Iterator[ShownEpisode]]:
    """Return ``PageParts.episodes`` for runs in which every episode is a pair.

    Args:
        scene: returns the crosswalk of a cell, in metres.
        episode: returns the player's document of a pair.
    """

    def episodes(run: RunData, shown: Shown) -> Iterator[ShownEpisode]:
        scenes: dict[int, Encoded] = {}
        for pair in shown:
            if pair.cell not in scenes:
                scenes[pair.cell] = scene(run, pair.cell)
            key = (pair.cell, pair.pair)
            yield ShownEpisode(key, str(pair.cell), scenes[pair.cell], episode(run, pair))

    return episodes
