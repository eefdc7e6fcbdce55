"""A scenario in; the refusal of keys that contradict each other, or have no effect, out.

Every function raises ``InputError`` at the dotted key to change; ``located`` says which file or
option gave it.
"""

import math
from collections.abc import Iterable, Sequence

from harness.core.errors import InputError, unknown_name
from harness.core.seeding import SUMO_SEEDS_APART
from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, ROUNDING, SECONDS_PER_HOUR, Arm, Side
from harness.scenario.scenario import Scenario, path_of
from harness.scenario.sections import BEFORE_CROSSWALK_M, MAX_BEFORE_KERB_M, SUMO_DRIVER, effects
from harness.scenario.traffic import TrafficSection

PROGRAM = "exec:"
"""How the name of a strategy in another process begins."""


_STEP_ROUNDING = 1e-6
"""A time is a whole number of steps up to this part of a step."""


def check_consistency(scenario: Scenario) -> None:
    """Refuse a scenario whose keys do not fit together, although each single key was accepted."""
    ego, crossing, step_s = scenario.ego, scenario.crossing, scenario.experiment.step_s
    _check_drivers(scenario)
    if scenario.kind == "simulations" and scenario.experiment.pairs > SUMO_SEEDS_APART:
        pairs = f"{scenario.experiment.pairs:,}"
        problem = f"SUMO's seeds of {pairs} pairs are also those of the next experiment.seed"
        raise InputError("experiment.pairs", problem, f"at most {SUMO_SEEDS_APART:,}")
    _check_pedestrians(scenario)
    if scenario.simulation is not None:
        _check_simulation(scenario)
        return
    if (crossing.latitude_deg is None) is not (crossing.longitude_deg is None):
        missing = "latitude_deg" if crossing.latitude_deg is None else "longitude_deg"
        raise InputError(f"crossing.{missing}", "is not given", "both or neither")
    _check_lanes(scenario)
    nearest = crossing.width_m / 2 + BEFORE_CROSSWALK_M
    if ego.trigger_range_m < nearest:
        problem = f"{ego.trigger_range_m:g} m is on or too close to the crosswalk"
        allowed = f"at least crossing.width_m / 2 + {BEFORE_CROSSWALK_M:g} = {nearest:g} m"
        raise InputError("ego.trigger_range_m", problem, allowed)
    check_perception(scenario)
    _check_grade(scenario)
    if scenario.traffic is not None:
        _check_traffic(scenario, scenario.traffic)
        return
    check_steps("experiment.timeout_s", scenario.experiment.timeout_s, step_s, 1)
    _check_obstacles(scenario)
    # Every episode would time out, and the worst case of μ would be below its value.
    free_pass_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    if scenario.experiment.timeout_s < free_pass_s - ROUNDING:
        problem = f"{scenario.experiment.timeout_s:g} s is shorter than a free pass"
        allowed = f"at least {free_pass_s:.4g} s, the time to pass at ego.initial_speed_mps"
        raise InputError("experiment.timeout_s", problem, allowed)


def check_effects(scenarios: Iterable[Scenario]) -> None:
    """Refuse a key that has no effect in any of the scenarios in which it is set.

    A key is set if its value is not its default.

    Raises:
        InputError: at the first such key.
    """
    found = dict[str, InputError | None]()
    for scenario in scenarios:
        for key, refusal in effects(scenario, scenario):
            found[key] = refusal and found.get(key, refusal)
    for refusal in filter(None, found.values()):
        raise refusal


def check_steps(key: str, time_s: float, step_s: float, fewest: int = 0) -> None:
    """Refuse a time that is not a whole number of steps or is shorter than ``fewest`` steps.

    Raises:
        InputError: at ``key``.
    """
    steps = time_s / step_s
    if steps < fewest - ROUNDING or abs(steps - round(steps)) > _STEP_ROUNDING:
        allowed = f"whole steps of experiment.step_s = {step_s:g} s"
        raise InputError(key, f"{time_s:g} s is not accepted", allowed)


def check_perception(scenario: Scenario) -> None:
    """Refuse times of perception that are not whole steps."""
    for key, fewest in (("latency_s", 0), ("update_s", 1)):
        if (time_s := getattr(scenario.perception, key)) is not None:
            check_steps(f"perception.{key}", time_s, scenario.experiment.step_s, fewest)


