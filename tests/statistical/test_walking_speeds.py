"""What is drawn from the interaction model, against integrals written out (``tests.densities``)."""

import numpy as np
import pytest
from scipy import stats

from harness.encounter.arrivals import planned_arrivals
from harness.model.interaction import InteractionModel
from harness.scenario import load_scenario
from tests.densities import VP, Joint, R, V, W


@pytest.fixture(scope="module")
def joint(model: InteractionModel) -> Joint:
    return Joint(model.mixture)


def test_walking_speeds_at_the_trigger(model: InteractionModel, joint: Joint) -> None:
    # The quantiles the paper's experiment plans, pushed through f(v_p | 1/30, 5).
    scenario = load_scenario("cctc")
    quantiles = np.array([planned_arrivals(scenario, pair)[0].quantile for pair in range(10_000)])
    drawn = [model.walking_speed(u, 30.0, 5.0) for u in quantiles.tolist()]
    paces, cdf = joint.walking_speed_cdf(30.0, 5.0)
    assert stats.kstest(drawn, lambda v: np.interp(v, paces, cdf)).pvalue > 0.01
    # The test can tell: the unconditional density and one without truncation are refused.
    other = [model.walking_speed_unconditional(u) for u in quantiles[:1000].tolist()]
    assert stats.kstest(other, lambda v: np.interp(v, paces, cdf)).pvalue < 1e-6


@pytest.mark.parametrize(("range_m", "speed"), [(30.0, 5.0), (8.0, 1.2), (15.0, 7.5), (55.0, 3.0)])
def test_quantiles_against_integration(model, joint, range_m, speed) -> None:
    u = np.linspace(0.001, 0.999, 400)
    drawn = [model.walking_speed(each, range_m, speed) for each in u.tolist()]
    paces, cdf = joint.walking_speed_cdf(range_m, speed)
    np.testing.assert_allclose(np.interp(drawn, paces, cdf), u, atol=1e-4)


def test_conditions_outside_the_support_are_clamped(model: InteractionModel) -> None:
    lower, upper = model.mixture.lower, model.mixture.upper
    for range_m, speed in ((0.5, 0.0), (150.0, 30.0)):
        clamped = 1 / np.clip(1 / range_m, lower[R], upper[R]), np.clip(speed, lower[V], upper[V])
        for u in (0.1, 0.5, 0.9):
            expected = model.walking_speed(u, *map(float, clamped))
            assert model.walking_speed(u, range_m, speed) == pytest.approx(expected, rel=1e-12)


def test_the_unconditional_walking_speed(model: InteractionModel, joint: Joint) -> None:
    # Importance sampling over the whole box: F at three speeds within four standard errors.
    rng = np.random.default_rng(5)
    points = rng.uniform(joint.lower, joint.upper, size=(300_000, 4))
    values = joint.density(*points.T)
    for u in (0.2, 0.5, 0.8):
        below = points[:, VP] <= model.walking_speed_unconditional(u)
        share = values[below].sum() / values.sum()
        error = np.sqrt((values**2 * (below - share) ** 2).sum()) / values.sum()
        assert abs(share - u) < 4 * error


@pytest.mark.parametrize("reading", ["given_time_advantage", "marginal"])
def test_modes_match_a_dense_grid(model: InteractionModel, joint: Joint, reading: str) -> None:
    rng = np.random.default_rng(6)
    missed = 0
    for _ in range(200 if reading == "given_time_advantage" else 25):
        r, pace = rng.uniform(joint.lower[[R, VP]], joint.upper[[R, VP]])
        w = rng.beta(1, 4) * joint.upper[W] if reading == "given_time_advantage" else None
        found = model.driver_speed(1 / r, pace, w)
        best = joint.driver_mode(r, pace, w)
        if abs(found - best) > 1e-3:
            # Of two equally high peaks either is the mode; the grid sees no difference.
            assert w is not None, (r, pace)
            heights = joint.density(r, np.array([found, best]), pace, w)
            assert heights[0] > (1 - 1e-5) * heights[1], (r, pace, w)
            missed += 1
    assert missed < 5
