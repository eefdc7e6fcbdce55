"""The vehicles of ``[traffic]``: their flow and headways."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from harness.engine.traffic_files import types_of
from harness.scenario import Scenario, validate
from harness.simulation.opening import vehicles_due


def scenario_of(**traffic: Any) -> Scenario:
    tree = {"duration_s": 3600.0, "warm_up_s": 0.0, **traffic}
    return validate({"ego": {"initial_speed_mps": 8.0}, "traffic": tree}, "traffic.toml")


def test_the_least_headway_by_hand() -> None:
    """1 s + (5 + 2)/8 s = 1.875 s, in whole steps."""
    assert scenario_of().least_headway_s() == pytest.approx(1.9)


def test_a_grade_has_the_other_sign_for_oncoming_vehicles() -> None:
    """g sin α is added to one direction's deceleration and taken from the other's."""
    crossing = {"grade": 0.08, "oncoming_lanes": 1}
    uphill, downhill = types_of(validate({"crossing": crossing, "traffic": {}}, "t")).values()
    apart_mps2 = 2 * 9.80665 * math.sin(math.atan(0.08))
    found_mps2 = uphill.max_deceleration_mps2 - downhill.max_deceleration_mps2
    assert found_mps2 == pytest.approx(apart_mps2)


def test_the_flow_is_the_one_asked_for_and_no_headway_is_too_short() -> None:
    """Without least headways counts would be Poisson: 4 standard deviations."""
    scenario = scenario_of(flow_per_hour=900.0)
    every = ([*vehicles_due(scenario, pair)] for pair in range(20))
    hours = [[due for due in each if not due.direction] for each in every]
    counts = np.array([len(vehicles) for vehicles in hours])
    assert abs(counts.mean() - 900) < 4 * math.sqrt(900 / 20)
    for vehicles in hours[:3]:
        for leader, follower in pairwise(vehicles):
            assert follower.depart_s - leader.depart_s >= scenario.least_headway_s() - 1e-9
