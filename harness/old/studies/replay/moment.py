"""Chooses the time span of a user's own simulation that sumo-gui shows."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import pandas as pd

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.old.store.tables import Row
from harness.old.studies.runs.simulation_choice import most_striking
from harness.old.studies.runs.stored import StoredCell
from harness.scenario import Scenario
from harness.scenario.own_simulation import setting_of

if TYPE_CHECKING:
    from harness.engine.traci import Moment

_MARGIN_S = 3.0
"""Time in s that is shown before and after a passage."""

_LONGEST_S = 60.0
"""Time in s that is shown of a passage that did not end."""


def moments_of(
    stored: StoredCell,
    pair: int,
    arms: Sequence[Arm],
    vehicle: str | None = None,
    crosswalk: str | None = None,
) -> "dict[Arm, Moment]":
    """Return the shown time span of each arm; empty if the run is not a user's own simulation.

    The first arm shows its most striking passage.  The other arm shows the same vehicle's passage
    over the same crosswalk.  If it has no such passage, it shows the same time.

    Args:
        stored: the cell.
        pair: index of the pair.
        arms: the arms.
        vehicle, crosswalk: ids to which the choice is restricted.

    Raises:
        InputError: there is no such passage, or the run is of another kind.
    """
    scenario = stored.cell.scenario
    if scenario.simulation is None:
        for option, value in (("--vehicle", vehicle), ("--crosswalk", crosswalk)):
            if value is not None:
                raise InputError(f"{option} {value}", "is not supported", "a run of [simulation]")
        return {}
    frames = {arm: pd.DataFrame(stored.rows_of(pair, arm)["passages_over"]) for arm in arms}
    first = arms[0]
    chosen = _passage(frames[first], vehicle, crosswalk)
    if chosen is None:
        if vehicle is None and crosswalk is None:
            raise InputError("--gui", "nobody passed a chosen crosswalk", "another pair or --arm")
        option, value = (
            ("--vehicle", vehicle) if vehicle is not None else ("--crosswalk", crosswalk)
        )
        problem = f"no such passage in the arm {first.value} of pair {pair}"
        raise InputError(f"{option} {value}", problem, "a passage that `harness worst` lists")
    moments = {}
    for arm in arms:
        same = chosen
        if arm is not first:
            other = _passage(frames[arm], chosen["vehicle"], chosen["crosswalk"])
            same = chosen if other is None else other
        moments[arm] = _moment(scenario, same)
    return moments


def _passage(rows: pd.DataFrame, vehicle: str | None, crosswalk: str | None) -> Row | None:
    return most_striking(rows, vehicle, crosswalk) if len(rows) else None


def _moment(scenario: Scenario, row: Row) -> "Moment":
    from harness.engine.traci import Moment

    crosswalk = next(
        each for each in setting_of(scenario).crosswalks if each.id == row["crosswalk"]
    )
    way = crosswalk.ways[0]
    x_m, y_m = way.frame.to_network(0.0, way.crossing.length_m / 2)
    return Moment(row["trigger_s"] - _MARGIN_S, _end_s(row) + _MARGIN_S, x_m, y_m)


def _end_s(row: Row) -> float:
    """The time at which a passage ends: at its contact, or when the rear has left the crosswalk."""
    begin_s: float = row["trigger_s"]
    if not pd.isna(row["contact_time_s"]):
        return begin_s + float(row["contact_time_s"])
    return begin_s + _LONGEST_S if pd.isna(row["passed_s"]) else float(row["passed_s"])
