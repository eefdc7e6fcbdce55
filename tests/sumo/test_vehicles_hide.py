"""The second lane's car and whoever steps out before a stopped one, in hours and simulations."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from harness.core.encounter import (
    PEDESTRIAN_RADIUS_M,
    Arm,
    Arrival,
    Ending,
    Observation,
    PedestrianView,
    Side,
    Strategy,
)
from harness.core.seeding import stream
from harness.encounter.cell_constants import constants_of
from harness.encounter.simulation import pairing
from harness.encounter.simulation.demand import number_of
from harness.encounter.simulation.pairing import MeasuredPassage, SimulationOutcome
from harness.encounter.traffic.demand import Scheduled
from harness.encounter.traffic.hour import Hour
from harness.encounter.traffic.lanes import lanes_of
from harness.encounter.traffic.passages import Passage, passages_of
from harness.encounter.traffic.vehicles import LaneOnRoad
from harness.engine.shared import road_for
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario, validate
from harness.strategies.perception.sensor import sensor_of
from tests import towns

pytestmark = pytest.mark.usefixtures("no_simulation")

SPEED_MPS = 12.0
RUN_MPS = 2.5
EYE_M = 2.4
WIDTH_M = 1.8
STOP_M = -3.0
"""x of the stopped car's front: 1 m before a crosswalk of 4 m."""
STEP_S = 0.1


class Blocks:
    """Stops 1 m before the crosswalk and stays."""

    def decide(self, observation: Observation, /) -> float:
        ego = observation.ego
        left_m = ego.range_m + STOP_M
        return -(ego.speed_mps**2) / (2 * left_m) if left_m > 1e-3 else 0.0


class BrakesOnSight:
    """Brakes as hard as it can from the step in which anybody is shown on the crossing."""

    def __init__(self) -> None:
        self.seen: list[tuple[PedestrianView, ...]] = []

    def decide(self, observation: Observation, /) -> float:
        self.seen.append(observation.pedestrians)
        brakes = any(view.on_crossing for views in self.seen for view in views)
        return -observation.vehicle.max_deceleration_mps2 if brakes else 0.0

    @property
    def first(self) -> int:
        """The first step at which somebody on the crossing was shown."""
        return next(n for n, views in enumerate(self.seen) if any(v.on_crossing for v in views))


def sees_past(
    eye: tuple[float, float], corner: tuple[float, float], person: tuple[float, float]
) -> bool:
    """Whether the far edge of a person's disc is beyond the line of sight along a car's corner.

    The person comes from the side of the car; y counts from their kerb towards the eye's lane.
    """
    along = math.atan2(corner[1] - eye[1], corner[0] - eye[0])
    ahead_m, across_m = person[0] - eye[0], person[1] - eye[1]
    edge = math.atan2(across_m, ahead_m) + math.asin(
        PEDESTRIAN_RADIUS_M / math.hypot(ahead_m, across_m)
    )
    return edge > along


def hour_scene(obstacles: Sequence[dict[str, float]] = (), **perception: object) -> Scenario:
    road = {"length_m": 14.0, "width_m": 4.0, "lanes": 2, "oncoming_lanes": 2}
    return validate(
        {
            "crossing": {**road, "obstacles": list(obstacles)},
            "ego": {
                "initial_speed_mps": SPEED_MPS,
                "trigger_range_m": 60.0,
                "width_m": WIDTH_M,
                "length_m": 5.0,
                "max_deceleration_mps2": 4.5,
            },
            "pedestrians": {"flow_per_hour": 0.0, "kerb_wait_s": 0.0},
            "arms": {"av": "constant_speed", "human": "constant_speed"},
            "traffic": {"duration_s": 40.0, "warm_up_s": 0.0},
            "perception": perception,
        },
        "test",
    )


def hour_of(
    scenario: Scenario, people: Sequence[Arrival]
) -> tuple[BrakesOnSight, Passage, Passage]:
    """The second lane's driver, and the passages of the stopped car and of the second lane's.

    The car on the near lane is 8 s ahead.
    """
    driver = BrakesOnSight()
    blocking, passing = played(scenario, people, {0: (20, Blocks()), 1: (100, driver)})
    return driver, blocking, passing


