"""The human driver of the paper (section III-D), its modes found here on a dense grid."""

import numpy as np
import pytest
from scipy import stats

from harness import Arm, Crossing, EgoView, Observation, PedestrianView, Side, Vehicle
from harness.core.vocabulary import Trace
from harness.encounter.arms import make_strategy
from harness.model.interaction import InteractionModel
from harness.model.mixture.conditional import Conditional
from harness.strategies.human_gmm import HumanGmm
from tests.densities import Joint
from tests.scenes import play, scenario

V0, A0, STEP = 5.0, 1.0, 0.1
CROSSING = Crossing(9.0, 4.0, 2.25, 4.5)
VEHICLE = Vehicle(V0, 30.0, 30.0, 5.0, 1.8, 3.0, 4.5, A0)


def driver(model: InteractionModel, **parameters) -> HumanGmm:
    rng = np.random.default_rng(3)
    return HumanGmm(model=model, rng=rng, step_s=STEP, **parameters)


def desired(
    joint: Joint, range_m: float, speed: float, lateral_m: float, pace: float, reading: str
) -> float:
    """The mode of f(v | 1/R, v_p[, 1/T_adv]) on a grid of 0.5 mm/s, arguments clamped."""
    r = float(np.clip(1 / range_m, joint.lower[0], joint.upper[0]))
    walking = float(np.clip(pace, joint.lower[2], joint.upper[2]))
    if reading == "marginal":
        return joint.driver_mode(r, walking, None)
    advantage = abs(range_m / speed - lateral_m / pace) if speed > 0 else np.inf
    inverse = 1 / advantage if advantage > 0 else np.inf
    return joint.driver_mode(r, walking, float(np.clip(inverse, joint.lower[3], joint.upper[3])))


def commanded(joint: Joint, trace: Trace, reading: str, interval_s: float = 1.0) -> list[float]:
    """What the driver must have commanded at every decision of an episode."""
    accelerations = []
    every = round(interval_s / STEP)
    for n in range(0, len(trace.x_m) - 1, every):
        time, speed, range_m = n * STEP, float(trace.speed_mps[n]), -float(trace.x_m[n])
        present = []
        for walk in trace.walks:
            walked = walk.speed_mps * (time - walk.start_s)
            if -1e-9 <= walked < 9.0 and range_m <= 30.0:
                to_lane = 2.25 if walk.arrival.side is Side.NEAR else 6.75
                present.append((to_lane - walked, walk.speed_mps))
        if not present or range_m <= 0:
            wanted = float(np.clip((V0 - speed) / interval_s, -A0, A0))
        else:
            modes = [desired(joint, range_m, speed, lat, pace, reading) for lat, pace in present]
            wanted = float(np.clip((min(*modes, V0) - speed) / interval_s, -4.5, 3.0))
        accelerations.append(wanted)
    return accelerations


WALKERS = [
    [(0.0, Side.NEAR, 1.2)],
    [(0.0, Side.FAR, 0.8)],
    [(0.0, Side.FAR, 1.7), (1.3, Side.NEAR, 0.9)],
    [(0.0, Side.NEAR, 1.4), (0.5, Side.NEAR, 2.2), (4.0, Side.FAR, 1.0)],
]


@pytest.mark.parametrize("reading", ["given_time_advantage", "marginal"])
@pytest.mark.parametrize("walkers", WALKERS)
def test_accelerations_are_mode_minus_speed(model, joint, walkers, reading: str) -> None:
    trace = play(driver(model, reading=reading), walkers)
    gains = np.diff(trace.speed_mps) / STEP
    expected = commanded(joint, trace, reading)
    for n, wanted in enumerate(expected):
        held = gains[10 * n : 10 * (n + 1)]
        before = trace.speed_mps[10 * n : 10 * (n + 1)][: len(held)]
        # Held over the whole second; standing is as far as braking goes.
        moving = before + wanted * STEP >= 0
        # The grid is 0.5 mm/s wide.
        np.testing.assert_allclose(held[moving], wanted, atol=1e-3)
        np.testing.assert_allclose(before[~moving] + held[~moving] * STEP, 0.0, atol=1e-9)
    assert len({round(wanted, 3) for wanted in expected}) > 2


def observe(range_m: float, speed: float, *walkers: tuple[float, float]) -> Observation:
    """Walkers from the near side as (metres walked, speed)."""
    views = tuple(
        PedestrianView(i, Side.NEAR, 2.25 - walked, 9 - walked, pace, True)
        for i, (walked, pace) in enumerate(walkers)
    )
    return Observation(0.0, STEP, EgoView(range_m, speed, 0.0), VEHICLE, CROSSING, views)


def test_decisions_about_one_person_by_hand(model) -> None:
    # 8 m walked, 5.75 m past the lane's centre: still on the crossing.
    decision = driver(model).decide(observe(15.0, 5.0, (8.0, 1.2)))
    speed_mps = model.driver_speed(15.0, 1.2, 1 / abs(15 / 5 + 5.75 / 1.2))
    assert decision == pytest.approx(speed_mps - 5.0, abs=1e-9)
    waiting = PedestrianView(0, Side.NEAR, 2.25, 9.0, 0.0, False)
    seen = observe(20.0, 4.0)._replace(pedestrians=(waiting,))
    assert driver(model).decide(seen) == 1.0
    # v = 0: T_adv is infinite, 1/T_adv = 0.
    decision = driver(model).decide(observe(6.0, 0.0, (4.0, 1.2)))
    assert decision == pytest.approx(min(3.0, model.driver_speed(6.0, 1.2, 0.0), V0), abs=1e-9)
    # Δt = 0.1 s asks for ten times the acceleration: −4.5 and +3 m/s² are the ends.
    hard = driver(model, decision_interval_s=0.1)
    assert hard.decide(observe(4.0, 5.0, (1.0, 1.0))) == -4.5
    soft = driver(model, decision_interval_s=0.1)
    assert soft.decide(observe(28.0, 0.0, (1.0, 1.0))) == 3.0


def test_sampled_speeds_follow_the_density_and_the_pair(model) -> None:
    # One decision of 2,000 pairs: Kolmogorov–Smirnov against the model's CDF at that state.
    scene = scenario(strategies={"human_gmm": {"speed": "sampled", "reading": "marginal"}})
    seen = observe(25.0, 2.5, (1.0, 1.2))

    def decisions() -> np.ndarray:
        return np.array(
            [make_strategy(scene, Arm.HUMAN, pair, model).decide(seen) for pair in range(2000)]
        )

    first = decisions()
    np.testing.assert_array_equal(first, decisions())
    assert len(set(first)) > 1000
    drawn = first[(first < V0 - 2.5 - 1e-9)] + 2.5  # below the cap
    conditional = Conditional(model.mixture, 1, (0, 2))
    y = np.repeat([[1 / 25, 1.2]], len(drawn), axis=0)
    u = conditional.cdf(drawn, y)
    top = conditional.cdf(np.array([V0]), y[:1])[0]
    assert stats.kstest(u / top, "uniform").pvalue > 1e-3
    assert abs(len(drawn) / 2000 - top) < 4 * np.sqrt(top * (1 - top) / 2000)
