"""A running simulation without SUMO: it plays tables of where everybody is at the ends of steps.

Its road leads 256 m to the east, over junctions J and K, each with a crosswalk 4 m wide, around
x = 104 and 152.  People walk across from y = −3 to 5; the middle of the only lane is at y = 0.
"""

import math
from collections import namedtuple
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

from shapely import LineString

from harness.core.vocabulary import Arm
from harness.engine.configuration import SumoConfig
from harness.engine.ids import edge_of
from harness.engine.protocol import CAR, LastStep, People, Vehicles, VehicleType
from harness.scenario import validate
from harness.simulation.arm import SimulatedArm
from harness.simulation.arm_tables import tables_of
from harness.simulation.setup import Setup
from harness.site.path import Lane
from harness.site.town import Connection, Crosswalk, Town

STEP_S, STEPS = 0.5, 80
LANES = {"a_0": 0.0, ":J_0_0": 100.0, "b_0": 108.0, ":K_0_0": 148.0, "c_0": 156.0}
"""Where each lane begins; the last one ends at 256 m."""
WAYS = {":J_c0": ("a_0", ":J_0_0", "b_0"), ":K_c0": ("b_0", ":K_0_0", "c_0")}
CENTRES = {":J_c0": 104.0, ":K_c0": 152.0}

Hit = namedtuple("Hit", "collider victim lane")


def drive(from_m: float, *speeds_mps: float) -> dict[int, float]:
    """x by step: at a place at the end of step 1, then a step at each of these speeds."""
    return dict(enumerate(accumulate((from_m, *(each * STEP_S for each in speeds_mps))), 1))


def walk(at: str, since_s: float) -> dict[int, Any]:
    """Somebody who walks straight over a crosswalk at 1 m/s, and steps off at ``since_s``."""
    ys = [step * STEP_S - since_s - 3.0 for step in range(STEPS + 1)]
    edges = ("w0" if y < -3.0 else "c0" if y <= 5.0 else "w1" for y in ys)
    places = zip(edges, ys, strict=True)
    return {n: (at.replace("c0", on), (CENTRES[at], y), 1.0) for n, (on, y) in enumerate(places)}


class Scripted:
    """Plays tables; see ``harness.engine.protocol.Running``.

    Args:
        cars: by id, the x of each vehicle's front by step.
        walkers: by id, the edge, place and speed of everybody on foot by step.
        hits: the collisions, by step.
        followers: those who are near to a leader.

    Attributes:
        said: what it was told: when, what, of whom, and more.
    """

    def __init__(
        self, cars: Any, walkers: Any = (), hits: Any = (), followers: Sequence[str] = ()
    ) -> None:
        self._cars, self._walkers, self._followers = cars, dict(walkers), followers
        self._now, self.time_s, self.step_s = 0, 0.0, STEP_S
        self.said: list[tuple[Any, ...]] = []
        self.vehicles = Vehicles(*(partial(self._car, each) for each in Vehicles.__slots__))
        self.people = People(*(partial(self._person, each) for each in People.__slots__))
        self.last = LastStep(
            departed=lambda: [name for name in cars if self._now == min(cars[name])],
            arrived=lambda: [name for name in cars if self._now == max(cars[name]) + 1],
            teleported=list,
            emergency_stops=list,
            collisions=lambda: dict(hits).get(self._now, ()),
            vehicles_on=lambda edge: [n for n in cars if edge_of(self._car("lane", n)) == edge],
            people_on=lambda edge: [n for n in walkers if walkers[n][self._now][0] == edge],
        )
        self.let_yield, self.ignore = (partial(self._hear, each) for each in ("yield", "ignore"))
        told = ("release", "add", "move")
        self.release, self.add_person, self.move_person = (partial(self._hear, e) for e in told)

    def _hear(self, *words: Any) -> None:
        self.said.append((self.time_s, *words))

    def _car(self, what: str, name: str, *more: Any) -> Any:
        table, now = self._cars[name], self._now
        x_m, before_m = table.get(now, -1.0), table.get(now - 1)
        moved_m = table.get(now + 1, x_m) - x_m if before_m is None else x_m - before_m
        lane = next((lane for lane in reversed(LANES) if LANES[lane] <= x_m), "")
        known = {"lane": lane, "lane_position_m": x_m - LANES.get(lane, 0.0), "odometer_m": x_m}
        known |= {"speed_mps": moved_m / STEP_S, "acceleration_mps2": 0.0, "type": "car"}
        known["speed_factor"] = 1.0
        return known[what] if what in known else self._hear(what, name, *more)

    def _person(self, what: str, name: str, *more: Any) -> Any:
        if name not in self._walkers:
            return self._hear(what, name, *more)
        (edge, place, speed_mps), *later = (
            row for step, row in self._walkers[name].items() if step >= self._now
        )
        next_edge = next((row[0] for row in later if row[0] != edge), "")
        return {"next_edge": next_edge, "position": place, "speed_mps": speed_mps}[what]

    def step(self) -> float:
        self._now += 1
        self.time_s = self._now * STEP_S
        return self.time_s

    def goes_on(self, end_s: float | None) -> bool:
        return end_s is None or self.time_s < end_s

    def built(self, _: str) -> VehicleType:
        return CAR

    def vehicle_classes(self) -> Mapping[str, str]:
        return {"car": "passenger"}

    def lanes_ahead(self, _: str, lane: str) -> Sequence[str]:
        return [each for each in LANES if LANES[each] >= LANES[lane] and each[0] != ":"]

    def follows(self, vehicle: str, *_: float) -> bool:
        return vehicle in self._followers