def played(
    scenario: Scenario, people: Sequence[Arrival], cars: Mapping[int, tuple[int, Strategy]]
) -> list[Passage]:
    """The passages of an hour with one car on some lanes: the step of its entry, its driver."""
    rules = constants_of(scenario)
    lanes = []
    for number, lane in enumerate(lanes_of(scenario)):
        due = [Scheduled(number, lane, cars[number][0], 0.0)] if number in cars else []
        lanes.append(LaneOnRoad(number, lane, iter(due), rules))
    road = road_for(scenario)
    hour = Hour(
        road,
        lanes,
        tuple(people),
        lambda *_: RUN_MPS,
        lambda planned: (True, "", cars[planned.number][1]),
        rules,
        scenario.known_traffic,
        sensors={arm: sensor_of(scenario, arm) for arm in Arm},
    )
    log = hour.run()
    ends = {number: lane.ends_x_m for number, lane in enumerate(road.lanes)}
    return passages_of(log, rules, ends, saturated=False)


@pytest.fixture(scope="module")
def stepping_out() -> Arrival:
    """Somebody who steps out when the second lane's car, without them, is 21 m before the line."""
    _, _, passing = hour_of(hour_scene(), [])
    first = passing.vehicle.first_step
    assert first is not None
    steps = next(n for n, x_m in enumerate(passing.trace.x_m) if x_m >= -21.0)
    return Arrival(0, (first + steps) * STEP_S + 0.03, Side.NEAR, 0.5)


def test_the_closed_form_says_when_the_person_appears_in_an_hour(stepping_out: Arrival) -> None:
    driver, blocking, passing = hour_of(hour_scene(vehicles_hide=True), [stepping_out])
    assert blocking.trace.x_m[-1] == pytest.approx(STOP_M, abs=0.05)
    first = passing.vehicle.first_step
    assert first is not None
    begin_s = first * STEP_S
    corner = (float(blocking.trace.x_m[-1]), 1.75 + WIDTH_M / 2)
    # Undisturbed the car keeps 12 m/s; the person has run for t − T at 2.5 m/s.
    x_m = [float(passing.trace.x_m[0]) + SPEED_MPS * STEP_S * n for n in range(80)]
    expected = next(
        n
        for n, front_m in enumerate(x_m)
        if (ran_s := begin_s + n * STEP_S - stepping_out.arrival_s) > 0
        and sees_past((front_m - EYE_M, 5.25), corner, (0.0, RUN_MPS * ran_s))
    )
    assert driver.first == expected
    assert [bool(views) for views in passing.trace.shown or ()].index(True) == expected
    assert passing.record.ending is Ending.CRASHED
    # Without what hides them, the person is seen on stepping out, and the same car stops.
    sighted, _, stopped = hour_of(hour_scene(), [stepping_out])
    on_s = (stepping_out.arrival_s - begin_s) / STEP_S
    assert sighted.first == math.ceil(on_s)
    assert stopped.record.ending is not Ending.CRASHED
    # AVs that are told what other cars see.
    told, _, _ = hour_of(hour_scene(vehicles_hide=True, occlusion=False), [stepping_out])
    assert told.seen == sighted.seen


def test_what_an_hour_shows_is_exactly_that_old(stepping_out: Arrival) -> None:
    now, _, _ = hour_of(hour_scene(), [stepping_out])
    late, _, passing = hour_of(hour_scene(latency_s=0.5), [stepping_out])
    steps = now.first
    assert late.seen[:5] == [()] * 5
    assert late.seen[5 : steps + 5] == now.seen[:steps]
    assert late.first == steps + 5
    assert passing.trace.shown == tuple(late.seen)


def shown_from(driver: BrakesOnSight) -> int:
    """The first step at which anybody was shown."""
    return [bool(views) for views in driver.seen].index(True)


