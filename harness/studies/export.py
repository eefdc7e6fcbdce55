"""An arm of a pair in, of encounters or simulations; its scenario and road for other tools out.

Coordinates are those of the SUMO network.  A vehicle's place is the middle of its front bumper, a
pedestrian's the centre.  Times count from the ego's first state within R0.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import jinja2
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.errors import InputError, Parameter
from harness.core.files import cannot_write, write_file
from harness.core.freezing import Frozen
from harness.core.vocabulary import (
    PEDESTRIAN_RADIUS_M,
    ROUNDING,
    Arm,
    Arrival,
    FloatArray,
    Leg,
    Side,
    Walk,
)
from harness.engine.arm_files import CONFIG_FILE, Seen, seen_in
from harness.engine.configuration import read_config
from harness.engine.network import network_of, opendrive
from harness.engine.protocol import VehicleType
from harness.engine.session import vehicle_types
from harness.measures.motion.walking import cleared_s, states_at
from harness.results.loaded_run import Run
from harness.results.tables import TABLES_OF, Row, Tables
from harness.scenario import Scenario
from harness.site.road_frame import RoadFrame
from harness.studies.running import replay as again
from harness.studies.running.workers import carried_out

SCENARIO, ROAD = "scenario.xosc", "road.xodr"
"""The files that are written."""

REAR_OVERHANG = 0.2
"""Distance from the rear bumper to the rear axle, as a share of the vehicle's length (ours)."""

_TEMPLATE = Path(__file__).with_name("scenario.template.xosc")
_PERSON_M = 2 * PEDESTRIAN_RADIUS_M
_NEAR_M = 50.0
"""Those who never come nearer to the ego of a simulation are left out."""
_POINTS_APART_M = 1e-6
_SLACK_M = 1e-3
"""The free ego starts exactly where the people's clock starts; this keeps rounding out of it."""


@dataclass(frozen=True)
class Entity(Frozen):
    """A vehicle, pedestrian or obstacle.

    Attributes:
        name: its name in the file.
        kind: what it is.
        length_m, width_m: its extent.
        states: time in s, x, y, heading in rad (counter-clockwise from the network's x axis) and
            speed in m/s, shape (n, 5), n ≥ 1; n = 1 if it does not move by itself.
        appears_s: the time from which it is there, at its first place.
        leaves_s: the time from which it is gone; None if it stays.
        limits_mps2: a vehicle's greatest acceleration and deceleration.
        max_speed_mps: a vehicle's greatest speed; 70 m/s (ours) if nothing else is known.
    """

    name: str
    kind: Literal["vehicle", "pedestrian", "obstacle"]
    length_m: float
    width_m: float
    states: FloatArray
    appears_s: float = 0.0
    leaves_s: float | None = None
    limits_mps2: tuple[float, float] | None = None
    max_speed_mps: float = 70.0

    @property
    def axle_m(self) -> float:
        """Distance from OpenSCENARIO's reference point, a vehicle's rear axle, to the place."""
        return (1 - REAR_OVERHANG) * self.length_m if self.kind == "vehicle" else 0.0

    @property
    def changes(self) -> bool:
        """Whether anything happens to it."""
        return len(self.states) > 1 or self.appears_s > 0 or self.leaves_s is not None

    def places(self) -> list[list[float]]:
        """Time since its first state, x and y of the reference point, and heading."""
        time_s, x, y, heading, _ = self.states.T
        x, y = x - self.axle_m * np.cos(heading), y - self.axle_m * np.sin(heading)
        places: list[list[float]] = np.column_stack((time_s - time_s[0], x, y, heading)).tolist()
        return [[*(round(value, 6) for value in row[:3]), round(row[3], 9)] for row in places]


@dataclass(frozen=True)
class Exported(Frozen):
    """What is exported.

    Attributes:
        title: what it is, in a line.
        net: SUMO's network.
        movers: everybody, the ego first.
        end_s: the time at which it ends.
        clock: x, y and distance in m: everybody's clock starts when the ego's reference point is
            this near to the point; None: at once.
    """

    title: str
    net: Path
    movers: Sequence[Entity]
    end_s: float
    clock: tuple[float, float, float] | None = None


