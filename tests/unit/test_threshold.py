"""Pedestrians who decide by a threshold of their own: when they decide, and when they set off.

The numbers follow from the formula of Pekkanen et al. 2022 by hand.
"""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from harness.core.vocabulary import Arrival, Side, Walk
from harness.encounter.arrivals import planned_arrivals
from harness.encounter.deciding import Threat, blocking, effective_time_s
from harness.scenario import Scenario, validate
from harness.scenario.pedestrians import ThresholdSection
from tests.scenes import Recorder, episode

LOG_THETA, LOG_LATENCY = stats.norm(1.430, 0.405), stats.norm(0.0166, 0.604)
WEIGHTS = ThresholdSection()


def scene(gap_s: float = 6.0, speed_mps: float = 5.0, **pedestrians: object) -> Scenario:
    """A car that reaches x = 0 after ``gap_s`` if it keeps its speed."""
    ego = {"initial_speed_mps": speed_mps, "trigger_range_m": gap_s * speed_mps}
    people = {"behaviour": "threshold", **pedestrians}
    return validate({"ego": ego, "pedestrians": people}, "test")


def person(threshold_s: float, latency_s: float = 0.55, side: Side = Side.NEAR) -> Arrival:
    """They are at the kerb and decide from t = 0 on."""
    waits = Arrival(0, 0.0, side, 0.5, looks_from_s=0.0)
    return waits._replace(threshold_s=threshold_s, latency_s=latency_s)


def walk(scenario: Scenario, who: Arrival, command: Callable[[Any], float] = lambda _: 0.0) -> Walk:
    """Their walk at 1.2 m/s."""
    return episode(scenario, Recorder(command), [who]).walks[0]


@pytest.mark.parametrize("mph", [25.0, 30.0, 35.0])
@pytest.mark.parametrize("gap_s", [2.0, 3.0, 4.0, 5.0])
def test_who_decides_before_a_car_that_keeps_its_speed(mph: float, gap_s: float) -> None:
    """τ̇ is −1, and τ only falls: they decide at once or after the car."""
    speed = mph * 0.44704
    time_s = gap_s + 0.252 * (gap_s * speed / (50 / 3.6) - gap_s)
    share = LOG_THETA.cdf(math.log(time_s))
    for rank, goes in ((share - 0.001, True), (share + 0.001, False)):
        theta_s = math.exp(LOG_THETA.ppf(rank))
        start_s = walk(scene(gap_s, speed), person(theta_s)).start_s
        assert (start_s == 0.55) is goes, (rank, start_s)


def test_a_car_that_slows_down_stands_or_has_passed() -> None:
    # τ = 3.875 s and D/(50 km/h) = 2.232 s; −D a/v² = 31 · 2/64.
    expected = 3.875 + 0.252 * (2.232 - 3.875) + 1.40 * 0.96875
    assert effective_time_s(31.0, 8.0, -2.0, WEIGHTS) == pytest.approx(expected)
    assert effective_time_s(31.0, 8.0, 2.0, WEIGHTS) == pytest.approx(expected - 2.8 * 0.96875)
    # Below 0.1 m/s it stands; at 0.1 m/s it is 10 s away, and D/(50 km/h) = 0.072 s.
    assert effective_time_s(31.0, 0.099, 0.0, WEIGHTS) == math.inf
    assert effective_time_s(1.0, 0.1, 0.0, WEIGHTS) == pytest.approx(10 + 0.252 * (0.072 - 10))
    # From 1 s on it brakes; people see that a step later, at t = 1.1 s: v = 9.6, D = 30 − 0.98.
    slows = lambda o: -4.0 if o.time_s > 0.95 else 0.0  # noqa: E731
    tau, distance_m = 29.02 / 9.6, 29.02
    at_once = tau + 0.252 * (distance_m / (50 / 3.6) - tau) + 1.40 * distance_m * 4 / 9.6**2
    car = scene(4.0, 10.0)
    assert at_once > 4.0 + 0.252 * (40 / (50 / 3.6) - 4.0)  # at t = 0, the longest so far
    assert walk(car, person(at_once - 0.01, 0.5), slows).start_s == pytest.approx(1.6)
    assert walk(car, person(at_once + 0.01, 0.5), slows).start_s > 1.6
    # It stands 2 m before the near edge from 8 s on; τ_eff was 100 s at most before.
    stands = lambda o: -25 / 52 if o.ego.speed_mps > 0 else 0.0  # noqa: E731
    start_s = walk(scene(), person(1e6, 0.5), stands).start_s
    assert start_s == pytest.approx(10.4 + 0.5, abs=0.2)


