"""Human-Yield: whom it yields to, when it brakes, that it drives into nobody it can avoid.

v0 = 5 m/s from R = 30 m, steps of 0.1 s, so R = 30 − 0.5 k at step k; stop line at R = 3 m.  With
3 m/s² a stop takes 25/6 = 4.17 m.  The path is 1.1 to 3.4 m from the near kerb, the lane ends,
disc and all, at 4.75 m.
"""

import math

import numpy as np
import pytest
from scipy import stats

from harness.core.seeding import stream
from harness.core.vocabulary import Ending, PedestrianView, Side
from harness.measures import measure
from harness.measures.ego import crossing_time_s
from harness.strategies.gap_yield import GapYield
from harness.strategies.hard_yield import HardYield
from harness.strategies.human_yield import HumanYield
from tests.scenes import braking_steps, play, scenario, shown

STEP = 0.1
WAITS = {"kerb_wait_s": 100.0}
"""Nobody steps off before a car that moves."""


def driver(*, yields: bool, **parameters: float) -> HumanYield:
    return HumanYield(rng=np.random.default_rng(1), yield_rate=float(yields), **parameters)


def test_one_vehicle_in_four_does_not_yield() -> None:
    # A stream of its own for each pair; 0.74 ± four standard errors of 4,000 vehicles.
    # 3 m/s² stop it at R = 3 m from R = 3 + 25/6 = 7.17 m: now, and not a step later.
    waits = PedestrianView(0, Side.NEAR, 2.25, 9.0, 0.0, on_crossing=False)
    seen = shown(scenario(pedestrians=WAITS), 7.3, 5.0, waits)
    brakes = [HumanYield(rng=stream(7, "strategy", pair)).decide(seen) < 0 for pair in range(4000)]
    assert np.mean(brakes) == pytest.approx(0.74, abs=4 * math.sqrt(0.74 * 0.26 / 4000))


def test_stops_for_somebody_who_waits_as_late_as_is_comfortable() -> None:
    # After step k the room is 27 − 0.5 (k + 1), which has to be 4.17 m: k ≤ 44.  From k = 45 on
    # 25/(2 · 4.5) m/s² for 1.8 s.  It would stop 1 m before the edge, so at 4.6 s, a step later,
    # they step off, are out of the lane 4.75 s later, and 1 m at a0 takes sqrt(2) s: it starts at
    # the first step from 7.936 s on.
    trace = play(driver(yields=True), [(0.0, Side.NEAR, 1.0)], scenario(pedestrians=WAITS))
    np.testing.assert_array_equal(trace.speed_mps[:46], 5.0)
    np.testing.assert_allclose(np.diff(trace.speed_mps)[45:63] / STEP, -25 / 9, atol=1e-9)
    np.testing.assert_allclose(-trace.x_m[63:81], 3.0, atol=1e-9)
    assert trace.walks[0].start_s == pytest.approx(4.6)
    np.testing.assert_allclose(np.diff(trace.speed_mps)[80:103] / STEP, 1.0, atol=1e-9)


def test_does_not_wait_for_somebody_who_will_have_left_its_lane() -> None:
    # 4.75 m at 1 m/s; it is at the near edge, R = 2 m, after 5.6 s.
    trace = play(driver(yields=True), [(0.0, Side.NEAR, 1.0)])
    assert braking_steps(trace) == []
    # At 0.8 m/s it takes 5.94 s: it brakes until going on gets it there no sooner.
    slow = play(driver(yields=True), [(0.0, Side.NEAR, 0.8)])
    assert braking_steps(slow)[0] == 45
    assert slow.speed_mps.min() > 1.0
    assert crossing_time_s(slow, -2.0) == pytest.approx(4.75 / 0.8, abs=0.1)


@pytest.mark.parametrize(("reaction", "stops"), [(0.5, True), (0.45, True), (0.6, False)])
def test_the_way_of_the_reaction_counts(reaction: float, stops: bool) -> None:
    # They arrive at R = 10 m, 7 m before the line: after 0.5 s 4.5 m are left, and a stop takes
    # 4.17 m; after 0.6 s only 4 m.  A reaction ends with a step.
    strategy = driver(yields=True, reaction_time_s=reaction)
    trace = play(strategy, [(4.0, Side.FAR, 1.0)], scenario(pedestrians=WAITS))
    assert braking_steps(trace)[:1] == [45] * stops
    if stops:
        np.testing.assert_allclose(np.diff(trace.speed_mps)[45:63] / STEP, -25 / 9, atol=1e-9)


