"""The vehicle mix of hours of traffic: shares, draws, headways, capacity, bad input."""

import math
from collections import deque
from itertools import islice, pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from harness.core.errors import InputError
from harness.encounter.cell_constants import constants_of
from harness.encounter.traffic.demand import Scheduled, scheduled_vehicle, scheduled_vehicles
from harness.encounter.traffic.entrance import Entrance
from harness.encounter.traffic.lanes import lanes_of
from harness.engine.shared import following_of
from harness.engine.starting import vehicle_types
from harness.scenario import Scenario, validate

CAR = {"name": "car", "share": 0.75}
TRUCK = {
    "name": "truck",
    "share": 0.25,
    "length_m": 16.5,
    "width_m": 2.55,
    "max_deceleration_mps2": 3.0,
    "resume_acceleration_mps2": 0.5,
}


def scenario_of(*types: dict[str, Any], **traffic: Any) -> Scenario:
    tree = {
        "ego": {"initial_speed_mps": 8.0},
        "traffic": {"types": list(types), "duration_s": 3600.0, "warm_up_s": 0.0, **traffic},
    }
    return validate(tree, "mix.toml")


def vehicles_of(scenario: Scenario, pair: int = 0, lane: int = 0) -> list[Scheduled]:
    return list(scheduled_vehicles(scenario, pair, lanes_of(scenario)[lane]))


def test_a_type_has_the_values_of_ego_where_it_gives_none() -> None:
    car, truck = scenario_of(CAR, TRUCK).vehicles()
    assert car == scenario_of().vehicle() == scenario_of().vehicles()[0]
    assert (truck.length_m, truck.width_m, truck.max_deceleration_mps2) == (16.5, 2.55, 3.0)
    assert (truck.max_acceleration_mps2, truck.initial_speed_mps) == (3.0, 8.0)


def test_headways_by_hand() -> None:
    """1 s + (5 + 2)/8 s = 1.875 s behind a car; a truck brakes at 3, a car at 4.5 m/s².

    So a truck keeps 8²/2 (1/3 − 1/4.5) m more behind a car, 0.4444 s at 8 m/s.
    """
    scenario = scenario_of(CAR, TRUCK)
    car, truck = scenario.vehicles()
    exact = {
        (car, car): 1.875,
        (truck, car): 1 + 18.5 / 8,
        (truck, truck): 1 + 18.5 / 8,
        (car, truck): 1.875 + 4 * (1 / 3 - 1 / 4.5),
    }
    steps = {pair: math.ceil(10 * exact_s) for pair, exact_s in exact.items()}
    for (leader, follower), expected in steps.items():
        assert scenario.headway_s(leader, follower) == pytest.approx(expected / 10)
    mean = (0.75**2 * steps[car, car] + 0.25 * steps[truck, car]) / 10
    mean += 0.75 * 0.25 * steps[car, truck] / 10
    assert scenario.least_headway_s() == pytest.approx(mean)
    assert scenario_of().least_headway_s() == pytest.approx(1.9)


def test_drawn_types_have_their_shares_and_leave_every_other_draw_as_it_was() -> None:
    """The number of trucks is binomial: within 4 standard deviations of a quarter."""
    scenario = scenario_of(CAR, TRUCK, saturated=True)
    lane = lanes_of(scenario)[0]
    mixed, same = (
        list(islice(scheduled_vehicles(each, 3, lane), 4000))
        for each in (scenario, scenario_of(saturated=True))
    )
    trucks = sum(vehicle.kind for vehicle in mixed)
    assert abs(trucks - 1000) < 4 * math.sqrt(4000 * 0.25 * 0.75)
    assert [v.uniform for v in mixed] == [v.uniform for v in same]
    assert {v.kind for v in same} == {0}
    others = [v.kind for v in islice(scheduled_vehicles(scenario, 4, lane), 4000)]
    assert others != [v.kind for v in mixed]
    assert [v.kind for v in islice(scheduled_vehicles(scenario, 3, lane), 4000)] == [
        v.kind for v in mixed
    ]


def test_the_mean_headway_is_that_of_the_flow_and_none_is_shorter_than_the_least() -> None:
    """3,600 s at 900 vehicles per hour; the least headways of the mix take 2.2 of each 4 s."""
    scenario = scenario_of(CAR, TRUCK, flow_per_hour=900.0)
    hours = [vehicles_of(scenario, pair) for pair in range(20)]
    counts = np.array([len(vehicles) for vehicles in hours])
    # Without least headways the count would be Poisson; with them it varies less.
    assert abs(counts.mean() - 900) < 4 * math.sqrt(900 / 20)
    types = scenario.vehicles()
    for vehicles in hours[:3]:
        for leader, follower in pairwise(vehicles):
            least_s = scenario.headway_s(types[leader.kind], types[follower.kind])
            assert (follower.step - leader.step) * 0.1 >= least_s - 1e-9


def test_types_that_are_no_avs_are_none_at_any_share() -> None:
    scenario = scenario_of(CAR, TRUCK | {"automated": False}, av_share=0.4)
    vehicles = vehicles_of(scenario)
    assert {v.uniform for v in vehicles if v.kind == 1} == {1.0}
    plain = vehicles_of(scenario_of(CAR, TRUCK))
    assert [v.uniform for v in plain if v.kind == 0] == [v.uniform for v in vehicles if v.kind == 0]
    assert scenario.known_traffic.share_of_avs == pytest.approx(0.4 * 0.75)
    assert scenario_of(CAR, TRUCK, av_share=0.4).known_traffic.share_of_avs == 0.4


