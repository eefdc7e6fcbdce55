"""Hours of traffic in SUMO: against the encounter, by hand, and what must always hold."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from harness.core.encounter import Arm, Arrival, Side
from harness.encounter.arms import make_strategy
from harness.encounter.cell_constants import constants_of
from harness.encounter.loop import run_episode
from harness.encounter.traffic.demand import Scheduled, scheduled_vehicles
from harness.encounter.traffic.hour import Hour
from harness.encounter.traffic.lanes import lanes_of
from harness.encounter.traffic.pairing import HourOutcome, HourRunner
from harness.encounter.traffic.passages import Passage, passages_of
from harness.encounter.traffic.vehicles import HourLog, LaneOnRoad
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.engine.shared import engine_for, road_for
from harness.measures import measure
from harness.model.interaction import load_model
from harness.old.store.hour_columns import HourColumns, hour_columns
from harness.old.store.hour_tables import hour_rows
from harness.scenario import PedestriansSection, Scenario, Setting, load_scenario, validate
from tests.closed_forms import gap_wait_s, priority_capacity_per_s

MODEL = load_model("dut", None)
pytestmark = pytest.mark.usefixtures("no_simulation")


def scenario_of(traffic: Mapping[str, Any], **sections: Any) -> Scenario:
    tree: dict[str, Any] = {
        "arms": {"av": "gap_yield", "human": "constant_speed"},
        "pedestrians": {"flow_per_hour": 0.0, "kerb_wait_s": 0.0},
        "traffic": {"duration_s": 60.0, "warm_up_s": 0.0, **traffic},
    }
    for section, values in sections.items():
        tree[section] = {**tree.get(section, {}), **values}
    return validate(tree, "test")


def driven_by(strategy: str, scenario: Scenario) -> Scenario:
    """The scenario with another driver in the AV's arm."""
    arms = scenario.arms.model_copy(update={"av": strategy})
    return scenario.model_copy(update={"arms": arms})


def hour_of(
    scenario: Scenario,
    steps: Sequence[Sequence[int]] | None,
    arrivals: Sequence[Arrival] = (),
    strategy: str | None = None,
    walking_mps: float | None = None,
) -> tuple[Hour, HourLog, list[Passage]]:
    """An hour with vehicles due at those steps of each lane, or as planned, and those people."""
    name = strategy or scenario.arms.av
    driven = driven_by(name, scenario)
    rules = constants_of(scenario)
    roads = lanes_of(scenario)
    lanes = []
    for number, lane in enumerate(roads):
        due = scheduled_vehicles(scenario, 0, lane)
        if steps is not None:
            numbers = range(number, len(roads) * len(steps[number]) + number, len(roads))
            pairs = zip(numbers, steps[number], strict=True)
            due = iter([Scheduled(own, lane, step, 0.0) for own, step in pairs])
        lanes.append(LaneOnRoad(number, lane, due, rules))
    choose: Any = (lambda *_: walking_mps) if walking_mps else WalkingSpeeds(scenario, MODEL)
    road = road_for(scenario)
    assert scenario.traffic is not None
    hour = Hour(
        road,
        lanes,
        tuple(arrivals),
        choose,
        lambda planned: (True, name, make_strategy(driven, Arm.AV, 0, MODEL, planned.number)),
        rules,
        scenario.traffic,
    )
    log = hour.run()
    ends = {number: lane.ends_x_m for number, lane in enumerate(road.lanes)}
    return hour, log, passages_of(log, rules, ends, scenario.traffic.saturated)


ALONE = ("constant_speed", "gap_yield", "hard_yield", "soft_yield", "human_gmm")