def export(
    run: Run,
    cell: int,
    pair: int,
    arm: Arm,
    out: Path,
    *,
    passage: tuple[str, str] | None = None,
    free: bool = False,
) -> tuple[list[Path], tuple[str, ...]]:
    """Write one arm of a pair as OpenSCENARIO XML 1.2, with its road as OpenDRIVE 1.4.

    Args:
        run: a run.
        cell, pair, arm: which arm.
        out: a new or empty folder.
        passage: of a simulation: the ids of the vehicle and of the crosswalk.
        free: of an encounter: whether the ego is at R0 with v0 and has no trajectory.

    Returns:
        The files, and how the arm differs from its record if it was simulated again.

    Raises:
        InputError: the cell, pair or passage does not exist, the arm failed, or an option is not
            supported.
    """
    again.refuse_in_use(out, "out")
    again.check_pairs(run, cell, [pair])
    if (run.kind == "simulations") != (passage is not None):
        problem = "is of simulations" if passage else "is missing"
        allowed = "of a simulation one that `harness worst` lists"
        raise InputError(Parameter("passage"), problem, allowed)
    if passage and free:
        raise InputError(Parameter("ego", "free"), "is of encounters", "recorded")
    title = f"{run.name}, cell {cell}, pair {pair}, {arm.value}'s arm"
    with TemporaryDirectory() as scratch:
        tables, differences = _tables(run, cell, pair, arm, Path(scratch))
        (row,) = tables[TABLES_OF[run.kind][0].name].to_pylist()
        if row["reason"] is not None:
            problem = f"the arm {arm} failed ({row['reason']})"
            raise InputError(Parameter("pair", pair), problem, "a pair whose arm ran")
        if passage:
            scene = _passage(title, tables["passages"], passage, Path(scratch))
        else:
            scene = _encounter(title, tables, run.scenario_of(cell), free)
        contents = {SCENARIO: _openscenario(scene), ROAD: opendrive(scene.net)}
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(out, error) from None
    for name, content in contents.items():
        write_file(out / name, content)
    return [out / name for name in contents], differences


def _tables(run: Run, cell: int, pair: int, arm: Arm, outputs: Path) -> again.Traced:
    """The rows of an arm, and how they differ from its record if it had to be simulated again."""
    if run.kind == "simulations":
        (task,) = again.stored_tasks(run, cell, [pair], [arm])
        (rows,) = carried_out([replace(task, outputs=outputs)])
        return rows.tables[cell], again.replayed(run, task, rows).differences
    ((tables, differences),) = again.traced(run, [(cell, pair)], (arm,)).values()
    own = {name: rows.filter(pc.equal(rows["arm"], arm)) for name, rows in tables.items()}
    return own, differences


def _openscenario(scene: Exported) -> bytes:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = environment.from_string(_TEMPLATE.read_text("utf-8"))
    return f"{template.render(scene=scene, road=ROAD, overhang=REAR_OVERHANG)}\n".encode()


def _encounter(title: str, tables: Tables, scenario: Scenario, free: bool) -> Exported:
    """An episode; if the ego is free, it has no end but the time-out, and people walk on."""
    rows, vehicle = tables["traces"], scenario.vehicle()
    rows = rows.filter(pc.equal(rows["object"], "ego"))
    names = ("time_s", "x_m", "y_m", "speed_mps")
    time_s, x_m, y_m, speed_mps = (rows[name].to_numpy() for name in names)
    crossing, end_s = scenario.crossing, float(time_s[-1])
    frame = RoadFrame.of(crossing.bearing_deg, crossing.length_m)
    heading = np.full(len(time_s), math.atan2(frame.along_y, frame.along_x))
    states = np.column_stack((time_s, *frame.to_network(x_m, y_m), heading, speed_mps))
    limits = vehicle.max_acceleration_mps2, vehicle.max_deceleration_mps2
    ego = Entity("ego", "vehicle", vehicle.length_m, vehicle.width_m, states, limits_mps2=limits)
    people = [*_people(scenario, tables["pedestrians"].to_pylist(), frame, end_s, free)]
    others = [*people, *_obstacles(scenario, frame)]
    if not free:
        return Exported(title, network_of(scenario), [ego, *others], end_s)
    if not any(len(each.states) > 1 for each in people):
        problem = "nobody walks in this arm of the pair"
        raise InputError(Parameter("ego", "free"), problem, "another pair")
    away_m = ego.axle_m - float(x_m[0]) + _SLACK_M
    clock = (*frame.to_network(0.0, float(y_m[0])), away_m)
    movers, timeout_s = [replace(ego, states=states[:1]), *others], scenario.experiment.timeout_s
    return Exported(title, network_of(scenario), movers, timeout_s, clock)


