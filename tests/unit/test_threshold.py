"""Pedestrians who decide by a threshold of their own: when they decide, and when they set off."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import pytest
from scipy import stats

from harness.core.encounter import Arrival, Side, Walk
from harness.scenario import Scenario, validate
from tests.scenes import Recorder, episode

LOG_THETA = stats.norm(1.430, 0.405)  # ln θ, Pekkanen et al. 2022


def scene(gap_s: float = 6.0, speed_mps: float = 5.0, **pedestrians: object) -> Scenario:
    """A car that reaches x = 0 after ``gap_s`` if it keeps its speed."""
    ego = {"initial_speed_mps": speed_mps, "trigger_range_m": gap_s * speed_mps}
    people = {"behaviour": "threshold", **pedestrians}
    return validate({"ego": ego, "pedestrians": people}, "test")


def person(threshold_s: float, latency_s: float = 0.55, side: Side = Side.NEAR) -> Arrival:
    """They are at the kerb and decide from t = 0 on."""
    times = {"threshold_s": threshold_s, "latency_s": latency_s}
    return Arrival(0, 0.0, side, 0.5, looks_from_s=0.0, **times)


def walk(scenario: Scenario, who: Arrival, command: Callable[[Any], float] = lambda _: 0.0) -> Walk:
    return episode(scenario, Recorder(command), [who]).walks[0]


@pytest.mark.parametrize(
    ("mph", "gap_s"), list(itertools.product((25.0, 30.0, 35.0), (2.0, 3.0, 4.0, 5.0)))
)
def test_who_decides_before_a_car_that_keeps_its_speed(mph: float, gap_s: float) -> None:
    """τ̇ is −1, and τ only falls: they decide at once or after the car (Pekkanen et al. 2022)."""
    speed = mph * 0.44704
    time_s = gap_s + 0.252 * (gap_s * speed / (50 / 3.6) - gap_s)
    share = LOG_THETA.cdf(math.log(time_s))
    for rank, goes in ((share - 0.001, True), (share + 0.001, False)):
        theta_s = math.exp(LOG_THETA.ppf(rank))
        start_s = walk(scene(gap_s, speed), person(theta_s)).start_s
        assert (start_s == 0.55) is goes, (rank, start_s)