@pytest.mark.parametrize("people", [0, 3, 5])
@pytest.mark.parametrize("strategy", [*ALONE, "emergency_brake"])
def test_one_vehicle_is_the_single_ego(strategy: str, people: int) -> None:
    """People decide before it as before the ego, with the default rule at the kerb, or by gaps."""
    within = 1e-6
    waits = {"kerb_wait_s": PedestriansSection().kerb_wait_s}
    scenario = scenario_of({"duration_s": 120.0}, pedestrians=waits)
    _, _, empty = hour_of(scenario, [[100], []], strategy="constant_speed")
    begins = empty[0].vehicle.first_step
    assert begins is not None
    rng = np.random.default_rng(people)
    times = np.sort(rng.uniform(0.0, 8.0, people)).tolist()
    gaps_s = [None, 3.0, 6.0]
    own = tuple(
        Arrival(i, time, [Side.NEAR, Side.FAR][i % 2], float(rng.random()), gaps_s[i % 3])
        for i, time in enumerate(times)
    )
    later = tuple(person._replace(arrival_s=person.arrival_s + begins * 0.1) for person in own)
    _, _, (passage,) = hour_of(scenario, [[100], []], later, strategy)
    rules = constants_of(scenario)
    driver = make_strategy(driven_by(strategy, scenario), Arm.AV, 0, MODEL)
    speeds = WalkingSpeeds(scenario, MODEL)
    trace = run_episode(engine_for(scenario), driver, own, speeds, rules)
    (record,) = measure([trace])
    np.testing.assert_allclose(passage.trace.x_m, trace.x_m, atol=within)
    np.testing.assert_allclose(passage.trace.speed_mps, trace.speed_mps, atol=within)
    assert passage.record.ending == record.ending
    assert passage.record.pedestrians == record.pedestrians
    for mine, theirs in zip(passage.record.values, record.values, strict=True):
        if theirs is None or mine is None:
            assert mine is theirs
        else:
            assert mine == pytest.approx(theirs, abs=within)
    if record.delay_s is not None:
        assert passage.delay_s == pytest.approx(record.delay_s, abs=within)


@pytest.mark.parametrize("side", list(Side))
def test_oncoming_is_the_ego_turned_round(side: Side) -> None:
    """The same person, named from the other kerb, before a vehicle from the other side."""
    strategy = "gap_yield"
    scenario = scenario_of({"duration_s": 120.0})
    begins = 10.0 + 270 / 5.0
    other = side.other
    people = [Arrival(0, begins + 3.0, side, 0.4)]
    turned = [people[0]._replace(side=other)]
    _, _, (forward,) = hour_of(scenario, [[100], []], people, strategy)
    _, _, (oncoming,) = hour_of(scenario, [[], [100]], turned, strategy)
    assert forward.record.pedestrians == 1
    assert forward.delay_s is not None
    assert forward.delay_s > 0.1
    assert oncoming.record.ending is forward.record.ending
    assert oncoming.delay_s == pytest.approx(forward.delay_s, abs=1e-6)
    np.testing.assert_allclose(oncoming.trace.x_m, forward.trace.x_m, atol=1e-6)
    np.testing.assert_allclose(oncoming.record.values[0], forward.record.values[0], atol=1e-6)
    walks = [passage.trace.walks[0] for passage in (forward, oncoming)]
    assert walks[0].arrival.side is walks[1].arrival.side is side


def run_pair(scenario: Scenario, pair: int = 0) -> dict[Arm, HourOutcome]:
    """Both arms' outcomes of a pair."""
    runner = HourRunner(scenario, MODEL, lambda: road_for(scenario))
    return {outcome.arm: outcome for outcome in runner.run([pair])}


def busy(**traffic: Any) -> dict[str, Any]:
    flows = {"flow_per_hour": 500.0, "oncoming_per_hour": 500.0}
    return {**flows, "duration_s": 180.0, "warm_up_s": 60.0, **traffic}


def test_shares_0_and_1_and_the_reference_are_what_they_should_be() -> None:
    """No AVs: both arms are one. A greater share only adds AVs. The reference never changes."""
    people = {"flow_per_hour": 600.0, "kerb_wait_s": 2.0}
    rows, automated = {}, {}
    for share in (0.0, 0.4, 1.0):
        scenario = scenario_of(
            busy(av_share=share, flow_per_hour=400.0, oncoming_per_hour=300.0, duration_s=60.0),
            pedestrians=people,
            arms={"av": "gap_yield", "human": "human_yield"},
        )
        passages = hour_rows(0, run_pair(scenario).values())["passages"].to_pylist()
        rows[share] = {
            arm.value: [row | {"arm": None} for row in passages if row["arm"] == arm] for arm in Arm
        }
        av = rows[share]["av"]
        automated[share] = {row["vehicle"] for row in av if row["strategy"] == "gap_yield"}
    assert rows[0.0]["av"] == rows[0.0]["human"]
    assert rows[0.0]["human"] == rows[0.4]["human"] == rows[1.0]["human"]
    assert automated[0.0] == set()
    assert 0 < len(automated[0.4]) < len(automated[1.0]) == len(rows[1.0]["av"])
    assert automated[0.4] < automated[1.0]


