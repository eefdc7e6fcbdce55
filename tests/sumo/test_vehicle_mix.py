"""A vehicle mix in SUMO: each vehicle has the length and the limits of its own type."""

from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
import pytest

from harness.core.encounter import Arm, Arrival, Side
from harness.encounter.arms import make_strategy
from harness.encounter.cell_constants import constants_of
from harness.encounter.traffic.demand import Scheduled
from harness.encounter.traffic.hour import Hour
from harness.encounter.traffic.lanes import lanes_of
from harness.encounter.traffic.pairing import HourOutcome, HourRunner
from harness.encounter.traffic.passages import passages_of
from harness.encounter.traffic.vehicles import LaneOnRoad
from harness.engine.shared import road_for
from harness.model.interaction import load_model
from harness.scenario import Scenario, validate
from tests.batches import printed

MODEL = load_model("dut", None)
pytestmark = pytest.mark.usefixtures("no_simulation")

TYPES: list[dict[str, Any]] = [
    {"name": "car", "share": 0.7},
    {
        "name": "truck",
        "share": 0.3,
        "length_m": 16.5,
        "width_m": 2.55,
        "max_acceleration_mps2": 1.3,
        "max_deceleration_mps2": 3.0,
        "resume_acceleration_mps2": 0.5,
        "automated": False,
    },
]


def tree_of(types: list[dict[str, Any]], people: float = 0.0, **traffic: Any) -> dict[str, Any]:
    return {
        "ego": {"initial_speed_mps": 8.0},
        "arms": {"av": "gap_yield", "human": "human_yield"},
        "pedestrians": {"flow_per_hour": people, "kerb_wait_s": 2.0},
        "traffic": {"duration_s": 600.0, "warm_up_s": 0.0, "types": types, **traffic},
    }


def arm_of(scenario: Scenario, arm: Arm = Arm.AV) -> HourOutcome:
    outcome = HourRunner(scenario, MODEL, lambda: road_for(scenario), paths=True).run_arm(0, arm)
    assert outcome.reason is None, outcome.reason
    return outcome


def test_free_vehicles_of_every_type_have_no_delay() -> None:
    """At a high flow every headway is near the least one: nobody brakes for anybody."""
    tree = tree_of(TYPES, flow_per_hour=1100.0, oncoming_per_hour=900.0)
    # Gap-Yield slows before it sees whether anybody comes.
    scenario = validate(tree | {"arms": {"av": "hard_yield", "human": "human_yield"}}, "mix")
    passages = arm_of(scenario).passages
    assert {passage.vehicle.plan.kind for passage in passages} == {0, 1}
    delays = [passage.delay_s for passage in passages]
    assert None not in delays
    assert max(delay for delay in delays if delay is not None) < 1e-3
    for passage in passages:
        length_m = (5.0, 16.5)[passage.vehicle.plan.kind]
        assert passage.trace.vehicle.length_m == length_m
        assert passage.passed_s is not None
        assert passage.edge_s is not None
        # From the near edge until its rear has left the crosswalk, 4 m wide, at 8 m/s.
        assert passage.passed_s - passage.edge_s == pytest.approx((4.0 + length_m) / 8, abs=1e-6)


