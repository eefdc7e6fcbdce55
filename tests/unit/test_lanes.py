"""Lanes of a road, and what strategies make of them: every place is added up by hand."""

import math
from typing import Any

import pytest

from harness.core.vocabulary import Side
from harness.measures.ego import crossing_time_s
from harness.scenario import Setting, read_scenario_file, study_of, validate
from harness.scenario.variation import parse_variation
from harness.strategies.gap_yield import GapYield
from tests.scenes import play, scenario


def road(lane: int = 0, **crossing: Any):
    return scenario(crossing=crossing, ego={"lane": lane})


@pytest.mark.parametrize(
    ("crossing", "lane", "centre", "borders"),
    [
        # Two lanes of 4.5 m: the paper's.
        ({}, 0, 2.25, (4.5,)),
        # A median of 2 m between lanes of 3 m: 0-3-6 | 8-11.
        ({"lanes": 2, "length_m": 11.0, "lane_width_m": 3.0}, 1, 4.5, (3.0, 6.0, 8.0)),
        # One way, three lanes, no rest.
        ({"lanes": 3, "oncoming_lanes": 0, "length_m": 9.0}, 2, 7.5, (3.0, 6.0)),
        # One way, 1 m at each kerb: 1-4-7 of 8.
        ({"lanes": 2, "oncoming_lanes": 0, "length_m": 8, "lane_width_m": 3}, 0, 2.5, (1, 4, 7)),
    ],
)
def test_where_a_lane_lies(crossing: Any, lane: int, centre: float, borders: Any) -> None:
    scene = road(lane, **crossing)
    seen = scene.crosswalk()
    assert (seen.lane, seen.lane_centre_m) == (lane, pytest.approx(centre))
    assert scene.crossing.lane_borders_m() == pytest.approx(borders)
    assert seen.to_lane_m(Side.NEAR) == pytest.approx(centre)
    assert seen.to_lane_m(Side.FAR) == pytest.approx(scene.crossing.length_m - centre)


def test_gap_yield_waits_until_its_own_lane_is_free() -> None:
    # Lane 1 of 3 m ends, disc and all, 6.25 m from the near kerb; from the far one, 3 m of the
    # oncoming lane, its lane and 0.25 m.  It arrives at the near edge, R = 2 m, just then.
    scene = road(1, lanes=2, oncoming_lanes=1, length_m=9.0)
    for side, free_m in ((Side.NEAR, 6.25), (Side.FAR, 6.25)):
        trace = play(GapYield(), [(0.0, side, 0.8)], scene)
        free = free_m / 0.8
        assert (trace.speed_mps[1] - 5) / 0.1 == pytest.approx(2 * (28 - 5 * free) / free**2)
        assert crossing_time_s(trace, -2.0) == pytest.approx(free, abs=0.1)


def test_a_speed_takes_a_unit_wherever_it_is_said(tmp_path) -> None:
    file = tmp_path / "fast.toml"
    file.write_text('[ego]\ninitial_speed_mps = "36 km/h"\n[crossing]\nroad_speed_limit_mps = 8\n')
    assert read_scenario_file(file).scenario().ego.initial_speed_mps == 10.0
    # 1 mile is 1,609.344 m and 1 foot 0.3048 m, exactly.
    settings = [Setting("ego.initial_speed_mps", "30mph"), Setting("strategies.x.a_mps", "10 ft/s")]
    scene = read_scenario_file(file, settings).scenario()
    assert scene.ego.initial_speed_mps == pytest.approx(30 * 1609.344 / 3600, rel=1e-15)
    assert scene.strategies == {"x": {"a_mps": pytest.approx(3.048)}}
    study = study_of(
        read_scenario_file(file), [parse_variation("ego.initial_speed_mps=50 km/h,20 mph,7")]
    )
    speeds = [cell.varied["ego.initial_speed_mps"] for cell in study.cells]
    assert speeds == pytest.approx([50 / 3.6, 20 * 0.44704, 7.0])
    assert speeds == [cell.scenario.ego.initial_speed_mps for cell in study.cells]
    timed = {"side": "near", "start_lateral_m": 4.0, "speed_mps": "5 km/h", "impact_share": 0.5}
    found = validate({"pedestrians": {"timed": [timed]}}, "test").pedestrians.timed[0]
    assert math.isclose(found.speed_mps, 5 / 3.6)
