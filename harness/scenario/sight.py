"""Checks of ``[perception]`` and obstacles against the rest of a scenario."""

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Side
from harness.core.errors import InputError, unknown_name
from harness.scenario.scenario import Scenario
from harness.scenario.sections import ROUNDING_M, ObstacleSection


def check_sight(scenario: Scenario, source: str) -> None:
    """Refuse times that are not whole steps, and obstacles in the way of the ego or pedestrians.

    Args:
        scenario: a scenario in which each single key was accepted.
        source: name of the file in messages.

    Raises:
        InputError: keys do not fit together; the message names the key to change.
    """
    perception, step_s = scenario.perception, scenario.experiment.step_s
    obstacles = scenario.crossing.obstacles
    alone = scenario.traffic is None and scenario.simulation is None
    if perception.vehicles_hide and alone:
        problem = "has no effect: the ego meets no other vehicle"
        allowed = "false, or a scenario with [traffic] or [simulation]"
        raise InputError(f"{source}: perception.vehicles_hide", problem, allowed)
    update_s = step_s if perception.update_s is None else perception.update_s
    times_s = {"latency_s": (perception.latency_s, 0), "update_s": (update_s, 1)}
    for key, (time_s, fewest) in times_s.items():
        check_steps(f"{source}: perception.{key}", time_s, step_s, fewest)
    for number, obstacle in enumerate(obstacles):
        _check_obstacle(obstacle, scenario, f"{source}: crossing.obstacles.{number}")


def check_steps(where: str, time_s: float, step_s: float, fewest: int = 0) -> None:
    """Refuse a time that is not a whole number of steps or is shorter than ``fewest`` steps."""
    steps = time_s / step_s
    if steps < fewest - 1e-9 or abs(steps - round(steps)) > 1e-6:
        allowed = f"whole steps of experiment.step_s = {step_s:g} s"
        raise InputError(where, f"{time_s:g} s is not accepted", allowed)


def remarks_on_sight(scenario: Scenario) -> list[str]:
    """Remarks if SUMO's own driver drives, who sees everybody, and if nothing hides anybody."""
    perception, obstacles = scenario.perception, scenario.crossing.obstacles
    perfect = perception.is_perfect(scenario.experiment.step_s) and not perception.vehicles_hide
    lines = []
    if not perfect and "sumo_driver" in (scenario.arms.av, scenario.arms.human):
        lines.append(
            "[perception] has no effect on sumo_driver: SUMO drives it and sees every pedestrian"
        )
    hiding = {"crossing.obstacles": obstacles, "perception.vehicles_hide": perception.vehicles_hide}
    names = [name for name, hides in hiding.items() if hides]
    if names and perception.human and not perception.occlusion:
        lines.append(
            f"{' and '.join(names)} {'have' if len(names) > 1 else 'has'} no effect: "
            "perception.occlusion = false, and with perception.human = true for human drivers too"
        )
    return lines


def _check_obstacle(obstacle: ObstacleSection, scenario: Scenario, where: str) -> None:
    """Refuse an obstacle in the path of the ego or of pedestrians, or with an unknown case."""
    pedestrians, crossing = scenario.pedestrians, scenario.crosswalk()
    names = [timed.name for timed in pedestrians.timed]
    if obstacle.case is not None and obstacle.case not in names:
        raise unknown_name(f"{where}.case", "case", obstacle.case, names)
    for whose, (low, high) in _paths(scenario):
        if _overlap(obstacle.y_bounds_m, (low, high)):
            allowed = f"y below {low:g} m or above {high:g} m"
            raise InputError(f"{where}.y_m", f"stands in {whose} path", allowed)
    before_m = dict.fromkeys(Side, 0.0)
    for timed in pedestrians.timed:
        side = Side(timed.side)
        start_m = timed.start_lateral_m - crossing.to_lane_m(side)
        before_m[side] = max(before_m[side], start_m)
    way = (
        -before_m[Side.NEAR] - PEDESTRIAN_RADIUS_M,
        crossing.length_m + before_m[Side.FAR] + PEDESTRIAN_RADIUS_M,
    )
    if _overlap(obstacle.x_bounds_m, (-PEDESTRIAN_RADIUS_M, PEDESTRIAN_RADIUS_M)) and _overlap(
        obstacle.y_bounds_m, way
    ):
        raise InputError(
            f"{where}.x_m",
            "a pedestrian would touch it",
            f"x below {-PEDESTRIAN_RADIUS_M:g} m or above {PEDESTRIAN_RADIUS_M:g} m",
        )


def _paths(scenario: Scenario) -> list[tuple[str, tuple[float, float]]]:
    """The strips in which vehicles drive: the ego's, or with ``[traffic]`` those of all lanes."""
    crossing, traffic = scenario.crosswalk(), scenario.traffic
    if traffic is None:
        half_m = scenario.ego.width_m / 2
        centre_m = crossing.lane_centre_m
        return [("the ego's", (centre_m - half_m, centre_m + half_m))]
    half_m = max(vehicle.width_m for vehicle in scenario.vehicles()) / 2
    centres = {
        oncoming: [lane.lane_centre_m for lane in scenario.crosswalk_from_lanes(oncoming=oncoming)]
        for oncoming in (False, True)
        if traffic.has_vehicles(oncoming=oncoming)
    }
    across = centres.get(False, []) + [crossing.length_m - y for y in centres.get(True, [])]
    return [("the vehicles'", (centre - half_m, centre + half_m)) for centre in across]


def _overlap(interval: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two intervals share more than an end point."""
    return interval[0] < other[1] - ROUNDING_M and other[0] < interval[1] - ROUNDING_M