def test_limits_and_gaps_are_those_of_each_type() -> None:
    """Accelerations by the type's limits; gaps to the leader's own rear, as with one type."""
    scenario = validate(tree_of(TYPES, people=300.0, av_share=0.5), "mix")
    outcome = arm_of(scenario)
    assert {p.vehicle.strategy_name for p in outcome.passages if p.vehicle.plan.kind} == {
        "human_yield"
    }
    for passage in outcome.passages:
        gains = np.diff(passage.trace.speed_mps) / 0.1
        most, least = ((3.0, -4.5), (1.3, -3.0))[passage.vehicle.plan.kind]
        assert gains.max(initial=0.0) <= most + 1e-6
        assert gains.min(initial=0.0) >= least - 1e-6
    behind = [
        (later[2] - state[2]) / ((later[0] - state[0]) * 0.1)
        for passage in outcome.passages
        if passage.vehicle.plan.kind
        for state, later in pairwise(passage.vehicle.path)
        if state[1] > 0
    ]
    # Beyond the crosswalk SUMO's driver accelerates: trucks with 0.5 m/s² and no more.
    assert max(behind) == pytest.approx(0.5, abs=1e-3)
    gaps = []
    for lane in lanes_of(scenario):
        places: dict[int, list[tuple[float, float]]] = {}
        for passage in outcome.passages:
            car = passage.vehicle
            if car.plan.lane == lane:
                for step, x_m, _ in car.path:
                    places.setdefault(step, []).append((x_m, car.vehicle.length_m))
        for vehicles in places.values():
            ordered = sorted(vehicles, reverse=True)
            gaps += [leader[0] - leader[1] - follower[0] for leader, follower in pairwise(ordered)]
    assert min(gaps) >= 2.0 - 0.2


def test_a_mixed_queue_in_metres_by_hand() -> None:
    """Somebody takes 90 s to cross; a car, a truck and a car wait: (5 + 16.5 + 5 + 3 · 2) m."""
    scenario = validate(tree_of(TYPES), "mix").model_copy()
    lane, other = lanes_of(scenario)
    rules = constants_of(scenario)
    due = [
        Scheduled(2 * place, lane, 40 * place, 0.0, kind) for place, kind in enumerate((0, 1, 0))
    ]
    hour = Hour(
        road_for(scenario),
        [LaneOnRoad(0, lane, iter(due), rules), LaneOnRoad(1, other, iter(()), rules)],
        (Arrival(0, 20.0, Side.NEAR, 0.5, None),),
        lambda *_: 0.1,
        lambda planned: (
            True,
            "hard_yield",
            make_strategy(
                scenario.model_copy(
                    update={"arms": scenario.arms.model_copy(update={"av": "hard_yield"})}
                ),
                Arm.AV,
                0,
                MODEL,
                planned.number,
            ),
        ),
        rules,
        scenario.known_traffic,
    )
    log = hour.run()
    longest = max(number for number, _ in log.queues)
    assert longest == 3
    assert max(length_m for length_m, _ in log.queues_m) == pytest.approx(32.5)
    standing = [m[0] for n, m in zip(log.queues, log.queues_m, strict=True) if n[0] == 1]
    assert set(standing) <= {7.0, 18.5}
    ends = {number: road.ends_x_m for number, road in enumerate(hour.road.lanes)}
    stops = [passage.trace.x_m[-1] for passage in passages_of(log, rules, ends, saturated=False)]
    # Each trace ends when the rear of its own vehicle has left the crosswalk, 2 m behind its line.
    for x_m, length_m in zip(stops, (5.0, 16.5, 5.0), strict=True):
        assert x_m >= length_m + 2.0 - 1e-6


def test_passages_have_their_types_in_both_arms(tmp_path) -> None:
    path = tmp_path / "mix.toml"
    path.write_text(
        "[ego]\ninitial_speed_mps = 8.0\n[arms]\nav = 'gap_yield'\nhuman = 'human_yield'\n"
        "[pedestrians]\nflow_per_hour = 300\n[traffic]\nduration_s = 120\nwarm_up_s = 0\n"
        "[[traffic.types]]\nname = 'car'\nshare = 0.5\n"
        "[[traffic.types]]\nname = 'truck'\nshare = 0.5\nlength_m = 16.5\nwidth_m = 2.5\n"
    )
    out = tmp_path / "run"
    printed("run", str(path), "--pairs", "2", "--traces", "--workers", "1", "--out", str(out))
    passages = pd.read_parquet(out / "passages.parquet")
    assert set(passages["type"]) == {"car", "truck"}
    arms = [part.set_index(["pair", "vehicle"])["type"] for _, part in passages.groupby("arm")]
    assert arms[0].equals(arms[1])
    assert (pd.read_parquet(out / "hours.parquet")["queue_p95_m"] >= 0).all()
