"""Checks on combinations of a scenario's keys; single keys are checked by their sections."""

import math

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Arm, Crossing, Side
from harness.core.errors import InputError
from harness.scenario.people import PedestriansSection
from harness.scenario.people_consistency import check_pedestrians, check_quarters
from harness.scenario.scenario import Scenario
from harness.scenario.sections import (
    ROUNDING_M,
    CrossingSection,
    EgoSection,
    ExperimentSection,
    Section,
)
from harness.scenario.sight import check_sight, check_steps, remarks_on_sight
from harness.scenario.traffic import TrafficSection, by_quarter

SUMO_DRIVER = "sumo_driver"
"""The strategy that leaves the driving to SUMO."""

_OF_EVERY_VEHICLE = ("trigger_range_m", "detection_range_m", "resume_acceleration_mps2")
"""Keys of ``[ego]`` that apply to every vehicle; vehicle types define the others."""

_NEED_A_TRIGGER = ("first_at_trigger", "timed", "timed_case", "drawn", "warm_up_s")
"""Keys of ``[pedestrians]`` that need an encounter."""

WIDEST_USUAL_LANE_M = 6.0
"""A wider lane gets a remark, because users may enter the width of two lanes as that of one."""


def check_consistency(scenario: Scenario, source: str) -> None:
    """Refuse a scenario whose keys do not fit together.

    Args:
        scenario: a scenario in which each single key was accepted.
        source: name of the file in messages.

    Raises:
        InputError: keys do not fit together; the message names the key to change.
    """
    ego, crossing, experiment = scenario.ego, scenario.crossing, scenario.experiment
    if scenario.simulation is not None:
        _check_simulation(scenario, source)
        check_pedestrians(scenario, f"{source}: pedestrians")
        _check_drivers(scenario, source)
        return
    if (crossing.latitude_deg is None) is not (crossing.longitude_deg is None):
        missing = "latitude_deg" if crossing.latitude_deg is None else "longitude_deg"
        raise InputError(f"{source}: crossing.{missing}", "is not given", "both or neither")
    _check_lanes(scenario, source)
    # SUMO's approach lane ends 1.5 m before the crosswalk: the ego cannot be inserted beyond it.
    nearest = crossing.width_m / 2 + 1.5
    if ego.trigger_range_m < nearest:
        raise InputError(
            f"{source}: ego.trigger_range_m",
            f"{ego.trigger_range_m:g} m is on or too close to the crosswalk",
            f"at least crossing.width_m / 2 + 1.5 = {nearest:g} m",
        )
    check_pedestrians(scenario, f"{source}: pedestrians")
    milliseconds = experiment.step_s * 1000
    if abs(milliseconds - round(milliseconds)) > 1e-9:
        raise InputError(
            f"{source}: experiment.step_s",
            f"{experiment.step_s!r} s",
            "whole milliseconds, SUMO's resolution",
        )
    check_steps(f"{source}: experiment.timeout_s", experiment.timeout_s, experiment.step_s, 1)
    if scenario.traffic is not None:
        _check_traffic(scenario, scenario.traffic, source)
    check_sight(scenario, source)
    _check_car(scenario, source)


def remarks(scenario: Scenario) -> list[str]:
    """Remarks on values that are allowed but may be mistakes, one line each."""
    crossing, lines = scenario.crossing, remarks_on_sight(scenario)
    if crossing.width_of_lane_m > WIDEST_USUAL_LANE_M:
        lanes = f"crossing.lanes = {crossing.lanes} and oncoming_lanes = {crossing.oncoming_lanes}"
        lines.append(
            f"each lane is {crossing.width_of_lane_m:g} m wide: {lanes} share crossing.length_m = "
            f"{crossing.length_m:g} m; to change it, set the lanes or crossing.lane_width_m"
        )
    return lines


def _check_lanes(scenario: Scenario, source: str) -> None:
    ego, crossing = scenario.ego, scenario.crossing
    count, width = crossing.lanes + crossing.oncoming_lanes, crossing.width_of_lane_m
    if count * width > crossing.length_m + ROUNDING_M:
        raise InputError(
            f"{source}: crossing.lane_width_m",
            f"{count} lanes of {width:g} m are wider than the road",
            f"at most crossing.length_m / {count} = {crossing.length_m / count:g} m",
        )
    if ego.lane >= crossing.lanes:
        raise InputError(
            f"{source}: ego.lane",
            f"there is no lane {ego.lane}; lanes are counted from 0 at the near kerb",
            f"below crossing.lanes = {crossing.lanes}",
        )
    _check_fits(scenario.crosswalk(), scenario, source)


