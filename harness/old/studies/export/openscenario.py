"""A scene as OpenSCENARIO XML 1.2, written with scenariogeneration (docs/export.md)."""

import math
from collections.abc import Iterator
from datetime import datetime
from xml.etree import ElementTree

import numpy as np
from scenariogeneration import xosc

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Vehicle
from harness.old.studies.export.scene import Box, Mover, Scene

ROAD = "road.xodr"
"""The road's file, next to the scenario."""

REAR_OVERHANG = 0.2
"""Distance from the rear bumper to the rear axle, as a share of the vehicle's length (ours)."""

_DATE = datetime(2000, 1, 1)
"""The date in every header, so that the same pair gives the same bytes."""

_HEIGHT_M = {"vehicle": 1.5, "pedestrian": 1.75, "obstacle": 2.0}
"""Heights, which the harness does not model (ours)."""

_ACT = "passage"
_UNKNOWN_MPS2 = 10.0
"""The limits of a vehicle's acceleration that a recorded passage does not have (ours)."""
_SLACK_M = 1e-3
"""The free ego starts exactly where the people's clock starts; this keeps rounding out of it."""


def openscenario(scene: Scene, *, free: bool) -> bytes:
    """Return a scene as the bytes of an ``.xosc`` file, with the road in ``road.xodr``.

    Vehicles are placed by their rear axle, pedestrians and obstacles by their centre.

    Args:
        scene: the scene.
        free: whether the first vehicle starts at R0 with v0 and has no trajectory.  Everybody
            else's clock starts when it is at R0.
    """
    entities, init = xosc.Entities(), xosc.Init()
    act = xosc.Act(_ACT, _begins(scene) if free else _at(0.0, "begins"))
    for mover in scene.movers:
        entities.add_scenario_object(mover.name, _entity(mover))
        positions = list(_positions(scene, mover))
        drives = free and mover is scene.movers[0]
        if mover.appears_s <= 0:
            init.add_init_action(mover.name, xosc.TeleportAction(positions[0]))
            speed = xosc.AbsoluteSpeedAction(round(float(mover.speed_mps[0]), 6), _AT_ONCE)
            init.add_init_action(mover.name, speed)
        if not drives and (events := list(_events(mover, positions))):
            maneuver = xosc.Maneuver(f"{mover.name} moves")
            for event in events:
                maneuver.add_event(event)
            group = xosc.ManeuverGroup(f"{mover.name} group")
            group.add_actor(mover.name)
            group.add_maneuver(maneuver)
            act.add_maneuver_group(group)
    for number, box in enumerate(scene.boxes):
        name = f"obstacle-{number}"
        entities.add_scenario_object(name, _obstacle(name, box, scene))
        x, y = scene.frame.to_network(box.x_m, box.y_m)
        heading = math.atan2(scene.frame.along_y, scene.frame.along_x)
        init.add_init_action(name, xosc.TeleportAction(_place(x, y, heading)))
    end_s = scene.timeout_s if free else scene.end_s
    board = xosc.StoryBoard(init, _at(end_s, "ends", "stop"))
    board.add_act(act)
    document = xosc.Scenario(
        scene.title,
        "crosswalk-harness",
        xosc.ParameterDeclarations(),
        entities,
        board,
        xosc.RoadNetwork(roadfile=ROAD),
        xosc.Catalog(),
        osc_minor_version=2,
        creation_date=_DATE,
    ).get_element()
    ElementTree.indent(document)
    text: bytes = ElementTree.tostring(document, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


_AT_ONCE = xosc.TransitionDynamics(xosc.DynamicsShapes.step, xosc.DynamicsDimension.time, 0)


def _entity(mover: Mover) -> xosc.Vehicle | xosc.Pedestrian:
    vehicle = mover.vehicle
    if vehicle is None:
        height, extent = _HEIGHT_M["pedestrian"], 2 * PEDESTRIAN_RADIUS_M
        box = xosc.BoundingBox(extent, extent, height, 0.0, 0.0, height / 2)
        return xosc.Pedestrian(mover.name, 75, xosc.PedestrianCategory.pedestrian, box)
    length, width, height = vehicle.length_m, vehicle.width_m, _HEIGHT_M["vehicle"]
    rear = REAR_OVERHANG * length
    box = xosc.BoundingBox(width, length, height, round(length / 2 - rear, 6), 0.0, height / 2)
    return xosc.Vehicle(
        mover.name,
        xosc.VehicleCategory.car,
        box,
        xosc.Axle(0.5, 0.65, round(0.85 * width, 6), round(length - 2 * rear, 6), 0.325),
        xosc.Axle(0.0, 0.65, round(0.85 * width, 6), 0.0, 0.325),
        70,
        vehicle.max_acceleration_mps2 or _UNKNOWN_MPS2,
        vehicle.max_deceleration_mps2 or _UNKNOWN_MPS2,
    )


def _obstacle(name: str, box: Box, scene: Scene) -> xosc.MiscObject:
    height = _HEIGHT_M["obstacle"]
    # At an oblique crosswalk the rectangle of the road frame is a parallelogram on the ground.
    width = round(box.width_m * scene.slant, 6)
    bounds = xosc.BoundingBox(width, box.length_m, height, 0.0, 0.0, height / 2)
    return xosc.MiscObject(name, 1000, xosc.MiscObjectCategory.obstacle, bounds)


def _front_m(vehicle: Vehicle | None) -> float:
    """Distance from a mover's reference point to the point that the scene has."""
    return 0.0 if vehicle is None else (1 - REAR_OVERHANG) * vehicle.length_m


def _positions(scene: Scene, mover: Mover) -> Iterator[xosc.WorldPosition]:
    """Yield the reference point in the network at each state."""
    front_m = _front_m(mover.vehicle)
    x, y = scene.frame.to_network(mover.x_m, mover.y_m)
    headings = scene.headings(mover)
    columns = x - front_m * np.cos(headings), y - front_m * np.sin(headings), headings
    for place in zip(*(column.tolist() for column in columns), strict=True):
        yield _place(*place)


def _place(x: float, y: float, heading: float) -> xosc.WorldPosition:
    return xosc.WorldPosition(round(x, 6), round(y, 6), 0.0, round(heading, 9), 0.0, 0.0)


def _events(mover: Mover, positions: list[xosc.WorldPosition]) -> Iterator[xosc.Event]:
    """Yield the events of a mover: it appears, moves, and leaves."""
    name = mover.name
    if mover.appears_s > 0:
        yield _event(f"{name} appears", mover.appears_s, xosc.AddEntityAction(name, positions[0]))
    if len(positions) > 1:
        begin_s = float(mover.time_s[0])
        trajectory = xosc.Trajectory(f"{name} trajectory", False)
        times = [round(time - begin_s, 6) for time in mover.time_s.tolist()]
        trajectory.add_shape(xosc.Polyline(times, positions))
        action = xosc.FollowTrajectoryAction(
            trajectory, xosc.FollowingMode.position, xosc.ReferenceContext.relative, 1, 0
        )
        yield _event(f"{name} follows its trajectory", begin_s, action)
    if mover.leaves_s is not None:
        yield _event(f"{name} leaves", mover.leaves_s, xosc.DeleteEntityAction(name))


def _event(name: str, after_s: float, action: object) -> xosc.Event:
    """Return an event at a time after the beginning of the act."""
    running = xosc.StoryboardElementStateCondition(
        xosc.StoryboardElementType.act, _ACT, xosc.StoryboardElementState.runningState
    )
    event = xosc.Event(name, xosc.Priority.parallel)
    event.add_trigger(
        xosc.ValueTrigger(f"{name}, when", round(after_s, 6), xosc.ConditionEdge.none, running)
    )
    event.add_action(f"{name}, what", action)
    return event


def _at(time_s: float, name: str, point: str = "start") -> xosc.ValueTrigger:
    when = xosc.SimulationTimeCondition(round(time_s, 6), xosc.Rule.greaterOrEqual)
    return xosc.ValueTrigger(name, 0, xosc.ConditionEdge.none, when, triggeringpoint=point)


def _begins(scene: Scene) -> xosc.EntityTrigger:
    """Return the condition that the free ego is at R0, wherever its user lets it start."""
    ego = scene.movers[0]
    x, y = scene.frame.to_network(0.0, float(ego.y_m[0]))
    away_m = -float(ego.x_m[0]) + _front_m(ego.vehicle) + _SLACK_M
    near = xosc.DistanceCondition(
        round(away_m, 6),
        xosc.Rule.lessOrEqual,
        _place(x, y, 0.0),
        alongroute=False,
        freespace=False,
        distance_type=xosc.RelativeDistanceType.euclidianDistance,
        coordinate_system=xosc.CoordinateSystem.entity,
    )
    return xosc.EntityTrigger("at R0", 0, xosc.ConditionEdge.none, near, ego.name)
