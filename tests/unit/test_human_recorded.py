"""Human-Recorded: whom it answers, when it brakes, that it drives into nobody it can avoid.

v0 = 5 m/s from R = 30 m, steps of 0.1 s, so R = 30 − 0.5 k at step k.  The path, with 5 cm to
spare, is 1.05 to 3.45 m from the near kerb and 5.55 to 7.95 m from the far one.
"""

import numpy as np
import pytest

from harness.core.vocabulary import Arm, Side
from harness.scenario import load_scenario
from harness.strategies.human_recorded import HumanRecorded
from tests.scenes import braking_steps, on_plain, outcome_of, play


def first_braking_range(trace) -> float:
    return -float(trace.x_m[braking_steps(trace)[0]])


def test_who_comes_late_is_passed_and_who_steps_out_late_is_braked_for_in_the_end() -> None:
    # At 4 s it is 10 m away and gone after 15.3 m, 3.06 s later; she is in its path after 5.55 s.
    trace = play(HumanRecorded(), [(4.0, Side.FAR, 1.0)])
    assert trace.speed_mps.min() == 5.0
    assert outcome_of(trace).record.contact is None
    # At 5 s, 5 m away, they step off and are in its path from 5.7 to 7.3 s.  Full braking, 4.5
    # m/s², takes 25/9 = 2.78 m and a step's rest, before the reaction time is over.
    trace = play(HumanRecorded(), [(5.0, Side.NEAR, 1.5)])
    assert 3.08 <= first_braking_range(trace) <= 3.6
    assert outcome_of(trace).record.contact is None


def test_stops_gently_before_somebody_who_counts_and_goes_on_behind_them() -> None:
    # At 0.3 m/s they are in its path from 3.5 s to 11.5 s, so they count from 3 s on; after 0.5 s
    # more, and at most a step, it is 12.5 to 12 m away and stops before R = 0.3 m: at most
    # 25 / (2 · 11.7) = 1.07 m/s².
    trace = play(HumanRecorded(), [(0.0, Side.NEAR, 0.3)])
    assert 12.0 - 1e-9 <= first_braking_range(trace) <= 12.5 + 1e-9
    assert np.diff(trace.speed_mps).min() / 0.1 > -1.07
    assert -trace.x_m[110] == pytest.approx(0.3, abs=1e-6)
    assert -trace.x_m[120] < 0.3
    assert outcome_of(trace).record.contact is None


@pytest.mark.parametrize("pairs", [40, pytest.param(20_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("flow", [250.0, 1000.0])
@pytest.mark.parametrize("driver", ["human_recorded", "human_yield", "gap_yield"])
def test_no_avoidable_crash_in_flows(driver, flow, pairs, model) -> None:
    """With pedestrians of constant speed, who may step off whenever the kerb rule lets them."""
    settings = {"pedestrians.flow_per_hour": flow, "arms.human": driver}
    runner = on_plain(load_scenario("cctc_flow", settings), model)
    hit = [n for n in range(pairs) if runner.run_arm(n, Arm.HUMAN).record.avoidable]
    assert hit == []