def _check_fits(crosswalk: Crossing, scenario: Scenario, source: str) -> None:
    """Refuse a vehicle that is too wide for its lane, or for pedestrians who wait next to it."""
    crossing, width = scenario.crossing, crosswalk.lane_width_m
    key, width_m = _widest(scenario)
    if width_m > width:
        count = crossing.lanes + crossing.oncoming_lanes
        raise InputError(
            f"{source}: {key}",
            f"{width_m:g} m is wider than the lane",
            f"at most {width:g} m: crossing.lane_width_m, or length_m shared by {count} lanes",
        )
    room = min(map(crosswalk.to_lane_m, Side)) - width_m / 2
    if room < PEDESTRIAN_RADIUS_M - ROUNDING_M:
        raise InputError(
            f"{source}: {key}",
            f"{width_m:g} m leaves {room:.2f} m to a kerb, where people wait",
            f"at least {PEDESTRIAN_RADIUS_M:g} m, the radius of a pedestrian",
        )


def _widest(scenario: Scenario) -> tuple[str, float]:
    """The key and the width of the widest vehicle."""
    types = () if scenario.traffic is None else scenario.traffic.types
    keys = [
        "ego.width_m" if kind.width_m is None else f"traffic.types.{number}.width_m"
        for number, kind in enumerate(types)
    ] or ["ego.width_m"]
    widths = [vehicle.width_m for vehicle in scenario.vehicles()]
    return max(zip(keys, widths, strict=True), key=lambda pair: pair[1])


def _check_car(scenario: Scenario, source: str) -> None:
    """Refuse roads on which a vehicle cannot brake or drive, and SUMO's driver in a late one."""
    grade = scenario.crossing.grade
    for oncoming in [False] if scenario.traffic is None else [False, True]:
        for vehicle in scenario.vehicles(oncoming=oncoming):
            limits = (vehicle.max_deceleration_mps2, vehicle.max_acceleration_mps2)
            for limit, what in zip(limits, ("brake", "drive on"), strict=True):
                if limit <= 0:
                    problem = f"with {grade:g} a vehicle could not {what}: {limit:.3g} m/s²"
                    allowed = "a flatter road, or more crossing.friction"
                    raise InputError(f"{source}: crossing.grade", problem, allowed)
    _check_drivers(scenario, source)


def _check_drivers(scenario: Scenario, source: str) -> None:
    """Refuse SUMO's own driver where it cannot drive, or does not mind the people who come."""
    for driver in Arm:
        if scenario.arms.driver(driver) != SUMO_DRIVER:
            continue
        if scenario.simulation is not None and scenario.pedestrians.anyone_comes:
            problem = f"{SUMO_DRIVER} passes people of the harness (pedestrians.flow_per_hour)"
            raise InputError(f"{source}: arms.{driver}", problem, "another strategy, or no flow")
        if scenario.simulation is None:
            problem = f"{SUMO_DRIVER} drives only with [simulation]"
            raise InputError(f"{source}: arms.{driver}", problem, "another strategy")
        if scenario.actuation.applies_to(driver):
            problem = f"is not supported with arms.{driver} = {SUMO_DRIVER}: SUMO drives it"
            raise InputError(f"{source}: actuation", problem, "another strategy")


def check_time_out(scenario: Scenario, source: str) -> None:
    """Refuse a time-out that is too short even for an ego that meets nobody.

    Args:
        scenario: a scenario that is to run.  Runs that were read from a folder are not checked.
        source: the option or the file that set the time-out.

    Raises:
        InputError: the time-out is shorter than a free pass.
    """
    if scenario.simulation is not None:
        return  # Passages last as long as they do; the simulation has an end of its own.
    free_pass_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    timeout_s = scenario.experiment.timeout_s
    if timeout_s < free_pass_s - 1e-9:
        raise InputError(
            f"{source} experiment.timeout_s",
            f"{timeout_s:g} s is shorter than a free pass",
            f"at least {free_pass_s:.4g} s, the time to pass at ego.initial_speed_mps",
        )