def test_when_a_vehicle_of_an_hour_detects_somebody_is_its_own_draw(stepping_out: Arrival) -> None:
    """N = ⌈ln(1 − u)/ln(1 − p)⌉ with u of (seed, "detection", pair, vehicle 1, person 0)."""
    now, _, _ = hour_of(hour_scene(), [stepping_out])
    late, _, _ = hour_of(hour_scene(detection_probability=0.2), [stepping_out])
    uniform = stream(1, "detection", 0, 1, 0).random()
    looks = math.ceil(math.log(1 - uniform) / math.log(0.8))
    assert looks > 1
    assert shown_from(late) == shown_from(now) + looks - 1


@pytest.mark.parametrize("lane", [0, 2])
def test_a_hedge_beside_the_road_hides_from_either_direction(lane: int) -> None:
    """The same scene from both ends of the road: lane 2 is the near lane of the other direction."""
    sign, side = (1.0, Side.NEAR) if lane == 0 else (-1.0, Side.FAR)
    hedge = {"x_m": -5.0 * sign, "y_m": 7.0 - 7.1 * sign, "length_m": 4.0, "width_m": 1.8}
    driver = BrakesOnSight()
    # The car enters before 60 m at 12 m/s; the person steps out when it is about 30 m away.
    (free,) = played(hour_scene(), [], {lane: (20, BrakesOnSight())})
    first = free.vehicle.first_step
    assert first is not None
    person = Arrival(0, (first + 25) * STEP_S + 0.03, side, 0.5)
    played(hour_scene([hedge]), [person], {lane: (20, driver)})
    expected = next(
        n
        for n in range(26, 60)
        if sees_past(
            (float(free.trace.x_m[n]) - EYE_M, 1.75),
            (-3.0, 0.8),
            (0.0, RUN_MPS * ((first + n) * STEP_S - person.arrival_s)),
        )
    )
    assert driver.first == expected > 26