def _check_lanes(scenario: Scenario) -> None:
    ego, crossing = scenario.ego, scenario.crossing
    count, width = crossing.lanes + crossing.oncoming_lanes, crossing.width_of_lane_m
    if count * width > crossing.length_m + ROUNDING:
        problem = f"{count} lanes of {width:g} m are wider than the road"
        allowed = f"at most crossing.length_m / {count} = {crossing.length_m / count:g} m"
        raise InputError("crossing.lane_width_m", problem, allowed)
    if ego.lane >= crossing.lanes:
        problem = f"there is no lane {ego.lane}; lanes are counted from 0 at the near kerb"
        raise InputError("ego.lane", problem, f"below crossing.lanes = {crossing.lanes}")
    _check_fits(scenario, ego.lane)


def _check_fits(scenario: Scenario, lane: int) -> None:
    """Refuse a vehicle that is too wide for its lane, or for pedestrians who wait next to it."""
    crosswalk = scenario.crosswalk(lane)
    beside_m = min(map(crosswalk.to_lane_m, Side)) - PEDESTRIAN_RADIUS_M
    most_m = max(0.0, min(crosswalk.lane_width_m, 2 * beside_m))
    width_m = scenario.ego.width_m
    if width_m > most_m + ROUNDING:
        allowed = f"at most {most_m:.4g} m: its lane, and {PEDESTRIAN_RADIUS_M:g} m to a kerb"
        raise InputError("ego.width_m", f"{width_m:g} m is too wide", allowed)


def _check_grade(scenario: Scenario) -> None:
    """Refuse roads on which a vehicle cannot brake or drive."""
    both_ways = (False,) if scenario.traffic is None else (False, True)
    for vehicle in (scenario.vehicle(oncoming=way) for way in both_ways):
        limits = {"brake": vehicle.max_deceleration_mps2, "drive on": vehicle.max_acceleration_mps2}
        for what, limit in limits.items():
            if limit <= 0:
                grade = scenario.crossing.grade
                problem = f"with {grade:g} a vehicle could not {what}: {limit:.3g} m/s²"
                allowed = "a flatter road, or more crossing.friction"
                raise InputError("crossing.grade", problem, allowed)


def _check_drivers(scenario: Scenario) -> None:
    """Refuse SUMO's own driver, and a program, where they cannot drive."""
    for arm in Arm:
        driver = scenario.arms.driver(arm)
        if driver.startswith(PROGRAM) and scenario.kind == "simulations":
            problem = f"{driver!r}: a program drives one vehicle, not those of a simulation"
            raise InputError(f"arms.{arm}", problem, "a strategy in Python")
        if driver != SUMO_DRIVER:
            continue
        if scenario.simulation is None:
            problem = f"{SUMO_DRIVER} drives only with [simulation]"
        elif scenario.pedestrians.anyone_comes:
            problem = f"{SUMO_DRIVER} passes people of the harness (pedestrians.flow_per_hour)"
        elif scenario.actuation.applies_to(arm):
            problem = f"{SUMO_DRIVER} does not obey late: [actuation] cannot apply to it"
        else:
            continue
        raise InputError(f"arms.{arm}", problem, "another strategy, such as human_yield")


def _check_traffic(scenario: Scenario, traffic: TrafficSection) -> None:
    """Refuse flows above capacity and times that are not whole steps."""
    road, step_s = scenario.crossing, scenario.experiment.step_s
    if traffic.tau_s < step_s:
        why = f"{traffic.tau_s:g} s: vehicles would collide with each other"
        raise InputError("traffic.tau_s", why, f"at least experiment.step_s = {step_s:g} s")
    for key in ("duration_s", "warm_up_s"):
        check_steps(f"traffic.{key}", getattr(traffic, key), step_s)
    for key, lanes in (("flow_per_hour", road.lanes), ("oncoming_per_hour", road.oncoming_lanes)):
        flow_per_hour = getattr(traffic, key)
        for lane in range(lanes if traffic.saturated or flow_per_hour else 0):
            _check_fits(scenario, lane)
        most = lanes * SECONDS_PER_HOUR / scenario.least_headway_s()
        if flow_per_hour >= most and flow_per_hour > 0 and not traffic.saturated:
            problem = f"{flow_per_hour:g} vehicles per hour on {lanes} lanes"
            below = f"below {most:.4g}: lanes × 3600 s / (tau_s + (length + min_gap_m)/v0)"
            allowed = below if lanes else "0, for there is no lane"
            raise InputError(f"traffic.{key}", problem, allowed)