def setup_of(
    model: Any, limit_mps: float = 10.0, counted_s: Any = (0.0, math.inf), **sections: Any
) -> Setup:
    """A simulation of 40 s with both crosswalks, in Euler's steps; vehicles are AVs."""
    bounds = zip(LANES, pairwise([*LANES.values(), 256.0]), strict=True)
    lanes = {n: Lane(n, ((a, 0.0), (b, 0.0)), b - a, limit_mps, 3.2) for n, (a, b) in bounds}
    ways, walks = {}, {}
    for name, (before, via, to) in WAYS.items():
        line, x = LineString(lanes[via].shape), CENTRES[name]
        way = Connection(before, (via,), to, "straight", False, line, limit_mps)
        areas = {name.replace("c0", "w0"): True, name.replace("c0", "w1"): False}
        axis = LineString([(x, -3.0), (x, 5.0)])
        walks[name] = Crosswalk(name, axis, 4.0, areas=areas, junction=[way])
        ways[before, to] = way
    simulated = {"file": "town.sumocfg", "crossings": [*CENTRES]}
    arms = {"av": "constant_speed", "human": "sumo_driver"}
    scene = validate({"simulation": simulated, "arms": arms, **sections}, "test")
    experiment = scene.experiment.model_copy(update={"step_s": STEP_S})
    scene = scene.model_copy(update={"experiment": experiment})
    config = SumoConfig(Path("town.sumocfg"), {"end": f"{STEPS * STEP_S}"})
    chosen = {name: walks[name] for name in scene.known_simulation.crossings}
    town = Town(walks, ways, lanes)
    return Setup(scene, model, config, town, chosen, scene.known_simulation, *counted_s)


def played(session: Scripted, model: Any, arm: Arm = Arm.AV, **of: Any) -> SimulatedArm:
    """An arm of pair 0, simulated to the end; ``of``: see ``setup_of``."""
    running = SimulatedArm(setup_of(model, **of), session, 0, arm)
    running.run()
    return running


def rows(arm: SimulatedArm, table: str) -> list[dict[str, Any]]:
    """The rows of one of its tables."""
    columns = tables_of(arm.setup, arm, ())[table]
    return [dict(zip(columns, each, strict=True)) for each in zip(*columns.values(), strict=True)]
