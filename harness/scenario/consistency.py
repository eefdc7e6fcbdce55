"""What no key of a scenario can tell alone: whether all of them fit together."""

from harness.encounter import PEDESTRIAN_RADIUS_M, Side
from harness.errors import InputError, unknown_name
from harness.scenario.sections import Scenario, TimedSection, path_of

MAX_BEFORE_KERB_M = 8.0
"""How far before his kerb a timed pedestrian may start: a footpath is 10 m long."""


def check_consistency(scenario: Scenario, source: str) -> None:
    """Refuse a scenario whose keys do not fit together.

    Args:
        scenario: every key accepted by itself.
        source: what to call the file in messages.

    Raises:
        InputError: naming the key to change.
    """
    ego, crossing, experiment = scenario.ego, scenario.crossing, scenario.experiment
    if ego.width_m > crossing.length_m / 2:
        raise InputError(
            f"{source}: ego.width_m",
            f"{ego.width_m:g} m does not fit the lane",
            f"at most crossing.length_m / 2 = {crossing.length_m / 2:g} m",
        )
    # SUMO's approach lane ends 1.5 m before the crosswalk: the ego cannot be inserted beyond it.
    nearest = crossing.width_m / 2 + 1.5
    if ego.trigger_range_m < nearest:
        raise InputError(
            f"{source}: ego.trigger_range_m",
            f"{ego.trigger_range_m:g} m is on the crosswalk or too near",
            f"at least crossing.width_m / 2 + 1.5 = {nearest:g} m",
        )
    _check_pedestrians(scenario, f"{source}: pedestrians")
    milliseconds = experiment.step_s * 1000
    if abs(milliseconds - round(milliseconds)) > 1e-9:
        raise InputError(
            f"{source}: experiment.step_s",
            f"{experiment.step_s!r} s",
            "whole milliseconds, SUMO's resolution",
        )
    steps = experiment.timeout_s / experiment.step_s
    if steps < 1 - 1e-9 or abs(steps - round(steps)) > 1e-6:
        raise InputError(
            f"{source}: experiment.timeout_s",
            f"{experiment.timeout_s:g} s",
            f"whole steps of experiment.step_s = {experiment.step_s:g} s",
        )


def _check_pedestrians(scenario: Scenario, where: str) -> None:
    pedestrians = scenario.pedestrians
    if pedestrians.pairing == "speed" and pedestrians.behaviour in ("reactive", "sumo"):
        raise InputError(
            f"{where}.pairing",
            f"'speed' with behaviour {pedestrians.behaviour!r}, who has no one speed",
            "quantile",
        )
    names = [timed.name for timed in pedestrians.timed]
    case = pedestrians.timed_case
    if case is not None and case not in names:
        raise unknown_name(f"{where}.timed_case", "case", case, names)
    for number, timed in enumerate(pedestrians.timed):
        _check_timed(timed, scenario, f"{where}.timed.{number}")


def _check_timed(timed: TimedSection, scenario: Scenario, where: str) -> None:
    """He starts on his footpath or on the road, clear of the car, and not before the trigger."""
    ego = scenario.ego
    to_kerb_m = scenario.crosswalk().to_lane_m(Side(timed.side))
    nearest, farthest = ego.width_m / 2 + PEDESTRIAN_RADIUS_M, to_kerb_m + MAX_BEFORE_KERB_M
    if not nearest < timed.start_lateral_m <= farthest:
        raise InputError(
            f"{where}.start_lateral_m",
            f"{timed.start_lateral_m:g} m",
            f"above {nearest:g} m, where the car would touch him, up to {farthest:g} m",
        )
    start_s = path_of(timed, scenario)[0].time_s
    if start_s < 0:
        # Each metre of trigger range is 1/v0 of time.
        needed = ego.trigger_range_m - start_s * ego.initial_speed_mps
        raise InputError(
            f"{where}.speed_mps",
            f"he would have to start {-start_s:.3g} s before the trigger",
            f"ego.trigger_range_m of at least {needed:.4g} m, or a faster walk",
        )
