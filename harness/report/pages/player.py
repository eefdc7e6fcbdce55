"""The player's part of a page, of every kind of run."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from jinja2.utils import htmlsafe_json_dumps

from harness.report.pages.kinds import parts_of
from harness.report.pages.traces import Encoded
from harness.studies.runs.run_data import RunData
from harness.studies.runs.shown import ShownPair, choose_pairs
from harness.studies.runs.views import Key

MOST_BYTES = 3_000_000
"""Largest size of all episodes together; further episodes are left out."""


@dataclass(frozen=True)
class Player:
    """The player's part of a page.

    ``words`` describe what it plays.  ``groups`` lists the numbers of ``episodes`` under each
    heading.  Each episode names one of ``scenes``.
    """

    words: str
    scenes: Mapping[str, Encoded]
    episodes: Sequence[Encoded]
    groups: Mapping[str, Sequence[int]]

    @property
    def json(self) -> str:
        """Scenes and episodes as JSON that is safe inside a page."""
        return htmlsafe_json_dumps({"scenes": self.scenes, "episodes": self.episodes})


def run_player(run: RunData, shown: Sequence[ShownPair]) -> Player:
    """The player of a run's encounters, or of a stretch of an hour.

    Args:
        run: provides records and scenes.
        shown: the pairs with their traces, at least one.
    """
    parts = parts_of(run)
    episodes: list[Encoded] = []
    numbers: dict[Key, int] = {}
    size = 0
    for pair in shown:
        episode = parts.episode(run, pair)
        size += len(json.dumps(episode))
        if size > MOST_BYTES and episodes:
            break
        numbers[pair.cell, pair.pair] = len(episodes)
        episodes.append(episode)
    scenes = {str(cell): parts.scene(run, cell) for cell, _ in numbers}
    groups = {
        reason: [numbers[key] for key in keys if key in numbers]
        for reason, keys in choose_pairs(run).items()
    }
    groups = {reason: members for reason, members in groups.items() if members}
    words = " ".join([parts.player_words(run, shown, len(episodes)), *_words(shown, len(episodes))])
    return Player(words, scenes, episodes, groups)


def _words(shown: Sequence[ShownPair], episodes: int) -> Iterator[str]:
    """Where the traces come from, and how many pairs are left out."""
    if shown[0].repeated:
        yield "The run stored no traces, so these episodes were simulated again for the page."
        different = sum(bool(pair.differences) for pair in shown)
        yield (
            f"{different:,} of them differ from the stored record: see their notes."
            if different
            else "All records are identical to the stored ones."
        )
    if episodes < len(shown):
        yield f"{len(shown) - episodes:,} chosen pairs are left out to keep the page small."
