"""Episodes of a cell in; its summary out."""

from typing import Any

import numpy as np
import pyarrow as pa

from harness.core.encounter import Arm, Contact, Ending
from harness.core.errors import InputError
from harness.core.seeding import resampling
from harness.old.statistics import (
    CONFLICTS,
    BothArms,
    EncounterColumns,
    PairColumns,
    Summary,
    summarise,
)
from harness.scenario import Cell, ConflictsSection, Scenario
from harness.strategies.parameters import needs
from harness.strategies.registry import STRATEGIES


def columns_of_cell(episodes: pa.Table, cell: Cell, confidence: float) -> EncounterColumns:
    """The columns from which the numbers of a cell are computed, from its episodes by pair.

    The stream of the resampling depends only on the scenario's seed, so the same episodes give the
    same intervals.  With ``confidence`` 0 nothing is resampled.
    """
    scenario, pairs = cell.scenario, pair_columns(episodes)
    return EncounterColumns(
        pairs=pairs,
        timeout_s=scenario.experiment.timeout_s,
        free_pass_s=scenario.vehicle().free_pass_time_s(scenario.crosswalk()),
        rng=resampling(scenario.experiment.seed, "summary") if confidence else None,
        confidence=confidence,
        conflicts=conflict_marks(episodes, scenario.conflicts),
        repeated=repeated(pairs, scenario),
    )


def repeated(pairs: PairColumns, scenario: Scenario) -> tuple[bool, bool]:
    """Whether all episodes of the AV, and all of the reference, repeat the same one.

    They do if the people are fixed, the driver draws nothing at random, and no two episodes
    differ.  A pair that met nobody is no such repetition.
    """
    people = scenario.pedestrians
    if people.anyone_comes or people.drawn or not pairs.met_someone.any():
        return False, False
    errors, arms = scenario.perception.draws, scenario.arms
    av, human = (_draws(name) for name in (arms.av, arms.human))
    return (
        not (errors or av) and pairs.same(0),
        not ((errors and scenario.perception.human) or human) and pairs.same(1),
    )


def _draws(name: str) -> bool:
    """Whether a strategy may be given random numbers; nobody knows what your own draws."""
    return name not in STRATEGIES or "rng" in needs(STRATEGIES[name])


def summarise_cell(episodes: pa.Table, cell: Cell, confidence: float) -> Summary:
    """The summary of a cell, from its episodes by pair."""
    return summarise(columns_of_cell(episodes, cell, confidence))


def conflict_marks(episodes: pa.Table, thresholds: ConflictsSection) -> dict[str, BothArms]:
    """Masks of the episodes that had a conflict, by the name of the kind of conflict.

    An episode has a conflict if its measure lies beyond the threshold, or if it crashed.  If the
    measure is undefined and the episode did not crash, there was no conflict.

    Args:
        episodes: rows of one cell by pair, AV first.
        thresholds: the thresholds of its scenario.
    """
    crashed = np.array(episodes["ending"].to_pylist()) == Ending.CRASHED
    marks = {}
    for conflict in CONFLICTS:
        values = episodes[conflict.column].cast(pa.float64()).to_numpy()
        threshold: float = getattr(thresholds, conflict.threshold)
        # An undefined measure is NaN, which is neither above nor below.
        beyond = values > threshold if conflict.above else values < threshold
        marks[conflict.name] = ((beyond | crashed)[::2], (beyond | crashed)[1::2])
    return marks


def pair_columns(episodes: pa.Table) -> PairColumns:
    """The columns that a comparison needs, from the episodes of one cell.

    Args:
        episodes: rows in order of pairs, AV first.

    Raises:
        InputError: an arm is missing, or rows of two runs are mixed.
    """
    check_pairs(episodes, "episodes")
    arm = np.array(episodes["arm"].to_pylist())
    ending = np.array(episodes["ending"].to_pylist())
    front = np.array([contact == Contact.FRONT for contact in episodes["contact"].to_pylist()])
    crashed = ending == Ending.CRASHED
    failed_strategy = np.array([place == "strategy" for place in episodes["failed_in"].to_pylist()])

    def numbers(name: str) -> Any:
        return episodes[name].to_numpy().astype(float)

    def marks(name: str) -> Any:
        return crashed & np.array([value is True for value in episodes[name].to_pylist()])

    def both(values: Any) -> tuple[Any, Any]:
        return values[arm == Arm.AV], values[arm == Arm.HUMAN]

    arrivals = numbers("arrivals")
    return PairColumns(
        time_s=both(numbers("pass_time_s")),
        untouched_time_s=both(numbers("pass_time_ignoring_contact_s")),
        delay_s=both(numbers("delay_s")),
        stops=both(numbers("stops")),
        stopped_s=both(numbers("stopped_s")),
        crashed=both(crashed),
        front=both(crashed & front),
        avoidable=both(marks("avoidable")),
        avoidable_attentive=both(marks("avoidable_attentive")),
        timed_out=both(ending == Ending.TIMED_OUT),
        failed=both(ending == Ending.ENGINE_FAILED),
        failed_strategy=both(failed_strategy),
        met=both(numbers("pedestrians")),
        arrivals=both(arrivals),
        waited_s=both(np.where(arrivals > 0, numbers("pedestrian_delay_s") * arrivals, 0.0)),
        conditionings=both(numbers("conditionings")),
        clamped=both(numbers("clamped")),
        speed_excess_mps=both(numbers("clamped_speed_excess_mps")),
        range_excess_m=both(numbers("clamped_range_excess_m")),
        max_speed_mps=both(numbers("max_speed_mps")),
        steps=both(numbers("steps")),
        rms_acceleration_mps2=both(numbers("rms_acceleration_mps2")),
        rms_jerk_mps3=both(numbers("rms_jerk_mps3")),
        max_deceleration_mps2=both(numbers("max_deceleration_mps2")),
        max_jerk_mps3=both(numbers("max_jerk_mps3")),
        av_fallback=both(numbers("fallback") > 0)[0],
    )


def check_pairs(rows: pa.Table, what: str) -> None:
    """Refuse rows of a cell unless each pair has two of them, the AV's first.

    Raises:
        InputError: an arm is missing, or rows of two runs are mixed.
    """
    arms, pairs = rows["arm"].to_pylist(), rows["pair"].to_pylist()
    count = len(arms) // 2
    whole = count > 0 and arms == [Arm.AV.value, Arm.HUMAN.value] * count
    if not whole or pairs[::2] != pairs[1::2] or len({*pairs}) != count:
        raise InputError(what, "do not have both arms of each pair of a cell", f"one run's {what}")


def known(value: float | None) -> float | None:
    """The number, or None if it is missing."""
    return None if value is None or np.isnan(value) else float(value)