def test_people_drive_alike_in_a_mixed_fleet_and_in_the_reference(monkeypatch) -> None:
    made: dict[int, list[bool]] = {}

    def watched(scenario: Scenario, driver: Arm, *key: Any) -> Any:
        strategy = make_strategy(scenario, driver, *key)
        if driver is Arm.HUMAN:
            made.setdefault(key[-1], []).append(strategy._yields)  # type: ignore[attr-defined]
        return strategy

    monkeypatch.setattr("harness.encounter.traffic.pairing.make_strategy", watched)
    arms = {"av": "human_gmm", "human": "human_yield"}
    run_pair(scenario_of(busy(av_share=0.5, duration_s=60.0), arms=arms))
    twice = [draws for draws in made.values() if len(draws) == 2]
    assert len(twice) > 5
    assert all(one is other for one, other in twice)
    assert {one for one, _ in twice} == {True, False}


def followers(outcome: HourOutcome) -> float:
    """The smallest gap between two vehicles of a lane over all their recorded states."""
    least = math.inf
    length = outcome.scenario.ego.length_m
    by_lane: dict[str, list[Passage]] = {}
    for passage in outcome.passages:
        by_lane.setdefault(passage.vehicle.plan.lane.name, []).append(passage)
    for passages in by_lane.values():
        ordered = sorted(passages, key=lambda passage: passage.vehicle.plan.number)
        for ahead, behind in pairwise(ordered):
            if ahead.vehicle.first_step is None or behind.vehicle.first_step is None:
                continue
            begin = behind.vehicle.first_step - ahead.vehicle.first_step
            count = min(len(ahead.trace.x_m) - begin, len(behind.trace.x_m))
            if count > 0:
                front = ahead.trace.x_m[begin : begin + count] - length
                least = min(least, float((front - behind.trace.x_m[:count]).min()))
    return least


def test_the_road_is_empty_after_an_hour() -> None:
    scenario = scenario_of(busy(), pedestrians={"flow_per_hour": 600.0, "kerb_wait_s": 2.0})
    for passage in run_pair(scenario)[Arm.AV].passages:
        assert passage.passed_s is not None
        assert passage.vehicle.gone_step is not None
    api = road_for(scenario)._api
    assert api.vehicle.getIDList() == api.person.getIDList() == ()


def test_free_vehicles_are_not_late_and_a_minute_without_warm_up_is_not_saturated() -> None:
    """The road of field_sites fills in it: by vehicles on their way, of whom nobody is late."""
    minute = [Setting("traffic.duration_s", 60.0), Setting("traffic.warm_up_s", 0.0)]
    columns = columns_of(load_scenario("field_sites", minute), 3)
    for arm in (0, 1):
        assert not columns.saturated(arm)
        assert columns.growth(arm).share == 0.0
        assert columns.los_vehicles(arm) == "A"
    # Nobody comes: every delay is 0 by definition, whatever sums of hundreds of steps end in.
    scenario = scenario_of({"duration_s": 120.0})
    _, _, passages = hour_of(scenario, [[100, 350], [7]], strategy="constant_speed")
    assert [passage.delay_s for passage in passages] == [0.0, 0.0, 0.0]


def test_vehicles_that_find_the_road_full_are_in_the_queue() -> None:
    """Somebody takes 225 s to cross; 60 cars come within 60 s, and need 7 m each."""
    scenario = scenario_of({"duration_s": 240.0})
    person, come = Arrival(0, 5.0, Side.NEAR, 0.5, None), [[*range(0, 600, 10)], []]
    _, log, passages = hour_of(scenario, come, [person], "hard_yield", walking_mps=0.04)
    assert -passages[0].vehicle.insert_x_m < 60 * 7.0
    assert max(queued for queued, _ in log.queues) == 60


