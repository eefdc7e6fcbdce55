"""The view of each kind of run: its notes and the pairs worth watching."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import pandas as pd

from harness.core.encounter import Arm
from harness.old.statistics import Catalogue, Findings, Note
from harness.old.studies.runs.hour_notes import hour_notes
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.simulation_choice import Key, chosen_pairs, numbers_of
from harness.old.studies.runs.simulation_notes import simulation_notes
from harness.scenario import Scenario

STRETCH_S = 180.0
"""Shown time of an hour, in s.  A whole hour would be too large for a page."""

_EACH = 5
"""Number of episodes for each reason."""


@dataclass(frozen=True)
class View:
    """The view of a kind of run.

    Attributes:
        notes: returns the notes of a cell, sorted by rank.
        chosen: returns the pairs (cell, pair) worth watching by reason, the most dangerous first.
            Reasons without a pair are omitted.
        stretch: returns begin and end, in s, of the shown part of a pair; None: the whole pair.
        passages: returns arm and number of each shown passage of a pair; None: the whole pair.
    """

    notes: Callable[[Scenario, Findings, Catalogue], tuple[Note, ...]]
    chosen: Callable[[RunData], dict[str, list[Key]]]
    stretch: Callable[[RunData, int, int], tuple[float, float] | None]
    passages: Callable[[RunData, int, int], set[tuple[str, int]] | None]


def _longest_queue(run: RunData) -> dict[str, list[Key]]:
    """Return the hour with the AV's longest queue."""
    ran = run.hours[run.hours["reason"].isna()]
    both = ran.groupby(["cell", "pair"])["arm"].transform("size") == len(Arm)
    queues = ran[both & (ran["arm"] == Arm.AV.value)]
    longest = _keys(_by_danger(queues, "-queue_longest"), most=1)
    return {"longest queue of the AV's arm": longest} if longest else {}


def _around_the_queue(run: RunData, cell: int, pair: int) -> tuple[float, float]:
    """Return the three minutes around the AV's longest queue."""
    duration_s = run.scenario_of(cell).known_traffic.duration_s
    queues = run.queues
    queues = queues[(queues["cell"] == cell) & (queues["pair"] == pair) & (queues["arm"] == Arm.AV)]
    worst = queues.sort_values(["longest", "minute"], ascending=[False, True]).iloc[0]
    middle_s = 60.0 * float(worst["minute"]) + 30.0
    begin_s = min(max(0.0, middle_s - STRETCH_S / 2), max(0.0, duration_s - STRETCH_S))
    return begin_s, min(begin_s + STRETCH_S, duration_s)


def _by_danger(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """Sort rows by a column, smallest first, or largest first if its name begins with a minus."""
    name = column.removeprefix("-")
    return rows.dropna(subset=name).sort_values(name, ascending=name == column, kind="stable")


def _keys(rows: pd.DataFrame, most: int | None = _EACH) -> list[Key]:
    pairs = zip(rows["cell"].tolist(), rows["pair"].tolist(), strict=True)
    return list(dict.fromkeys(pairs))[:most]


def _whole(_run: RunData, _cell: int, _pair: int) -> None:
    """The whole pair is shown."""


VIEWS: Mapping[str, View] = {
    "hours of traffic": View(hour_notes, _longest_queue, _around_the_queue, _whole),
    "own simulations": View(simulation_notes, chosen_pairs, _whole, numbers_of),
}
"""The view of every kind of run, by the kind's name."""


def view_of(run: RunData) -> View:
    """Return the view of a run's kind."""
    return VIEWS[run.kind.name]
