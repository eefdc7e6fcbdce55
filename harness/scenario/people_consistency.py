"""Checks on ``[pedestrians]`` and on obstacles against the rest of a scenario."""

import math
from collections.abc import Sequence

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Side
from harness.core.errors import InputError, unknown_name
from harness.scenario.scenario import Scenario, path_of
from harness.scenario.sections import ROUNDING_M
from harness.scenario.traffic import QUARTER_S

MAX_BEFORE_KERB_M = 8.0
"""Greatest distance from a timed pedestrian's start to their kerb; a footpath is 10 m long."""


def check_pedestrians(scenario: Scenario) -> None:
    """Refuse keys of ``[pedestrians]`` that do not fit together or to the rest of the scenario."""
    pedestrians = scenario.pedestrians
    check_quarters(pedestrians.flow_per_hour, scenario, "pedestrians.flow_per_hour")
    check_sum("pedestrians.group_size", pedestrians.group_size)
    if len(pedestrians.group_size) > 1 and pedestrians.drawn:
        problem = "is not supported with pedestrians.drawn, whose pedestrians come one by one"
        raise InputError("pedestrians.group_size", problem, "none")
    classes = [kind.share for kind in pedestrians.walking_classes]
    check_sum("pedestrians.walking_speed.classes", classes, at_most=True)
    if pedestrians.drawn and scenario.experiment.pairs > len(pedestrians.drawn):
        problem = f"has the pedestrians of {len(pedestrians.drawn)} pairs"
        allowed = f"at least experiment.pairs = {scenario.experiment.pairs} entries"
        raise InputError("pedestrians.drawn", problem, allowed)
    _check_case(pedestrians.timed_case, scenario, "pedestrians.timed_case")
    for number in range(len(pedestrians.timed)):
        _check_timed(number, scenario)


def check_sum(key: str, shares: Sequence[float], *, at_most: bool = False) -> None:
    """Refuse shares that do not sum to 1, or with ``at_most`` to more than 1."""
    total = math.fsum(shares)
    if total > 1 + 1e-9 or (total < 1 - 1e-9 and not at_most):
        allowed = f"shares that sum to {'at most ' * at_most}1"
        raise InputError(key, f"the shares sum to {total:.10g}", allowed)


def check_quarters(flow: float | tuple[float, ...], scenario: Scenario, key: str) -> None:
    """Refuse a list of flows that does not have a value for each quarter of an hour."""
    whole, duration_s = "experiment.timeout_s", scenario.experiment.timeout_s
    if scenario.traffic is not None:
        whole, duration_s = "traffic.duration_s", scenario.traffic.duration_s
    quarters = math.ceil(duration_s / QUARTER_S - 1e-9)
    if isinstance(flow, tuple) and len(flow) != quarters:
        allowed = f"{quarters}, one for each quarter of an hour of {whole}"
        raise InputError(key, f"{len(flow)} values", allowed)


def _check_case(case: str | None, scenario: Scenario, key: str) -> None:
    names = [timed.name for timed in scenario.pedestrians.timed]
    if case is not None and case not in names:
        raise unknown_name(key, "case", case, names)


def _check_timed(number: int, scenario: Scenario) -> None:
    """Refuse a pedestrian who would start beyond the footpath, in the car or before the trigger."""
    ego, timed, key = (
        scenario.ego,
        scenario.pedestrians.timed[number],
        f"pedestrians.timed.{number}",
    )
    to_kerb_m = scenario.crosswalk().to_lane_m(Side(timed.side))
    nearest, farthest = ego.width_m / 2 + PEDESTRIAN_RADIUS_M, to_kerb_m + MAX_BEFORE_KERB_M
    if not nearest < timed.start_lateral_m <= farthest:
        problem = f"{timed.start_lateral_m:g} m is in the car's path or beyond the footpath"
        allowed = f"above {nearest:g} m and at most {farthest:g} m"
        raise InputError(f"{key}.start_lateral_m", problem, allowed)
    start_s = path_of(timed, scenario)[0].time_s
    if start_s < 0:
        # Each metre of trigger range adds 1/v0 of time.
        needed = ego.trigger_range_m - start_s * ego.initial_speed_mps
        problem = f"they would have to start {-start_s:.3g} s before the trigger"
        allowed = f"ego.trigger_range_m of at least {needed:.4g} m, or a faster walk"
        raise InputError(f"{key}.speed_mps", problem, allowed)


def check_obstacles(scenario: Scenario) -> None:
    """Refuse an obstacle in the path of a vehicle or of pedestrians, or with an unknown case."""
    crossing = scenario.crosswalk()
    starts_m = {side: [0.0] for side in Side}
    for timed in scenario.pedestrians.timed:
        side = Side(timed.side)
        starts_m[side].append(timed.start_lateral_m - crossing.to_lane_m(side))
    walked = (
        -max(starts_m[Side.NEAR]) - PEDESTRIAN_RADIUS_M,
        crossing.length_m + max(starts_m[Side.FAR]) + PEDESTRIAN_RADIUS_M,
    )
    for number, obstacle in enumerate(scenario.crossing.obstacles):
        key = f"crossing.obstacles.{number}"
        _check_case(obstacle.case, scenario, f"{key}.case")
        for low, high in _driven(scenario):
            if _overlap(obstacle.y_bounds_m, (low, high)):
                whose = "the ego's" if scenario.traffic is None else "the vehicles'"
                allowed = f"y below {low:g} m or above {high:g} m"
                raise InputError(f"{key}.y_m", f"stands in {whose} path", allowed)
        beside = (-PEDESTRIAN_RADIUS_M, PEDESTRIAN_RADIUS_M)
        if _overlap(obstacle.x_bounds_m, beside) and _overlap(obstacle.y_bounds_m, walked):
            allowed = f"x below {beside[0]:g} m or above {beside[1]:g} m"
            raise InputError(f"{key}.x_m", "a pedestrian would touch it", allowed)


def _driven(scenario: Scenario) -> list[tuple[float, float]]:
    """The strips in which vehicles drive: the ego's, or with ``[traffic]`` those of all lanes."""
    crossing, traffic = scenario.crosswalk(), scenario.traffic
    half_m, centres_m = scenario.ego.width_m / 2, [crossing.lane_centre_m]
    if traffic is not None:
        half_m = max(vehicle.width_m for vehicle in scenario.vehicles()) / 2
        centres_m = [
            crossing.length_m - lane.lane_centre_m if oncoming else lane.lane_centre_m
            for oncoming in (False, True)
            if traffic.has_vehicles(oncoming=oncoming)
            for lane in scenario.crosswalk_from_lanes(oncoming=oncoming)
        ]
    return [(centre - half_m, centre + half_m) for centre in centres_m]


def _overlap(interval: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two intervals share more than an end point."""
    return interval[0] < other[1] - ROUNDING_M and other[0] < interval[1] - ROUNDING_M
