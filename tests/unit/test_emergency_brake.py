"""The emergency brake: when it brakes, where it stands, when it goes on.

The ego is 1.8 m wide, its lane's centre 2.25 m from the near kerb: with the disc of 0.25 m its path
is 1.1 to 3.4 m from there.  It is at R = 30 − 5 t until it brakes at 4.5 m/s².
"""

import numpy as np
import pytest

from harness.core.vocabulary import Side
from harness.measures import measure
from harness.strategies.emergency_brake import EmergencyBrake
from tests.scenes import braking_steps, play

STEP = 0.1


def first_braking(trace) -> float | None:
    return next((step * STEP for step in braking_steps(trace)), None)


def test_brakes_at_the_threshold_stands_and_goes_on() -> None:
    # 0.5 m/s: in the path from 2.2 to 6.8 s.  TTC (R − 0.25)/5: 1.25 s at t = 4.7 s (R = 6.5 m),
    # 1.15 s at 4.8 s.
    trace = play(EmergencyBrake(), [(0.0, Side.NEAR, 0.5)])
    assert first_braking(trace) == pytest.approx(4.8)
    np.testing.assert_array_equal(trace.speed_mps[:49], 5.0)
    losses = -np.diff(trace.speed_mps)[48:] / STEP
    np.testing.assert_allclose(losses[:11], 4.5, atol=1e-9)
    # 25/9 m later, in the last step up to b step²/8 more.
    standing = -trace.x_m[trace.speed_mps == 0]
    assert standing[0] == pytest.approx(6.0 - 25 / 9, abs=4.5 * STEP**2 / 8)
    # They leave the path at 6.8 s; the sum of steps decides whether that step already starts it.
    moving = np.flatnonzero(trace.speed_mps[62:] > 0)[0] + 62
    assert moving in (69, 70)
    np.testing.assert_allclose(np.diff(trace.speed_mps)[moving : moving + 20], STEP, atol=1e-9)
    assert trace.speed_mps.max() == 5.0


@pytest.mark.parametrize(
    ("side", "speed", "threshold", "at"),
    # In the path from 2.2 s on, long before the ego: TTC = (R − 0.25)/5 = 5.95 − t.
    [(Side.NEAR, 0.5, 1.0, 5.0), (Side.NEAR, 0.5, 2.0, 4.0), (Side.NEAR, 0.5, 3.72, 2.3),
     (Side.NEAR, 0.5, 9.0, 0.0),
     # In the path only from 5.6 m / 0.93 m/s = 6.0215 s on: TTC = 6.0215 − t.
     (Side.FAR, 0.93, 1.0, 5.1), (Side.FAR, 0.93, 2.05, 4.0)],
)  # fmt: skip
def test_the_threshold(side: Side, speed: float, threshold: float, at: float) -> None:
    trace = play(EmergencyBrake(ttc_threshold_s=threshold), [(0.0, side, speed)])
    assert first_braking(trace) == pytest.approx(at)


@pytest.mark.parametrize(
    ("side", "speed", "brakes"),
    # The ego is over their line from 5.95 s (front, 0.25 m before it) to 7.05 s (rear past it).
    # They have left its path just before, or not; they walk into its flank, or when it has passed.
    [(Side.NEAR, 3.4 / 5.90, False), (Side.NEAR, 3.4 / 6.00, True), (Side.NEAR, 1.1 / 7.00, True),
     (Side.NEAR, 1.1 / 7.10, False), (Side.FAR, 7.9 / 5.90, False), (Side.FAR, 7.9 / 6.00, True),
     (Side.FAR, 5.6 / 7.10, False)],
)  # fmt: skip
def test_only_for_whom_it_would_hit(side: Side, speed: float, brakes: bool) -> None:
    trace = play(EmergencyBrake(), [(0.0, side, speed)])
    hit = measure([play(EmergencyBrake(ttc_threshold_s=1e-9), [(0.0, side, speed)])])[0]
    assert (first_braking(trace) is not None) is brakes
    # Without braking the geometry says the same.
    assert (hit.contact is not None) is brakes