def test_the_least_margin_over_the_lanes_counts() -> None:
    """Two lanes of 3 m: τ_eff is 3 s in the near one and 4 s in the far one; they walk 1.5 m/s."""
    near, far = SimpleNamespace(), SimpleNamespace()
    cars = [Threat(3.0, near, (0.0, 3.0)), Threat(4.0, far, (3.0, 6.0))]
    # From the near kerb the far lane is 2 s away: margins of 3 and 2 s.
    assert blocking(cars, 1.99, 0.0, 1.5) is None
    assert blocking(cars, 2.01, 0.0, 1.5) is far
    # From the far kerb the near lane is 2 s away: margins of 1 and 4 s.
    assert blocking(cars, 0.99, 6.0, 1.5) is None
    assert blocking(cars, 1.01, 6.0, 1.5) is near
    assert blocking([], 1e9, 0.0, 1.5) is None
    # In an encounter: the ego's lane ends 4.5 m from the far kerb, 3.75 s at 1.2 m/s.
    margin = 6.0 + 0.252 * (30 / (50 / 3.6) - 6.0) - 3.75
    assert walk(scene(), person(margin - 0.001, side=Side.FAR)).start_s == 0.55
    assert walk(scene(), person(margin + 0.001, side=Side.FAR)).start_s is None


def test_who_decides_on_arrival_sets_off_at_once() -> None:
    arrives = Arrival(0, 0.33, Side.NEAR, 0.5, threshold_s=4.0, latency_s=0.5)
    assert walk(scene(), arrives).start_s == 0.33  # τ_eff = 5.67 − 0.252 · 3.63 = 4.76 s
    # Who does not decide by then decides at steps; the car brakes from 1 s on.
    brakes = lambda o: -1.0 if o.time_s > 0.95 else 0.0  # noqa: E731
    waits = walk(scene(), arrives._replace(threshold_s=5.0), brakes)
    assert waits.start_s == pytest.approx(1.1 + 0.5)


PLAN = st.lists(st.sampled_from([-3.0, -1.0, -0.5, 0.0, 0.0, 1.0]), min_size=20, max_size=60)


@settings(max_examples=60)
@given(
    PLAN, st.floats(0.3, 9), st.floats(1, 3), st.sampled_from(Side), st.sampled_from([5.0, 14.0])
)
def test_a_greater_threshold_never_decides_earlier(plan, theta_s, ratio, side, speed) -> None:
    """Nobody's latency is worth mentioning: they try at every step from their decision on."""

    def command(observation: Any) -> float:
        step = round(observation.time_s / 0.1)
        return plan[step] if step < len(plan) else 0.0

    starts = [
        walk(scene(6.0, speed), person(theta, 1e-3, side), command).start_s
        for theta in (theta_s, theta_s * ratio)
    ]
    first, second = (math.inf if start is None else start for start in starts)
    assert first <= second


def test_planned_thresholds_are_as_distributed_and_change_nothing_else() -> None:
    flow = {"flow_per_hour": 900.0}
    people = validate({"pedestrians": {**flow, "behaviour": "threshold"}}, "test")
    bold = {**flow, "behaviour": "threshold", "threshold": {"factor": 0.5}}
    steady = validate({"pedestrians": flow}, "test")
    found = []
    for pair in range(300):
        plan, other = planned_arrivals(people, pair), planned_arrivals(steady, pair)
        none = {"threshold_s": None, "latency_s": None}
        assert [arrival._replace(**none) for arrival in plan] == list(other)
        bolder = planned_arrivals(validate({"pedestrians": bold}, "test"), pair)
        halves = [a._replace(threshold_s=a.threshold_s / 2) for a in plan]
        assert list(bolder) == halves
        found += [(a.threshold_s, a.latency_s, a.quantile) for a in plan]
    theta, latency, quantile = np.array(found).T
    assert len(theta) > 4000
    # Each of these is a false alarm with a chance of 1 in 1,000.
    assert stats.kstest(np.log(theta), LOG_THETA.cdf).pvalue > 1e-3
    assert stats.kstest(np.log(latency), LOG_LATENCY.cdf).pvalue > 1e-3
    for one, other in ((theta, latency), (theta, quantile), (latency, quantile)):
        assert stats.spearmanr(one, other).pvalue > 1e-3
