"""Roads of any number of lanes: the network is what was asked for, SUMO drives it as planned."""

import random
from pathlib import Path

import libsumo
import pytest

from harness.core.vocabulary import Arm
from harness.encounter.pairing import PairRunner
from harness.engine.network import CACHE_VARIABLE
from harness.engine.starting import session_of
from harness.engine.sumo_engine import SumoEngine
from harness.scenario import Scenario, validate
from tests.scenes import on_plain
from tests.sites import to_road
from tests.sumo.test_engines_agree import assert_same_episode


def random_scenario(seed: int) -> Scenario:
    """A road of one to three lanes each way, a median or strips maybe, and who is there."""
    draw = random.Random(seed)
    lanes, oncoming = draw.randint(1, 3), draw.randint(0, 3)
    lane_width = round(draw.uniform(2.6, 5.0), 3)
    rest = draw.choice([0.0, 0.0, round(draw.uniform(0.2, 6.0), 3)])
    length = max(4.0, (lanes + oncoming) * lane_width + rest)
    speed = round(draw.uniform(4.0, 20.0), 2)
    place = {"latitude_deg": draw.uniform(-60.0, 60.0), "longitude_deg": draw.uniform(-180, 180)}
    crossing = {**place, "bearing_deg": draw.uniform(0.0, 359.9), "lanes": lanes}
    crossing |= {"oncoming_lanes": oncoming, "length_m": length}
    crossing["width_m"] = round(draw.uniform(2.0, 8.0), 3)
    if length > (lanes + oncoming) * lane_width:
        crossing["lane_width_m"] = lane_width
    if draw.random() < 0.5:
        crossing["road_speed_limit_mps"] = round(draw.uniform(3.0, 25.0), 2)
    tree = {
        "crossing": crossing,
        "ego": {
            "lane": draw.randrange(lanes),
            "initial_speed_mps": speed,
            "trigger_range_m": round(max(30.0, speed * 5), 1),
        },
        "pedestrians": {"flow_per_hour": 1000.0, "kerb_wait_s": draw.choice([0.0, 2.0])},
        "arms": {"av": draw.choice(["gap_yield", "hard_yield"]), "human": "human_yield"},
        "model": {"extrapolate": True},
        "experiment": {"timeout_s": 120.0, "seed": seed},
    }
    return validate(tree, "random")


def check_lanes(scenario: Scenario) -> None:
    """Every lane of the network lies where ``[crossing]`` says, from kerb to kerb."""
    crossing = scenario.crossing
    for edge, count, mirrored in (
        ("approach", crossing.lanes, False),
        ("oncoming_exit", crossing.oncoming_lanes, True),
    ):
        first = int(crossing.kerb_strip_m > 0)
        for lane in range(count):
            name = f"{edge}_{first + lane}"
            ys = [to_road(crossing, *point)[1] for point in libsumo.lane.getShape(name)]
            # By hand: lanes side by side from the kerb, one-way ones in the middle of the road.
            width = crossing.lane_width_m or crossing.length_m / (
                crossing.lanes + crossing.oncoming_lanes
            )
            kerb = 0.0 if crossing.oncoming_lanes else (crossing.length_m - width * count) / 2
            centre = kerb + width * lane + width / 2
            expected = crossing.length_m - centre if mirrored else centre
            assert ys == pytest.approx([expected] * 2, abs=2e-6)
            assert libsumo.lane.getWidth(name) == pytest.approx(width)


def compare(seed: int, model) -> int:
    """One random road in SUMO and on the plain engine; returns how many people were met."""
    scenario = random_scenario(seed)
    engine = SumoEngine(session_of(scenario), scenario)
    met = 0
    try:
        check_lanes(scenario)
        limit = scenario.crossing.road_speed_limit_mps or scenario.ego.initial_speed_mps
        index = scenario.ego.lane + (scenario.crossing.kerb_strip_m > 0)
        for name in (f"approach_{index}", f"exit_{index}"):
            assert libsumo.lane.getMaxSpeed(name) == limit
        plain = on_plain(scenario, model)
        in_sumo = PairRunner(scenario, model, lambda: engine)
        for one, other in zip(in_sumo.run(range(2)), plain.run(range(2)), strict=True):
            assert_same_episode(one, other, (seed, one.pair, one.arm))
            met += one.record.pedestrians * (one.arm is Arm.AV)
    finally:
        engine.close()
    return met


@pytest.mark.parametrize(
    ("seeds", "least"), [(range(10), 20), pytest.param(range(10, 210), 400, marks=pytest.mark.slow)]
)
@pytest.mark.usefixtures("no_simulation")
def test_random_roads(tmp_path: Path, monkeypatch, model, seeds: range, least: int) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    assert sum(compare(seed, model) for seed in seeds) > least