@pytest.mark.parametrize(
    ("flow", "saturated"), [(120.0, False), pytest.param(600.0, True, marks=pytest.mark.slow)]
)
def test_ten_minutes_below_and_beyond_capacity(flow: float, saturated: bool) -> None:
    """Hard-Yield at 750 people per hour lets some 190 vehicles per hour and lane through.

    (docs/traffic.md: 368 in both, kerb wait 0.)
    """
    scenario = scenario_of(
        busy(flow_per_hour=flow, oncoming_per_hour=flow, duration_s=600.0),
        pedestrians={"flow_per_hour": 750.0},
        arms={"av": "hard_yield", "human": "hard_yield"},
        ego={"initial_speed_mps": 8.0},
    )
    columns = columns_of(scenario, 1)
    assert [columns.saturated(arm) for arm in (0, 1)] == [saturated] * 2


def columns_of(scenario: Scenario, hours: int) -> HourColumns:
    """The columns of both arms of so many hours."""
    outcomes = HourRunner(scenario, MODEL, lambda: road_for(scenario)).run(range(hours))
    return hour_columns(hour_rows(0, outcomes)["hours"], scenario, 0.95)


@pytest.mark.slow
def test_waits_are_the_integral_over_the_blocked_times() -> None:
    """Drivers who ignore waiting people: mean wait = Σ blocked²/2 / time, at any flow.

    A vehicle blocks from kerb_wait before its front is at the near edge until its rear has left
    the far one; who waits goes at the next step's beginning.
    """
    wait_s, step_s, speed = 2.0, 0.1, 8.0
    scenario = scenario_of(
        busy(duration_s=600.0),
        ego={"initial_speed_mps": speed},
        pedestrians={"flow_per_hour": 2000.0, "kerb_wait_s": wait_s},
        arms={"av": "constant_speed"},
    )
    outcome = run_pair(scenario)[Arm.HUMAN]
    half = scenario.crossing.width_m / 2
    spans = []
    for passage in outcome.passages:
        first = passage.vehicle.first_step
        assert first is not None
        edge_s = first * step_s + (-half - passage.trace.x_m[0]) / speed
        rear_s = edge_s + (scenario.crossing.width_m + scenario.ego.length_m) / speed
        spans.append((edge_s - wait_s, math.ceil(rear_s / step_s - 1e-6) * step_s))
    merged: list[list[float]] = []
    for begin, end in sorted(spans):
        if merged and begin <= merged[-1][1]:
            merged[-1][1] = max(merged[-1][1], end)
        else:
            merged.append([begin, end])
    total = 600.0
    inside = [(max(b, 60.0), min(e, 60.0 + total)) for b, e in merged]
    lengths = np.array([end - begin for begin, end in inside if end > begin])
    expected = float((lengths**2).sum()) / 2 / total
    waits = [
        walk.start_s - walk.arrival.arrival_s
        for walk in outcome.log.walks
        if walk.start_s is not None and 60.0 <= walk.arrival.arrival_s < 60.0 + total
    ]
    error = float(np.std(waits)) / math.sqrt(len(waits))
    assert len(waits) > 280
    assert abs(float(np.mean(waits)) - expected) < 3 * error