def _check_traffic(scenario: Scenario, traffic: TrafficSection, source: str) -> None:
    """Refuse flows above capacity, times that are not whole steps, and keys that need a trigger."""
    pedestrians, step_s = scenario.pedestrians, scenario.experiment.step_s
    people, where = f"{source}: pedestrians", f"{source}: traffic"
    keys = ("first_at_trigger", "timed", "drawn", "warm_up_s")
    for key in (key for key in keys if getattr(pedestrians, key)):
        raise InputError(
            f"{people}.{key}", "is not supported with [traffic]: no vehicle has a trigger", "none"
        )
    if traffic.tau_s < step_s:
        why = f"{traffic.tau_s:g} s: vehicles would collide with each other"
        raise InputError(f"{where}.tau_s", why, f"at least experiment.step_s = {step_s:g} s")
    _check_types(traffic, f"{where}.types")
    for key in ("duration_s", "warm_up_s"):
        check_steps(f"{where}.{key}", getattr(traffic, key), step_s)
    for key, oncoming in (("flow_per_hour", False), ("oncoming_per_hour", True)):
        lanes = scenario.crosswalk_from_lanes(oncoming=oncoming)
        if traffic.has_vehicles(oncoming=oncoming):
            for lane in lanes:
                _check_fits(lane, scenario, source)
        if not traffic.saturated:  # in saturated traffic the flows have no effect
            _check_flow(getattr(traffic, key), len(lanes), scenario, f"{where}.{key}")


def _check_types(traffic: TrafficSection, where: str) -> None:
    """Refuse types with the same name, and shares that do not sum to 1."""
    if not traffic.types:
        return
    names = [kind.name for kind in traffic.types]
    for number, name in enumerate(names):
        if name in names[:number]:
            raise InputError(f"{where}.{number}.name", f"{name!r} is there twice", "another name")
    total = math.fsum(traffic.shares)
    if abs(total - 1) > 1e-9:
        raise InputError(where, f"the shares sum to {total:.10g}", "shares that sum to 1")


def _check_flow(
    flow: float | tuple[float, ...], lanes: int, scenario: Scenario, where: str
) -> None:
    traffic, values = scenario.known_traffic, by_quarter(flow)
    check_quarters(flow, scenario, where)
    most = lanes * 3600.0 / scenario.least_headway_s()
    if max(values) > 0 and not lanes:
        raise InputError(where, f"{max(values):g} vehicles per hour, but no lane for them", "0")
    if max(values) >= most and max(values) > 0:
        headway = "a mean headway" if traffic.types else "a headway"
        allowed = f"below {most:.4g}: lanes × 3600 s / {headway} of tau_s + (length + min_gap_m)/v0"
        plural = "" if lanes == 1 else "s"
        problem = f"{max(values):g} vehicles per hour on {lanes} lane{plural}"
        raise InputError(where, problem, allowed)


def _check_simulation(scenario: Scenario, source: str) -> None:
    """Refuse keys that the configuration defines, or that need an encounter.

    Raises:
        InputError: names the key.
    """
    simulation, people = scenario.known_simulation, scenario.pedestrians
    if scenario.traffic is not None:
        problem = "cannot be combined with [simulation], whose demand is the configuration's"
        raise InputError(f"{source}: traffic", problem, "one of the two")
    if key := _changed(scenario.crossing, CrossingSection(), ()):
        problem = "cannot be combined with [simulation], whose network defines it"
        raise InputError(f"{source}: crossing.{key}", problem, "simulation.crossings")
    if key := _changed(scenario.ego, EgoSection(), _OF_EVERY_VEHICLE):
        problem = "cannot be combined with [simulation], whose vehicle types define it"
        raise InputError(f"{source}: ego.{key}", problem, ", ".join(_OF_EVERY_VEHICLE))
    times = ("pairs", "seed", "decide_limit_s")
    if key := _changed(scenario.experiment, ExperimentSection(), times):
        problem = "cannot be combined with [simulation]"
        raise InputError(f"{source}: experiment.{key}", problem, "simulation.step_s")
    where = f"{source}: pedestrians"
    for key in _NEED_A_TRIGGER:
        if getattr(people, key) != getattr(PedestriansSection(), key):
            problem = "is not supported with [simulation]: no vehicle has a trigger"
            raise InputError(f"{where}.{key}", problem, "none")
    if isinstance(people.flow_per_hour, tuple):
        problem = "a list is not supported with [simulation]"
        raise InputError(f"{where}.flow_per_hour", problem, "one flow")
    begin_s, end_s = simulation.begin, simulation.end
    if begin_s is not None and end_s is not None and end_s <= begin_s:
        where = f"{source}: simulation.end"
        raise InputError(where, f"{end_s:g} s", f"after simulation.begin = {begin_s:g} s")


def _changed(section: Section, default: Section, but: tuple[str, ...]) -> str | None:
    """The first key of a section, by name, whose value is not the default, if there is one."""
    own, theirs = dict(section), dict(default)
    return min((key for key in own if key not in but and own[key] != theirs[key]), default=None)