def _check_simulation(scenario: Scenario) -> None:
    """Refuse a table and times that do not fit to a configuration's."""
    simulation = scenario.known_simulation
    if scenario.traffic is not None:
        problem = "cannot be combined with [simulation], whose demand is the configuration's"
        raise InputError("traffic", problem, "one of the two")
    begin_s, end_s = simulation.begin_s, simulation.end_s
    if begin_s is not None and end_s is not None and end_s <= begin_s:
        allowed = f"after simulation.begin_s = {begin_s:g} s"
        raise InputError("simulation.end_s", f"{end_s:g} s", allowed)


def _check_pedestrians(scenario: Scenario) -> None:
    """Refuse keys of ``[pedestrians]`` that do not fit together or to the rest of the scenario."""
    pedestrians = scenario.pedestrians
    _check_sum("pedestrians.group_size", pedestrians.group_size)
    if len(pedestrians.group_size) > 1 and pedestrians.drawn:
        problem = "is not supported with pedestrians.drawn, whose pedestrians come one by one"
        raise InputError("pedestrians.group_size", problem, "none")
    classes = [kind.share for kind in pedestrians.walking_classes]
    _check_sum("pedestrians.walking_speed.classes", classes, at_most=True)
    if pedestrians.drawn and scenario.experiment.pairs > len(pedestrians.drawn):
        problem = f"has the pedestrians of {len(pedestrians.drawn)} pairs"
        allowed = f"at least experiment.pairs = {scenario.experiment.pairs} entries"
        raise InputError("pedestrians.drawn", problem, allowed)
    _check_case(pedestrians.timed_case, scenario, "pedestrians.timed_case")
    for number in range(len(pedestrians.timed)):
        _check_timed(number, scenario)


def _check_sum(key: str, shares: Sequence[float], *, at_most: bool = False) -> None:
    """Refuse shares that do not sum to 1, or with ``at_most`` to more than 1."""
    total = math.fsum(shares)
    if total > 1 + ROUNDING or (total < 1 - ROUNDING and not at_most):
        allowed = f"shares that sum to {'at most 1' if at_most else '1'}"
        raise InputError(key, f"the shares sum to {total:.10g}", allowed)


def _check_case(case: str | None, scenario: Scenario, key: str) -> None:
    names = [timed.name for timed in scenario.pedestrians.timed]
    if case is not None and case not in names:
        raise unknown_name(key, "case", case, names)


def _check_timed(number: int, scenario: Scenario) -> None:
    """Refuse a pedestrian who would start beyond the footpath, in the car or before the trigger."""
    ego, timed = scenario.ego, scenario.pedestrians.timed[number]
    key = f"pedestrians.timed.{number}"
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


def _check_obstacles(scenario: Scenario) -> None:
    """Refuse an obstacle in the path of a vehicle or of pedestrians, or with an unknown case."""
    crossing, half_m = scenario.crosswalk(), scenario.ego.width_m / 2
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
        low, high = (crossing.lane_centre_m + way for way in (-half_m, half_m))
        if _overlap(obstacle.y_bounds_m, (low, high)):
            allowed = f"y below {low:g} m or above {high:g} m"
            raise InputError(f"{key}.y_m", "stands in the ego's path", allowed)
        beside = (-PEDESTRIAN_RADIUS_M, PEDESTRIAN_RADIUS_M)
        if _overlap(obstacle.x_bounds_m, beside) and _overlap(obstacle.y_bounds_m, walked):
            allowed = f"x below {beside[0]:g} m or above {beside[1]:g} m"
            raise InputError(f"{key}.x_m", "a pedestrian would touch it", allowed)


def _overlap(interval: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two intervals share more than an end point."""
    return interval[0] < other[1] - ROUNDING and other[0] < interval[1] - ROUNDING