@pytest.mark.slow
def test_capacity_under_absolute_priority() -> None:
    """λ e^{−λτ} Σ_k e^{−λ d_k} of a saturated lane, τ and d_k from a queue let go once, by itself.

    Hard-Yield waits for everyone on the crossing; with kerb wait 0 it never keeps anybody waiting
    long. τ is how long one person blocks it; d_k when the k-th queued vehicle commits itself.
    """
    scenario = scenario_of(
        {"duration_s": 2400.0, "warm_up_s": 60.0, "saturated": True},
        ego={"initial_speed_mps": 8.0},
        crossing={"oncoming_lanes": 0, "length_m": 4.5},
        pedestrians={"flow_per_hour": 0.0, "kerb_wait_s": 0.0},
        arms={"av": "hard_yield"},
    )
    choose_s = 4.5 / 1.2
    # One long stop, then the queue goes: a platoon of people who follow each other closely.
    platoon = [Arrival(i, 100.0 + 2.0 * i, Side.NEAR, 0.5) for i in range(30)]
    _, log, _ = hour_of(scenario, None, platoon, walking_mps=1.2)
    free_s = platoon[-1].arrival_s + choose_s
    # A vehicle is committed once it can no longer stop before somebody who steps off: its front is
    # within v²/2b of the crosswalk's near edge.
    commits = []
    for moving in log.vehicles:
        if moving.first_step is None:
            continue
        for number, (x, v) in enumerate(zip(moving.xs, moving.speeds, strict=True)):
            if -x - 0.25 < v**2 / (2 * 4.5) or x > -2.0:
                commits.append((moving.first_step + number) * 0.1)
                break
    after = np.array(sorted(time for time in commits if time >= free_s)) - free_s
    rate = 400.0 / 3600.0
    expected = 3600 * priority_capacity_per_s(rate, choose_s, after[:400].tolist())
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.exponential(1 / rate, 600))
    people = [Arrival(i, float(t), Side.NEAR, 0.5) for i, t in enumerate(times) if t < 2500]
    _, log, _ = hour_of(scenario, None, people, walking_mps=1.2)
    passed = [m.first_step + len(m.xs) - 1 for m in log.vehicles if m.passed and m.first_step]
    seen = sum(600 <= step < 24600 for step in passed) / 2400 * 3600
    assert seen == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("crossing", "steps", "goes_s"),
    [
        ({"oncoming_lanes": 0}, [[100]], 71.4),
        ({"lanes": 2, "oncoming_lanes": 0}, [[100], [120]], 73.4),
        ({}, [[100], [125]], 73.9),
    ],
)
def test_waiting_worked_out_by_hand(
    crossing: dict[str, int], steps: list[list[int]], goes_s: float
) -> None:
    """At 5 m/s from 300 m: due at step 100, the front is at the near edge at 10 + 298/5 = 69.6 s.

    The rear leaves the far edge at 10 + 307/5 = 71.4 s, so with a kerb wait of 2 s this vehicle
    blocks from 67.6 s to 71.4 s; one due 2 s later, in another lane, to 73.4 s, and one that comes
    the other way 2.5 s later to 73.9 s.
    """
    scenario = scenario_of(
        {"duration_s": 90.0, "flow_per_hour": 0.0, "oncoming_per_hour": 0.0},
        crossing=crossing,
        pedestrians={"kerb_wait_s": 2.0},
    )
    people = [Arrival(0, 67.5, Side.NEAR, 0.5), Arrival(1, 67.7, Side.FAR, 0.5)]
    _, log, _ = hour_of(scenario, steps, people, "constant_speed")
    first_s, second_s = (walk.start_s for walk in log.walks)
    assert (first_s, second_s) == (67.5, pytest.approx(goes_s, abs=1e-9))
    assert log.let_go == {1: False}


STRATEGIES = ["hard_yield", "gap_yield", "human_yield", "soft_yield"]


def random_hour(seed: int, duration_s: float) -> HourOutcome:
    """The AV's arm under random flows, lanes, speeds, strategies and car following."""
    rng = np.random.default_rng(seed)
    lanes = int(rng.integers(1, 3))
    flow, oncoming = (float(rng.uniform(0, 700) * count) for count in (lanes, 1))
    flows = {"flow_per_hour": flow, "oncoming_per_hour": oncoming}
    scenario = scenario_of(
        busy(**flows, following=["Krauss", "IDM"][seed % 2], duration_s=duration_s),
        crossing={"lanes": lanes, "length_m": 4.5 * (lanes + 1)},
        ego={"initial_speed_mps": float(rng.uniform(4, 12)), "trigger_range_m": 60.0},
        model={"extrapolate": True},
        pedestrians={"flow_per_hour": float(rng.uniform(0, 900)), "kerb_wait_s": 2.0},
        arms={"av": STRATEGIES[seed % 4]},
        experiment={"seed": seed},
    )
    return HourRunner(scenario, MODEL, lambda: road_for(scenario), paths=True).run_arm(0, Arm.AV)


