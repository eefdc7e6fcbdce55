"""The vehicles of ``[traffic]``: types, headways, draws, and what is said of mistakes."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from harness.scenario import Scenario, validate
from harness.simulation.demand import Due, vehicles_due

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


def lane_of(scenario: Scenario, pair: int) -> list[Due]:
    return [due for due in vehicles_due(scenario, pair) if (due.direction, due.lane) == (0, 0)]


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


def test_the_flow_and_the_types_are_those_asked_for_and_no_headway_is_too_short() -> None:
    """Without least headways counts would be Poisson and trucks binomial: 4 standard deviations."""
    scenario = scenario_of(CAR, TRUCK, flow_per_hour=900.0)
    hours = [lane_of(scenario, pair) for pair in range(20)]
    counts = np.array([len(vehicles) for vehicles in hours])
    assert abs(counts.mean() - 900) < 4 * math.sqrt(900 / 20)
    trucks = sum(due.kind for vehicles in hours for due in vehicles)
    assert abs(trucks - counts.sum() / 4) < 4 * math.sqrt(counts.sum() * 0.25 * 0.75)
    types = scenario.vehicles()
    for vehicles in hours[:3]:
        for leader, follower in pairwise(vehicles):
            least_s = scenario.headway_s(types[leader.kind], types[follower.kind])
            assert follower.depart_s - leader.depart_s >= least_s - 1e-9
