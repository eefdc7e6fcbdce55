"""Roads of any number of lanes: the network is what was asked for, SUMO drives it as planned."""

import random
from pathlib import Path

import libsumo
import numpy as np
import pytest

from harness.engine.network import CACHE_VARIABLE
from harness.engine.protocol import Engine
from harness.engine.shared import open_engine
from harness.scenario import Scenario
from tests.sites import to_road
from tests.sumo.test_engines_agree import compare, random_scene


def random_scenario(seed: int) -> Scenario:
    """A road of one to three lanes each way, a median or strips maybe."""
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
    ego = {"lane": draw.randrange(lanes), "initial_speed_mps": speed}
    ego["trigger_range_m"] = round(max(30.0, speed * 5), 1)
    return random_scene(np.random.default_rng(seed), seed, {}, ego, crossing)


def checked(scenario: Scenario) -> Engine:
    """SUMO, in which every lane lies where ``[crossing]`` says, from kerb to kerb."""
    engine, crossing = open_engine(scenario), scenario.crossing
    for edge, count, mirrored in (
        ("approach", crossing.lanes, False),
        ("oncoming_exit", crossing.oncoming_lanes, True),
    ):
        first = int(crossing.kerb_strip_m > 0)
        for lane in range(count):
            name = f"{edge}_{first + lane}"
            ys = [to_road(crossing, *point)[1] for point in libsumo.lane.getShape(name)]
            # By hand: lanes side by side from the kerb, one-way ones in the middle of the road.
            lanes = crossing.lanes + crossing.oncoming_lanes
            width = crossing.lane_width_m or crossing.length_m / lanes
            kerb = 0.0 if crossing.oncoming_lanes else (crossing.length_m - width * count) / 2
            centre = kerb + width * lane + width / 2
            expected = crossing.length_m - centre if mirrored else centre
            assert ys == pytest.approx([expected] * 2, abs=2e-6)
            assert libsumo.lane.getWidth(name) == pytest.approx(width)
    limit = crossing.road_speed_limit_mps or scenario.ego.initial_speed_mps
    index = scenario.ego.lane + (crossing.kerb_strip_m > 0)
    assert libsumo.lane.getMaxSpeed(f"approach_{index}") == limit
    assert libsumo.lane.getMaxSpeed(f"exit_{index}") == limit
    return engine


@pytest.mark.parametrize(
    ("seeds", "least"), [(range(10), 40), pytest.param(range(10, 210), 800, marks=pytest.mark.slow)]
)
@pytest.mark.usefixtures("no_simulation")
def test_random_roads(tmp_path: Path, monkeypatch, model, seeds: range, least: int) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    assert compare(map(random_scenario, seeds), 2, checked, model)["met"] > least
