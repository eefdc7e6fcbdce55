"""The player's part of the page for every kind of run."""

import json
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from jinja2.utils import htmlsafe_json_dumps

from harness.old.report.pages.kinds import parts_of
from harness.old.report.pages.traces import Encoded
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import ShownPair

MOST_BYTES = 3_000_000
"""Maximum total size of the episodes; further episodes are left out."""


@dataclass(frozen=True)
class Player:
    """The player's part of a page.

    ``words`` describe its content.  ``groups`` lists the indices of ``episodes`` under each
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
    """Return the player of a run's encounters, or of a part of an hour.

    Args:
        run: the run with records and scenes.
        shown: the pairs with their traces, at least one.
    """
    parts = parts_of(run)
    episodes: list[Encoded] = []
    scenes: dict[str, Encoded] = {}
    numbers: dict[Hashable, int] = {}
    size = left = 0
    for each in parts.episodes(run, shown):
        size += len(json.dumps(each.document))
        if size > MOST_BYTES and episodes:
            left += 1
            continue
        numbers[each.key] = len(episodes)
        scenes[each.scene_name] = each.scene
        episodes.append(each.document)
    groups = {
        reason: [numbers[key] for key in keys if key in numbers]
        for reason, keys in parts.groups(run).items()
    }
    groups = {reason: members for reason, members in groups.items() if members}
    about = parts.player_words(run, shown, len(episodes))
    words = " ".join([about, *_words(shown, left, parts.shown_noun)])
    return Player(words, scenes, episodes, groups)


def _words(shown: Sequence[ShownPair], left: int, noun: str) -> Iterator[str]:
    """Yield sentences about the traces' origin and the number of episodes that are left out."""
    if shown[0].repeated:
        yield "The run stored no traces, so these episodes were simulated again for the page."
        different = sum(bool(pair.differences) for pair in shown)
        yield (
            f"{different:,} of them differ from the stored record: see their notes."
            if different
            else "All records are identical to the stored ones."
        )
    if left:
        yield f"{left:,} chosen {noun} are left out to keep the page small."
