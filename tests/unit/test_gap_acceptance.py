"""Pedestrians who wait for a gap of their own: who they are, and when they go."""

import math

import numpy as np
import pytest
from scipy import stats

from harness.core.vocabulary import Arrival, Side
from harness.encounter.arrivals import critical_gap_s, planned_arrivals
from harness.scenario import Scenario, validate
from harness.scenario.pedestrians import GapAcceptanceSection
from tests.closed_forms import lognormal
from tests.scenes import Recorder, episode


def scene(**pedestrians: object) -> Scenario:
    return validate({"pedestrians": {"behaviour": "gap_acceptance", **pedestrians}}, "test")


def cross(gap_s: float | None, arrival_s: float, command=lambda _: 0.0, **pedestrians: object):
    """The walk of one person with that critical gap."""
    arrival = Arrival(0, arrival_s, Side.NEAR, 0.5, gap_s)
    return episode(scene(**pedestrians), Recorder(command), [arrival]).walks[0]


@pytest.mark.parametrize(
    ("gap_s", "arrival_s", "goes"),
    # At 5 m/s from R = 30 m the near edge (R = 2 m) is 5.6 s − t away.
    # kerb_wait_s, 2 s here, is not their rule.
    [(3.0, 2.5, True), (3.0, 2.59, True), (3.0, 2.61, False), (5.5, 0.05, True), (5.7, 0.0, False),
     (0.5, 5.0, True)],
)  # fmt: skip
def test_goes_while_the_gap_is_longer(gap_s: float, arrival_s: float, goes: bool) -> None:
    walk = cross(gap_s, arrival_s)
    assert walk.start_s == (arrival_s if goes else None)


def test_waits_until_the_ego_yields_or_leaves_a_long_gap() -> None:
    # From 1 s on, 23 m before the edge, 1 m/s² stops it in 12.5 m; they see that a step later.
    walk = cross(8.0, 0.5, lambda o: -1.0 if o.time_s > 0.95 else 0.0)
    assert walk.start_s == pytest.approx(1.1, abs=1e-9)
    assert walk.vehicle_speed_mps == pytest.approx(4.9)
    # From 5 m/s to 2 m/s with 2 m/s² until 2.5 s: 30 − 5 − 5.25 = 19.75 m, 17.75 m to the edge.
    # It keeps 2 m/s then, so at 3.05 s the edge is 16.65 m, 8.325 s, away.
    slow = lambda o: -2.0 if 0.95 < o.time_s < 2.45 else 0.0  # noqa: E731
    assert cross(8.3, 3.05, slow).start_s == 3.05
    assert cross(8.35, 3.05, slow).start_s is None


@pytest.mark.parametrize(
    ("distribution", "mean", "std", "reference"),
    [
        ("lognormal", 4.0, 2.5, lognormal(4.0, 2.5)),
        ("lognormal", 6.2, 0.7, lognormal(6.2, 0.7)),
        ("logistic", 4.0, 1.5, stats.logistic(loc=4.0, scale=1.5 * math.sqrt(3) / math.pi)),
    ],
)
def test_gaps_are_as_distributed(distribution, mean, std, reference) -> None:
    gaps = GapAcceptanceSection(distribution=distribution, mean_s=mean, std_s=std)
    assert (reference.mean(), reference.std()) == pytest.approx((mean, std))
    uniform = np.linspace(0.05, 0.999, 21)
    found = [critical_gap_s(u, gaps) for u in uniform]
    np.testing.assert_allclose(found, reference.ppf(uniform), rtol=1e-12)
    equal = GapAcceptanceSection(distribution=distribution, mean_s=mean, std_s=0.0)
    assert critical_gap_s(0.1, equal) == pytest.approx(mean)


def test_gaps_are_those_of_people() -> None:
    # Brewer et al. (2006): 85th percentiles of accepted gaps at eleven approaches, 5.3 to 9.4 s.
    assert 5.3 < critical_gap_s(0.85, GapAcceptanceSection()) < 9.4
    narrow = GapAcceptanceSection(distribution="logistic", mean_s=4.0, std_s=1.5)
    assert critical_gap_s(1e-6, narrow) == 0.0


def test_planned_gaps_are_as_distributed_and_change_nothing_else() -> None:
    waiting = scene(flow_per_hour=900.0)
    steady = validate({"pedestrians": {"flow_per_hour": 900.0}}, "test")
    found = []
    for pair in range(400):
        plan, other = planned_arrivals(waiting, pair), planned_arrivals(steady, pair)
        assert [arrival._replace(critical_gap_s=None) for arrival in plan] == list(other)
        found += [arrival.critical_gap_s for arrival in plan]
    assert len(found) > 5000
    assert stats.kstest(found, lognormal(4.0, 2.5).cdf).pvalue > 1e-3
    # Who walks fast is not who takes short gaps.
    quantiles = [a.quantile for pair in range(400) for a in planned_arrivals(waiting, pair)]
    assert abs(stats.spearmanr(found, quantiles).statistic) < 4 / math.sqrt(len(found))