@pytest.mark.parametrize("yields", [True, False])
@pytest.mark.parametrize(
    ("reaction", "first", "deceleration", "contact"),
    # Off the kerb at R = 5.5 m.  At R = 4.5 m there are 4.15 m to 0.1 m before their disc; at
    # R = 3 m 2.75 m to the disc, and a stop takes 2.78 m.
    [(0.0, 49, 25 / 10.3, None), (0.2, 51, 25 / 8.3, None), (0.5, 54, 4.5, "front")],
)
def test_avoiding_is_late_too(yields, reaction, first, deceleration, contact) -> None:
    strategy = driver(yields=yields, reaction_time_s=reaction)
    trace = play(strategy, [(4.9, Side.NEAR, 0.8)])
    assert braking_steps(trace)[0] == first
    assert -np.diff(trace.speed_mps)[first] / STEP == pytest.approx(deceleration, rel=0.01)
    assert measure([trace])[0].contact == contact


def test_drivers_differ_as_measured() -> None:
    spread = {"reaction_time_sigma": 0.4, "comfortable_deceleration_sigma": 0.28}
    both = [HumanYield(rng=stream(7, "strategy", n), reaction_time_s=1.0, **spread)
            for n in range(4000)]  # fmt: skip
    alike = [HumanYield(rng=stream(7, "strategy", n)) for n in range(4000)]
    assert [one.yields for one in both] == [one.yields for one in alike]
    times, hard = (np.array([getattr(one, name) for one in both])
                   for name in ("reaction_s", "comfortable_mps2"))  # fmt: skip
    for values, median, sigma in ((times, 1.0, 0.4), (hard, 3.0, 0.28)):
        logs = np.log(values / median) / sigma
        assert stats.kstest(logs, "norm").pvalue > 1e-4
    assert abs(np.corrcoef(times, hard)[0, 1]) < 4 / math.sqrt(4000)
    # Gates et al. 2007: 15th, 50th and 85th percentiles, 7.2, 9.9, 12.9 ft/s².
    np.testing.assert_allclose(np.quantile(times, [0.15, 0.5, 0.85]), [0.7, 1.0, 1.6], atol=0.12)
    feet = np.array([7.2, 9.9, 12.9]) * 0.3048
    np.testing.assert_allclose(np.quantile(hard, [0.15, 0.5, 0.85]), feet, atol=0.15)


@pytest.mark.parametrize("yields", [True, False])
@pytest.mark.parametrize(
    ("arrival", "first", "deceleration"),
    [
        # Off the kerb at R = 10 m at 0.8 m/s: in the path from 1.25 to 4.5 s (with 0.1 m to spare),
        # while it is there from 1.93 s on.  It need not stop yet; from R = 7.5 m on it must.
        (4.0, 45, 25 / 9),
        # At R = 5.5 m: the line is too near for comfort, so to 0.1 m before their disc, 5.15 m.
        (4.9, 49, 25 / 10.3),
        # At R = 3.5 m: 3.15 m.
        (5.3, 53, 25 / 6.3),
    ],
)
def test_whoever_is_in_its_path_is_braked_for(yields, arrival, first, deceleration) -> None:
    trace = play(driver(yields=yields), [(arrival, Side.NEAR, 0.8)])
    assert braking_steps(trace)[0] == first
    # Held but for what the time grid takes, 1/(4 n (n − 1)).
    assert -np.diff(trace.speed_mps)[first] / STEP == pytest.approx(deceleration, rel=0.01)
    assert measure([trace])[0].contact is None


@pytest.mark.parametrize("make", [
    lambda: driver(yields=True),
    lambda: driver(yields=True, reaction_time_s=1.0),
    lambda: HardYield(yield_to_waiting=True),
    lambda: GapYield(yield_to_waiting=True),
])  # fmt: skip
@pytest.mark.parametrize("limit", [2.0, 4.5])
def test_never_waits_for_each_other(make, limit: float) -> None:
    # Whenever people come, on both sides and while it brakes, passes or stands.
    scene = scenario(pedestrians=WAITS, ego={"max_deceleration_mps2": limit})
    for arrival in np.arange(0.0, 7.0, 0.13):
        people = [(arrival + 0.8 * i, (*Side,)[i % 2], 1.0 + 0.2 * i) for i in range(4)]
        trace = play(make(), people, scene)
        assert trace.ending is Ending.CROSSED
        assert measure([trace])[0].contact is None
        # It crosses when everybody has, or without having stood.
        assert {walk.start_s is None for walk in trace.walks} != {True} or trace.speed_mps.min() > 0
