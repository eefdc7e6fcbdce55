"""The pedestrians of a pair: Poisson arrivals (paper, section III-B), sides, quantiles."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from harness.core.vocabulary import Arrival, Side
from harness.encounter.arrivals import planned_arrivals
from harness.scenario import Scenario, validate
from tests.scenes import plans

PAIRS = 4000


def scene(timeout_s: float = 60.0, seed: int = 1, **pedestrians: object) -> Scenario:
    experiment = {"timeout_s": timeout_s, "seed": seed}
    return validate({"pedestrians": pedestrians, "experiment": experiment}, "test")


@pytest.mark.parametrize("flow", [60.0, 250.0, 1200.0])
def test_counts_within_a_minute_are_poisson(flow: float) -> None:
    # Horizon beyond the minute, so that nothing is cut by the planning itself.
    arrivals = plans(scene(timeout_s=90.0, flow_per_hour=flow))
    counts = np.array([sum(a.arrival_s <= 60 for a in plan) for plan in arrivals])
    expected = flow * 60 / 3600
    # Standard errors: of the mean √(λ/n); of the variance √((λ + 2λ²)/n), since the fourth
    # central moment of a Poisson variable is λ + 3λ².
    assert abs(counts.mean() - expected) < 4 * np.sqrt(expected / PAIRS)
    error = np.sqrt((expected + 2 * expected**2) / PAIRS)
    assert abs(counts.var() - expected) < 4 * error
    # And the whole distribution: χ² over cells with at least 5 expected.
    most = int(stats.poisson.ppf(1 - 5 / PAIRS, expected))
    observed = np.bincount(np.minimum(counts, most), minlength=most + 1)
    chance = stats.poisson.pmf(np.arange(most + 1), expected)
    chance[-1] = stats.poisson.sf(most - 1, expected)
    kept = chance * PAIRS >= 5
    pooled = [np.append(part[kept], part[~kept].sum()) for part in (observed, chance * PAIRS)]
    if pooled[1][-1] < 5:
        pooled = [np.append(part[:-2], part[-2:].sum()) for part in pooled]
    assert stats.chisquare(pooled[0], pooled[1] * PAIRS / pooled[1].sum()).pvalue > 1e-3


def test_gaps_are_exponential_and_an_hour_has_3600_seconds() -> None:
    # 60 arrivals expected in the horizon: the first ten are all there.
    arrivals = plans(scene(timeout_s=600.0, flow_per_hour=360.0), 500)
    times = np.array([[a.arrival_s for a in plan[:10]] for plan in arrivals])
    gaps = np.diff(times, axis=1, prepend=0.0)
    assert stats.kstest(gaps.ravel(), stats.expon(scale=10.0).cdf).pvalue > 1e-3
    # The median of an exponential gap is ln 2 over its rate: 250 in 3600 s.
    scenario = scene(flow_per_hour=250.0, first_at_trigger=False)
    (first, *_) = planned_arrivals(scenario, 0, {"arrival": [0.5]})
    assert first.arrival_s == pytest.approx(np.log(2) * 14.4, rel=1e-12)


@settings(max_examples=50)
@given(st.integers(0, 10**6), st.floats(1, 900), st.floats(1, 5), st.integers(8, 120))
def test_a_greater_flow_brings_the_same_people_earlier_and_a_longer_horizon_more(
    pair: int, flow: float, times: float, seconds: int
) -> None:
    def plan(flow: float, timeout_s: float) -> tuple[Arrival, ...]:
        return planned_arrivals(scene(timeout_s=timeout_s, flow_per_hour=flow), pair)

    late, early = plan(flow, seconds), plan(times * flow, seconds)
    assert [person.index for person in early] == list(range(len(early)))
    assert (np.diff([person.arrival_s for person in early]) >= 0).all()
    assert late == tuple(each for each in plan(flow, 3.0 * seconds) if each.arrival_s <= seconds)
    for one, other in zip(late, early[: len(late)], strict=True):
        assert one.arrival_s == pytest.approx(times * other.arrival_s, rel=1e-9)
        assert (one.side, one.quantile) == (other.side, other.quantile)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 1.0])
def test_sides_come_in_the_share_asked_for(share: float) -> None:
    found = plans(scene(flow_per_hour=600.0, near_side_share=share), 1000)
    sides = [a.side for plan in found for a in plan]
    near = sides.count(Side.NEAR)
    error = np.sqrt(share * (1 - share) / len(sides))
    assert abs(near / len(sides) - share) <= 4 * error


def test_the_first_at_the_trigger() -> None:
    plain = plans(scene(flow_per_hour=400.0), 300)
    at_trigger = plans(scene(flow_per_hour=400.0, first_at_trigger=True), 300)
    for plan, other in zip(at_trigger, plain, strict=True):
        assert plan[0].arrival_s == 0.0
        assert all(a.arrival_s > 0 for a in plan[1:])
        # Same people: sides and quantiles of pedestrian i do not move.
        for mine, theirs in zip(plan, other, strict=False):
            assert (mine.side, mine.quantile) == (theirs.side, theirs.quantile)
    # Those after them are Poisson from the trigger on: 400/60 in a minute.
    after = np.array([len(plan) - 1 for plan in at_trigger])
    assert abs(after.mean() - 400 / 60) < 4 * np.sqrt(400 / 60 / 300)


def test_no_flow_no_pedestrians() -> None:
    assert plans(scene(flow_per_hour=0.0), 20) == [()] * 20
    alone = plans(scene(flow_per_hour=0.0, first_at_trigger=True), 20)
    assert [[a.arrival_s for a in plan] for plan in alone] == [[0.0]] * 20