def _people(
    scenario: Scenario, rows: Sequence[Row], frame: RoadFrame, end_s: float, to_the_kerb: bool
) -> Iterator[Entity]:
    """The people of a record that ends at ``end_s``, from their arrival to the other kerb.

    ``to_the_kerb``: those who are on their way at the end walk on.
    """
    crossing, step_s = scenario.crosswalk(), scenario.experiment.step_s
    for row in rows:
        came = Arrival(row["index"], row["arrival_s"], Side(row["side"]), row["quantile"])
        legs = row["legs"] and tuple(Leg(**leg) for leg in row["legs"])
        walk = Walk(came, row["start_s"], row["speed_mps"], legs=legs)
        way = 1.0 if came.side is Side.NEAR else -1.0
        cleared = cleared_s(walk, crossing)
        if cleared is not None and cleared <= 0:
            continue
        time_s = np.array([max(0.0, came.arrival_s)])
        motion = [np.array([value]) for value in (0.0, 0.0 if way > 0 else crossing.length_m, 0.0)]
        until_s = end_s if cleared is None or (cleared > end_s and not to_the_kerb) else cleared
        if walk.start_s is not None:
            start_s = max(0.0, walk.start_s)
            steps = np.arange(start_s // step_s, math.ceil(until_s / step_s)) * step_s
            between = (steps > start_s + ROUNDING) & (steps < until_s - ROUNDING)
            time_s = np.array([start_s, *steps[between], until_s])
            motion = [*states_at(walk, crossing, time_s)[:3]]
        x, y = frame.to_network(motion[0], motion[1])
        across = math.atan2(way * frame.along_x, -way * frame.along_y)
        states = np.column_stack((time_s, x, y, _headings(x, y, across), motion[2]))
        appears_s = min(max(0.0, came.arrival_s), float(time_s[0]))
        leaves_s = until_s if until_s == cleared else None
        name, size = f"pedestrian-{came.index}", (_PERSON_M, _PERSON_M)
        yield Entity(name, "pedestrian", *size, states, appears_s, leaves_s)


def _headings(x: FloatArray, y: FloatArray, standing: float) -> FloatArray:
    """The direction of the way from each place to the next one, or of the last way.

    Ways too short to have a direction have that of the way before, or ``standing``.
    """
    dx, dy = np.diff(x), np.diff(y)
    ways = np.where(np.hypot(dx, dy) > _POINTS_APART_M, np.arctan2(dy, dx), np.nan)
    if not len(ways):
        return np.array([standing])
    known = np.maximum.accumulate(np.where(np.isnan(ways), -1, np.arange(len(ways))))
    directions = np.where(known < 0, standing, ways[known])
    return np.append(directions, directions[-1])


def _obstacles(scenario: Scenario, frame: RoadFrame) -> Iterator[Entity]:
    heading = math.atan2(frame.along_y, frame.along_x)
    for number, box in enumerate(scenario.obstacles()):
        states = np.array([[0.0, *frame.to_network(box.x_m, box.y_m), heading, 0.0]])
        name = f"obstacle-{number}"
        yield Entity(name, "obstacle", box.length_m, box.width_m, states)


def _passage(title: str, rows: pa.Table, ids: tuple[str, str], outputs: Path) -> Exported:
    """A passage of a simulation with everybody near, as SUMO's own output has them."""
    vehicle, crosswalk = ids
    chosen = [row for row in rows.to_pylist() if (row["vehicle"], row["crosswalk"]) == ids]
    if not chosen:
        problem = f"{vehicle} does not pass {crosswalk} in this arm"
        raise InputError(Parameter("passage"), problem, "one that `harness worst` lists")
    config = read_config(outputs / CONFIG_FILE)
    begin_s, rear_s = chosen[0]["trigger_s"], chosen[0]["rear_s"]
    last_s = math.inf if rear_s is None else rear_s + config.step_s
    found = defaultdict[tuple[bool, str], list[Seen]](list)
    for each in seen_in(outputs, config.step_s, begin_s, last_s):
        found[each.vehicle_type is not None, each.name].append(each)
    types = vehicle_types(config.path)
    ego = _mover(found.pop((True, vehicle)), types)
    others = [_mover(each, types) for each in found.values()]
    since_s, end_s = ego.states[0, 0], ego.states[-1, 0]
    near = [each for each in others if _distance_m(each, ego) < _NEAR_M]
    movers = [_between(each, since_s, end_s) for each in (replace(ego, name="ego"), *near)]
    return Exported(f"{title}, {vehicle} over {crosswalk}", config.net, movers, end_s - since_s)


def _mover(seen: Sequence[Seen], types: Mapping[str, VehicleType]) -> Entity:
    """Somebody in SUMO's output, by SUMO's time."""
    (name, kind, *_), states = seen[0], np.array([each[2:] for each in seen])
    if kind is None:
        return Entity(f"pedestrian-{name}", "pedestrian", _PERSON_M, _PERSON_M, states)
    length_m, width_m, gain_mps2, loss_mps2, most_mps = types[kind]
    vehicle = Entity(f"vehicle-{name}", "vehicle", length_m, width_m, states)
    return replace(vehicle, limits_mps2=(gain_mps2, loss_mps2), max_speed_mps=most_mps)


def _distance_m(mover: Entity, ego: Entity) -> float:
    """The least distance of two movers."""
    time_s, x_m, y_m = mover.states[:, :3].T
    ego_s, ego_x_m, ego_y_m = ego.states[:, :3].T
    return float(np.abs(x_m + 1j * y_m - np.interp(time_s, ego_s, ego_x_m + 1j * ego_y_m)).min())


def _between(mover: Entity, since_s: float, end_s: float) -> Entity:
    """A mover with times from ``since_s`` on, in a scene that ends at ``end_s``."""
    states = mover.states - [since_s, 0.0, 0.0, 0.0, 0.0]
    leaves_s = None if mover.states[-1, 0] == end_s else states[-1, 0]
    return replace(mover, states=states, appears_s=states[0, 0], leaves_s=leaves_s)
