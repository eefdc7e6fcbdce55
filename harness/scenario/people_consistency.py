"""Checks on combinations of the keys of ``[pedestrians]``."""

import math

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Side
from harness.core.errors import InputError, unknown_name
from harness.scenario.people import TimedSection
from harness.scenario.scenario import Scenario, path_of
from harness.scenario.traffic import QUARTER_S

MAX_BEFORE_KERB_M = 8.0
"""Greatest distance from a timed pedestrian's start to their kerb; a footpath is 10 m long."""


def check_pedestrians(scenario: Scenario, where: str) -> None:
    """Refuse keys of ``[pedestrians]`` that do not fit together or to the rest of the scenario."""
    pedestrians = scenario.pedestrians
    check_quarters(pedestrians.flow_per_hour, scenario, f"{where}.flow_per_hour")
    _check_groups(scenario, f"{where}.group_size")
    total = math.fsum(kind.share for kind in pedestrians.walking_classes)
    if total > 1 + 1e-9:
        problem = f"the shares sum to {total:.10g}"
        raise InputError(f"{where}.walking_speed.classes", problem, "shares that sum to at most 1")
    if pedestrians.drawn and scenario.experiment.pairs > len(pedestrians.drawn):
        raise InputError(
            f"{where}.drawn",
            f"has the pedestrians of {len(pedestrians.drawn)} pairs",
            f"at least experiment.pairs = {scenario.experiment.pairs} entries",
        )
    names = [timed.name for timed in pedestrians.timed]
    case = pedestrians.timed_case
    if case is not None and case not in names:
        raise unknown_name(f"{where}.timed_case", "case", case, names)
    for number, timed in enumerate(pedestrians.timed):
        _check_timed(timed, scenario, f"{where}.timed.{number}")


def check_quarters(flow: float | tuple[float, ...], scenario: Scenario, where: str) -> None:
    """Refuse a list of flows that does not have a value for each quarter of an hour."""
    key, duration_s = "experiment.timeout_s", scenario.experiment.timeout_s
    if scenario.traffic is not None:
        key, duration_s = "traffic.duration_s", scenario.traffic.duration_s
    quarters = math.ceil(duration_s / QUARTER_S - 1e-9)
    if isinstance(flow, tuple) and len(flow) != quarters:
        allowed = f"{quarters}, one for each quarter of an hour of {key}"
        raise InputError(where, f"{len(flow)} values", allowed)


def _check_groups(scenario: Scenario, where: str) -> None:
    pedestrians = scenario.pedestrians
    total = math.fsum(pedestrians.group_size)
    if abs(total - 1) > 1e-9:
        raise InputError(where, f"the shares sum to {total:.10g}", "shares that sum to 1")
    if len(pedestrians.group_size) == 1:
        return
    if pedestrians.drawn:
        problem = "is not supported with pedestrians.drawn, whose pedestrians come one by one"
        raise InputError(where, problem, "none")


def _check_timed(timed: TimedSection, scenario: Scenario, where: str) -> None:
    """Refuse a pedestrian who would start beyond the footpath, in the car or before the trigger."""
    ego = scenario.ego
    to_kerb_m = scenario.crosswalk().to_lane_m(Side(timed.side))
    nearest, farthest = ego.width_m / 2 + PEDESTRIAN_RADIUS_M, to_kerb_m + MAX_BEFORE_KERB_M
    if not nearest < timed.start_lateral_m <= farthest:
        raise InputError(
            f"{where}.start_lateral_m",
            f"{timed.start_lateral_m:g} m is in the car's path or beyond the footpath",
            f"above {nearest:g} m and at most {farthest:g} m",
        )
    start_s = path_of(timed, scenario)[0].time_s
    if start_s < 0:
        # Each metre of trigger range adds 1/v0 of time.
        needed = ego.trigger_range_m - start_s * ego.initial_speed_mps
        raise InputError(
            f"{where}.speed_mps",
            f"they would have to start {-start_s:.3g} s before the trigger",
            f"ego.trigger_range_m of at least {needed:.4g} m, or a faster walk",
        )