def test_a_vehicle_is_known_by_its_number() -> None:
    scenario = scenario_of(CAR, TRUCK)
    for planned in (vehicles_of(scenario, 2)[17], vehicles_of(scenario, 2, 1)[5]):
        assert scheduled_vehicle(scenario, 2, planned.number) == planned


def test_sumo_has_two_types_for_each() -> None:
    scenario = scenario_of(CAR, TRUCK)
    written = vehicle_types(scenario.vehicle(), 8.0, following_of(scenario))
    for name in ("vehicle_car", "av_car", "vehicle_truck", "av_truck"):
        assert f'id="{name}"' in written
    (truck,) = (part for part in written.split("<vType") if 'id="vehicle_truck"' in part)
    for attribute in ('length="16.5"', 'accel="0.5"', 'decel="3.0"'):
        assert attribute in truck
    assert 'id="vehicle"' in vehicle_types(scenario.vehicle(), 8.0, following_of(scenario_of()))


@pytest.mark.parametrize(
    ("types", "traffic", "parts"),
    [
        ([CAR], {}, ["traffic.types", "sum to 0.75", "1"]),
        ([CAR, TRUCK | {"share": 0.2499}], {}, ["traffic.types", "0.9999"]),
        ([CAR, TRUCK | {"name": "car"}], {}, ["traffic.types.1.name", "'car'", "twice"]),
        ([CAR, TRUCK | {"name": "long truck"}], {}, ["traffic.types.1.name", "'long truck'"]),
        ([CAR, TRUCK | {"share": 1.25}], {}, ["traffic.types.1.share", "1.25"]),
        ([CAR, TRUCK | {"length_m": 40.0}], {}, ["traffic.types.1.length_m", "40"]),
        ([CAR, TRUCK | {"lenght_m": 12.0}], {}, ["traffic.types.1.lenght_m", "length_m"]),
        ([CAR, {"name": "bus"}], {}, ["traffic.types.1.share", "required"]),
        ([CAR, TRUCK | {"width_m": 4.6}], {}, ["traffic.types.1.width_m", "4.6 m is wider"]),
        ([CAR, TRUCK], {"flow_per_hour": 1700.0}, ["traffic.flow_per_hour", "a mean headway"]),
    ],
)
def test_what_is_said_of_mistakes(
    types: list[dict[str, Any]], traffic: dict[str, Any], parts: list[str]
) -> None:
    with pytest.raises(InputError) as refused:
        scenario_of(*types, **traffic)
    text = str(refused.value)
    assert "\n" not in text
    for part in parts:
        assert part in text


def test_shares_may_miss_1_by_rounding() -> None:
    thirds = [{"name": f"type{i}", "share": 1 / 3} for i in range(3)]
    assert len(scenario_of(*thirds).vehicles()) == 3


@pytest.mark.parametrize("leader_mps", [0.0, 2.0])
def test_who_enters_behind_a_slow_leader_can_stop_behind_it(leader_mps: float) -> None:
    """Krauss 1998: after τ, it brakes at b and stops minGap behind the leader that brakes at b.

    v τ + v²/(2 b) is then the gap plus the leader's v_l²/(2 b).
    """
    tau_s, min_gap_m, room_m, step = 1.5, 2.5, 14.0, 7
    tree = {
        "ego": {"initial_speed_mps": 8.0, "max_deceleration_mps2": 4.0},
        "traffic": {"tau_s": tau_s, "min_gap_m": min_gap_m},
    }
    scenario = validate(tree, "test")
    rules, traffic = constants_of(scenario), scenario.known_traffic
    # Of the leader's front, at the step's end: its length, minGap and the room beyond the entry.
    ahead_m = rules.vehicle.length_m + min_gap_m + room_m - leader_mps * rules.step_s
    entered: list[float] = []
    road: Any = SimpleNamespace(
        lanes=[SimpleNamespace(entry_x_m=lambda *_: -100.0)],
        name_of=str,
        distance_of=lambda _: ahead_m,
        speed_of=lambda _: leader_mps,
        add=lambda _name, _lane, _x, speed, **_: entered.append(speed),
    )
    leader = SimpleNamespace(name="leader", insert_x_m=-100.0, vehicle=rules.vehicle)
    lane: Any = SimpleNamespace(number=0, due=deque(), coming=deque([leader]), driven=[])
    lane.next_scheduled = Scheduled(0, lanes_of(scenario)[0], step, 1.0)
    lane.plan_next = lambda: setattr(lane, "next_scheduled", None)
    strategy: Any = None
    entrance = Entrance(road, rules, traffic, lambda _: (False, "sumo_driver", strategy))
    assert entrance.let_in(lane, step - 1, 100) is None
    assert entrance.let_in(lane, step, 100) is not None
    (speed,) = entered
    stopping_m = speed * tau_s + speed**2 / (2 * 4.0)
    assert stopping_m == pytest.approx(room_m + leader_mps**2 / (2 * 4.0))
