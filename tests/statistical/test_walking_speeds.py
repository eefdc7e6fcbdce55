"""What is drawn from the interaction model, against integrals written out (``tests.densities``)."""

import numpy as np
import pytest

from harness.model.interaction import InteractionModel
from tests.densities import VP, Joint, R, V


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