def check_everybody(outcome: HourOutcome) -> None:
    """Every vehicle due is there once; none jumps, none comes nearer than minGap less 0.2 m."""
    assert outcome.reason is None
    scenario = outcome.scenario
    assert scenario.traffic is not None
    planned = [of for lane in lanes_of(scenario) for of in scheduled_vehicles(scenario, 0, lane)]
    numbers = sorted(passage.vehicle.plan.number for passage in outcome.passages)
    assert numbers == sorted(of.number for of in planned)
    assert followers(outcome) > 2.0 - 0.2
    places: dict[tuple[str, int], list[float]] = {}
    for passage in outcome.passages:
        moving, ways = passage.vehicle, dict[int, float]()
        ways.update((step, x) for step, x, _ in moving.path)
        first = moving.first_step or 0
        ways.update((first + number, x) for number, x in enumerate(moving.xs))
        steps = np.array(sorted(ways))
        x = np.array([ways[step] for step in steps])
        speeds = np.diff(x) / (np.diff(steps) * 0.1)
        assert speeds.min(initial=0.0) > -1e-6
        assert speeds.max(initial=0.0) < scenario.ego.initial_speed_mps + 1e-6
        gone = moving.gone_step is not None
        assert gone == (passage.passed_s is not None and passage.control_delay_s is not None)
        for step, place in ways.items():
            if step % 10 == 0:
                places.setdefault((moving.plan.lane.name, step), []).append(place)
    assert len(places) > scenario.traffic.duration_s / 10
    for row in places.values():
        assert np.diff(np.sort(row)).min(initial=math.inf) > scenario.ego.length_m + 2.0 - 0.2


HUNDRED = [pytest.param(seed, 3600.0, marks=pytest.mark.slow) for seed in range(1000, 1100)]


@pytest.mark.parametrize(("seed", "duration_s"), [*((seed, 150.0) for seed in range(5)), *HUNDRED])
def test_random_demand_loses_nobody(seed: int, duration_s: float) -> None:
    """Some minutes of each strategy, both kinds of car following, one lane and two."""
    check_everybody(random_hour(seed, duration_s))


@pytest.mark.slow
def test_waits_at_low_flow_are_adams() -> None:
    """(e^{vt} − vt − 1)/v before drivers who ignore people: 120 vehicles per hour in two lanes.

    t is the kerb wait and (width + length)/speed, and half a step, since who waits goes at the
    next step's beginning.  That headways of a lane are at least 1.9 s makes less than 1 % here.
    """
    wait_s, speed = 2.0, 8.0
    scenario = scenario_of(
        busy(flow_per_hour=60.0, oncoming_per_hour=60.0, duration_s=8 * 3600.0),
        ego={"initial_speed_mps": speed},
        pedestrians={"flow_per_hour": 1500.0, "kerb_wait_s": wait_s},
        arms={"av": "constant_speed"},
    )
    outcome = HourRunner(scenario, MODEL, lambda: road_for(scenario)).run_arm(0, Arm.AV)
    walks = [walk for walk in outcome.log.walks if walk.start_s is not None]
    arrivals = np.array([walk.arrival.arrival_s for walk in walks])
    waits = np.array([walk.start_s for walk in walks], dtype=float) - arrivals
    parts = np.array([waits[arrivals // 600.0 == part].mean() for part in range(48)])
    blocked_s = wait_s + (scenario.crossing.width_m + scenario.ego.length_m) / speed + 0.05
    expected = gap_wait_s(120 / 3600, blocked_s)
    error = float(parts.std(ddof=1)) / math.sqrt(len(parts))
    assert error < 0.1 * expected
    assert abs(float(parts.mean()) - expected) < 3 * error


@pytest.mark.slow
def test_delay_of_a_lone_vehicle_under_absolute_priority() -> None:
    """(e^{λτ} − λτ − 1)/λ where nobody needs time to speed up: all accelerations are 20 m/s²."""
    walking, rate = 0.6, 1000.0
    limits = ("max_acceleration_mps2", "max_deceleration_mps2", "resume_acceleration_mps2")
    scenario = scenario_of(
        busy(flow_per_hour=20.0, oncoming_per_hour=0.0, duration_s=40_000.0, warm_up_s=100.0),
        crossing={"oncoming_lanes": 0, "length_m": 4.5},
        ego={"initial_speed_mps": 3.0, "detection_range_m": 3.6} | dict.fromkeys(limits, 20.0),
        pedestrians={
            **{"flow_per_hour": rate, "kerb_wait_s": 0.0},
            "walking_speed": {"mean_mps": walking, "std_mps": 1e-6},
        },
        arms={"av": "hard_yield"},
    )
    passages = run_pair(scenario)[Arm.AV].passages
    delays = np.array([passage.delay_s for passage in passages if passage.delay_s is not None])
    # Alone: nobody waits behind another one.
    expected = gap_wait_s(rate / 3600, 4.5 / walking)
    error = float(delays.std()) / math.sqrt(len(delays))
    assert abs(float(delays.mean()) - expected) < 0.03 * expected + 3 * error