def town(folder: Path, person_s: float) -> Path:
    """A road of two lanes each way, 30° from the axes; a lorry stops before the crosswalk."""
    folder.mkdir()
    along, across = math.cos(math.pi / 6), math.sin(math.pi / 6)
    nodes = "".join(
        f'<node id="{name}" x="{at * along}" y="{at * across}" type="priority"/>'
        for name, at in (("w", 0), ("m", 200), ("e", 400))
    )
    edges = "".join(
        f'<edge id="{a}_{b}" from="{a}" to="{b}" numLanes="2" speed="13.89" sidewalkWidth="2"/>'
        for a, b in (("w", "m"), ("m", "w"), ("m", "e"), ("e", "m"))
    )
    (folder / "n.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (folder / "e.edg.xml").write_text(f"<edges>{edges}</edges>")
    (folder / "c.con.xml").write_text(
        '<connections><crossing node="m" edges="w_m m_w" priority="true" width="4"/></connections>'
    )
    files = ("-n", "n.nod.xml", "-e", "e.edg.xml", "-x", "c.con.xml", "-o", "net.net.xml")
    towns.call(folder, "netconvert", *files, "--no-turnarounds")
    (folder / "demand.rou.xml").write_text(
        f"""<routes>
        <vType id="lorry" vClass="truck" length="8" width="2.4" sigma="0"/>
        <vType id="car" vClass="passenger" length="5" width="{WIDTH_M}" sigma="0" speedDev="0"
          maxSpeed="{SPEED_MPS}" decel="4.5" emergencyDecel="4.5"/>
        <vType id="runner" vClass="pedestrian" speedDev="0" maxSpeed="{RUN_MPS}" sigma="0"/>
        <vehicle id="A" type="lorry" depart="0" departPos="120" departLane="1" departSpeed="5">
          <route edges="w_m m_e"/><stop lane="w_m_1" endPos="-1" duration="900"/></vehicle>
        <vehicle id="B" type="car" depart="20" departPos="20" departLane="2" departSpeed="12">
          <route edges="w_m m_e"/></vehicle>
        <person id="P" type="runner" depart="{person_s}" departPos="180">
          <walk edges="w_m m_w" arrivalPos="10"/></person></routes>"""
    )
    options = {"net-file": "net.net.xml", "route-files": "demand.rou.xml", "end": "60"}
    still = {"pedestrian.striping.dawdling": "0", "time-to-teleport": "-1", "step-length": "0.1"}
    return towns.write_config(folder, options | still | towns.COLLISIONS)


def simulated(
    folder: Path, model: InteractionModel, monkeypatch: pytest.MonkeyPatch, **settings: object
) -> tuple[BrakesOnSight, MeasuredPassage, SimulationOutcome]:
    driver = BrakesOnSight()
    monkeypatch.setattr(pairing, "make_strategy", lambda *_: driver)
    keys = {f"perception__{key}": value for key, value in settings.items()}
    scenario = towns.scenario_of(town(folder, 25.0), [":m_c0"], ego__trigger_range_m=60.0, **keys)
    outcome = towns.run_arm(scenario, model, folder / "arm")
    (passage,) = (each for each in outcome.passages if each.log.name == "B")
    return driver, passage, outcome


def test_the_closed_form_says_when_the_person_appears_in_a_simulation(
    model: InteractionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver, passage, outcome = simulated(tmp_path / "a", model, monkeypatch, vehicles_hide=True)
    (blocking,) = (each for each in outcome.passages if each.log.name == "A")
    way, (person,) = passage.log.driven_way.way, outcome.log.people[":m_c0"]
    near_m = blocking.trace.crossing.lane_centre_m + 2.4 / 2
    corner = (float(blocking.trace.x_m[-1]), near_m)
    eye_y_m = passage.trace.crossing.lane_centre_m
    x_m, y_m = way.frame.to_road(person.x_m, person.y_m)
    places = {round(time, 3): n for n, time in enumerate(person.time_s.tolist())}

    def appears(step: int) -> bool:
        number = places.get(round(passage.log.time_s[0] + step * STEP_S, 3))
        if number is None or not person.on_crossing[number]:
            return False
        eye = (float(passage.trace.x_m[step]) - EYE_M, eye_y_m)
        return sees_past(eye, corner, (float(x_m[number]), float(y_m[number])))

    assert driver.first == next(n for n in range(len(passage.trace.x_m)) if appears(n))
    assert passage.record.ending is Ending.CRASHED
    # Without what hides them, the same car stops.
    sighted, stopped, _ = simulated(tmp_path / "b", model, monkeypatch)
    assert sighted.first < driver.first - 5
    assert stopped.record.ending is not Ending.CRASHED


def test_what_a_simulation_shows_is_exactly_that_old(
    model: InteractionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, _, _ = simulated(tmp_path / "a", model, monkeypatch)
    late, passage, _ = simulated(tmp_path / "b", model, monkeypatch, latency_s=0.5)
    # Both drive alike until the first of them brakes.
    steps = now.first
    assert late.seen[:5] == [()] * 5
    assert late.seen[5 : steps + 5] == now.seen[:steps]
    assert late.first == steps + 5
    # The trace names people by the numbers of its walks.
    (walk,) = passage.trace.walks
    assert {view.index for views in passage.trace.shown or () for view in views} == {
        walk.arrival.index
    }


def test_when_a_vehicle_of_a_simulation_detects_somebody_is_its_own_draw(
    model: InteractionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the ids of vehicle, crosswalk and person, so that the order of events does not matter."""
    now, _, _ = simulated(tmp_path / "a", model, monkeypatch)
    late, _, _ = simulated(tmp_path / "b", model, monkeypatch, detection_probability=0.05)
    keys = [number_of(name) for name in ("B", ":m_c0", "P")]
    uniform = stream(1, "detection", 0, *keys).random()
    looks = math.ceil(math.log(1 - uniform) / math.log(0.95))
    assert looks > 1
    assert shown_from(late) == shown_from(now) + looks - 1
