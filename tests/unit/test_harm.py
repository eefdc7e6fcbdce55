"""Risks of injury and death at the points of Tefft 2013, between, below and above them."""

import math

import numpy as np
import pytest

from harness.core.encounter import Ending, Side
from harness.measures import measure
from harness.measures.harm import _DEATH_MPS, _INJURY_MPS, risk_at
from tests.scenes import drive

MPH = 0.44704
INJURY = {17.1: 0.10, 24.9: 0.25, 33.0: 0.50, 40.8: 0.75, 48.1: 0.90}
DEATH = {24.1: 0.10, 32.5: 0.25, 40.6: 0.50, 48.0: 0.75, 54.6: 0.90}


@pytest.mark.parametrize(("speeds", "table"), [(_INJURY_MPS, INJURY), (_DEATH_MPS, DEATH)])
def test_risks_of_the_source(speeds, table) -> None:
    at = MPH * np.array([*table])
    np.testing.assert_allclose(risk_at(at, speeds), [*table.values()], rtol=1e-12)
    # The paper's logistic curve has a slope near 0.142 and 0.144 per mph: between the outer points
    # the interpolation is within a few per cent of it.
    slope, middle = (0.142, 33.0) if table is INJURY else (0.144, 40.6)
    between = np.linspace(min(table), max(table), 50)
    curve = 1 / (1 + np.exp(-slope * (between - middle)))
    np.testing.assert_allclose(risk_at(MPH * between, speeds), curve, atol=0.02)
    # Half of the lowest point's speed has half of its risk, which is above the curve's.
    lowest = min(table)
    assert risk_at(np.array([MPH * lowest / 2]), speeds)[0] == pytest.approx(0.05)
    assert risk_at(np.array([0.0]), speeds)[0] == 0.0
    # Above the highest point one more last stretch adds its logit, ln 9 − ln 3.
    highest, before = sorted(table)[-1], sorted(table)[-2]
    more = risk_at(MPH * np.array([2 * highest - before]), speeds)[0]
    assert math.log(more / (1 - more)) == pytest.approx(2 * math.log(9) - math.log(3))
    fine = risk_at(np.linspace(0.0, 60.0, 5000), speeds)
    assert (np.diff(fine) > 0).all()


def test_only_the_front_has_a_risk() -> None:
    # 5 m/s is below the lowest points: 0.1 v/17.1 mph and 0.1 v/24.1 mph.
    (front,) = measure([drive([0.0] * 76, [(0.0, Side.FAR, 1.0)])])
    assert (front.contact, front.contact_speed_mps) == ("front", pytest.approx(5.0))
    assert front.injury_risk == pytest.approx(0.1 * 5 / (17.1 * MPH))
    assert front.fatality_risk == pytest.approx(0.1 * 5 / (24.1 * MPH))
    (side,) = measure([drive([0.0] * 76, [(5.4, Side.NEAR, 1.0)])])
    assert (side.contact, side.injury_risk, side.fatality_risk) == ("side", None, None)
    # Whoever walks into a standing front is not hurt by this measure.
    stands = drive([-1.0] * 50 + [0.0] * 20, speed=5.0, ending=Ending.TIMED_OUT)
    (none,) = measure([stands])
    assert none.injury_risk is None
