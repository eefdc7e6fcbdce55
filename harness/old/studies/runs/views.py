"""The view of each kind of run: its notes and the pairs worth watching."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import pandas as pd

from harness.core.encounter import Arm, Ending
from harness.old.statistics import Catalogue, Findings, Note
from harness.old.studies.runs.hour_notes import hour_notes
from harness.old.studies.runs.notes import encounter_notes
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.simulation_choice import Key, chosen_pairs, numbers_of
from harness.old.studies.runs.simulation_notes import simulation_notes
from harness.scenario import Scenario

ALL_BELOW = 50
"""If a run has at most this many pairs, all are shown."""

STRETCH_S = 180.0
"""Shown time of an hour, in s.  A whole hour would be too large for a page."""

TIME_ADVANTAGE = "smallest time advantage (calm yielding passes through 0 too)"

_EACH = 5
"""Number of episodes for each reason."""

_MOST_MEDIANS = 12
"""Number of cells with a median pair."""

_DANGEROUS = {
    "smallest PET": "pet_s",
    "smallest TTC": "min_ttc_s",
    "largest DRAC": "-max_drac_mps2",
}
"""Reasons by danger, with the AV's column; a minus before it selects the largest values."""


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


def _worth_watching(run: RunData) -> dict[str, list[Key]]:
    """Return the most dangerous pairs.

    Contacts come first, then the AV's smallest PET and TTC and its largest DRAC.  Cells share
    their pedestrians, so for a measure each pair counts once, in the cell with the most extreme
    value.  The last reason, ``other pairs``, completes a small run.
    """
    episodes = run.episodes[run.episodes["ending"] != Ending.ENGINE_FAILED]
    av, human = (episodes[episodes["arm"] == arm.value] for arm in (Arm.AV, Arm.HUMAN))
    tau = run.pairs.dropna(subset="tau").sort_values("tau", kind="stable")
    chosen = {
        "crash of the AV": _keys(av[av["ending"] == Ending.CRASHED]),
        "crash of the human": _keys(human[human["ending"] == Ending.CRASHED]),
        **{reason: _most_striking(av, column) for reason, column in _DANGEROUS.items()},
        "slowest AV": _most_striking(av, "-pass_time_s"),
        "timed out": _keys(episodes[episodes["ending"] == Ending.TIMED_OUT]),
        "fallback": _keys(av[av["fallback"]]),
        "lowest τ": _keys(tau)[:1],
        "median τ": _medians(tau),
        "highest τ": _keys(tau.iloc[::-1])[:1],
        TIME_ADVANTAGE: _most_striking(av, "min_time_advantage_s"),
    }
    everyone = _keys(run.pairs, most=None)
    if len(everyone) <= ALL_BELOW:
        shown = {key for keys in chosen.values() for key in keys}
        chosen["other pairs"] = [key for key in everyone if key not in shown]
    return {reason: keys for reason, keys in chosen.items() if keys}


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


def _most_striking(rows: pd.DataFrame, column: str) -> list[Key]:
    return _keys(_by_danger(rows, column).drop_duplicates("pair"))


def _keys(rows: pd.DataFrame, most: int | None = _EACH) -> list[Key]:
    pairs = zip(rows["cell"].tolist(), rows["pair"].tolist(), strict=True)
    return list(dict.fromkeys(pairs))[:most]


def _medians(tau: pd.DataFrame) -> list[Key]:
    """Return the pair with the median τ of each cell (the lower median if there are two)."""
    middles = [rows.iloc[[(len(rows) - 1) // 2]] for _, rows in tau.groupby("cell", sort=True)]
    return [key for middle in middles[:_MOST_MEDIANS] for key in _keys(middle)]


def _whole(_run: RunData, _cell: int, _pair: int) -> None:
    """The whole pair is shown."""


VIEWS: Mapping[str, View] = {
    "encounters": View(encounter_notes, _worth_watching, _whole, _whole),
    "hours of traffic": View(hour_notes, _longest_queue, _around_the_queue, _whole),
    "own simulations": View(simulation_notes, chosen_pairs, _whole, numbers_of),
}
"""The view of every kind of run, by the kind's name."""


def view_of(run: RunData) -> View:
    """Return the view of a run's kind."""
    return VIEWS[run.kind.name]
