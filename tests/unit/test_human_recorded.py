"""Human-Recorded: whom it answers, when it brakes, that it drives into nobody it can avoid.

v0 = 5 m/s from R = 30 m, steps of 0.1 s, so R = 30 − 0.5 k at step k.  The path, with 5 cm to
spare, is 1.05 to 3.45 m from the near kerb and 5.55 to 7.95 m from the far one.
"""

import numpy as np
import pytest

from harness.core.encounter import Arm, Side
from harness.scenario import Setting, load_scenario
from harness.strategies.human_recorded import HumanRecorded
from tests.scenes import braking_steps, on_plain, outcome_of, play


def first_braking_range(trace) -> float:
    return -float(trace.x_m[braking_steps(trace)[0]])


def test_who_comes_late_is_passed_and_who_was_seen_late_braked_for_in_the_end() -> None:
    # At 4 s it is 10 m away and gone after 15.3 m, 3.06 s later; she is in its path after 5.55 s.
    trace = play(HumanRecorded(horizon_s=20.0, go_first_s=3.0), [(4.0, Side.FAR, 1.0)])
    assert trace.speed_mps.min() == 5.0
    assert outcome_of(trace).record.contact is None
    # Full braking, 4.5 m/s², takes 25/9 = 2.78 m and a step's rest.
    driver = HumanRecorded(reaction_time_s=100.0, speed_among_people_mps=5.0)
    trace = play(driver, [(0.0, Side.NEAR, 0.3)])
    assert 3.08 <= first_braking_range(trace) <= 3.6
    assert outcome_of(trace).record.contact is None


def test_stops_comfortably_before_somebody_who_counts_and_goes_on_behind_them() -> None:
    # At 0.3 m/s they are in its path from 3.5 s to 11.5 s.  2 m/s² stops from 5 m/s in 6.25 m,
    # before R = 0.3 m; the step in which it begins starts at most 0.5 m earlier.
    driver = HumanRecorded(
        horizon_s=20.0,
        reaction_time_s=0.0,
        comfortable_deceleration_mps2=2.0,
        speed_among_people_mps=5.0,
    )
    trace = play(driver, [(0.0, Side.NEAR, 0.3)])
    assert 6.55 <= first_braking_range(trace) <= 7.05 + 1e-9
    assert np.diff(trace.speed_mps).min() / 0.1 > -2.2
    assert -trace.x_m[110] == pytest.approx(0.3, abs=1e-6)
    assert -trace.x_m[120] < 0.3
    assert outcome_of(trace).record.contact is None


def test_a_reaction_time_delays_yielding_alone() -> None:
    # 1 m/s² needs 12.5 m before R = 0.3 m; they are seen from 0 s on, so 4 s cost nothing, 5 s do.
    def begins(reaction_s: float) -> float:
        driver = HumanRecorded(
            horizon_s=20.0,
            reaction_time_s=reaction_s,
            comfortable_deceleration_mps2=1.0,
            speed_among_people_mps=5.0,
        )
        return first_braking_range(play(driver, [(0.0, Side.NEAR, 0.3)]))

    assert begins(0.0) == begins(3.0) > 12.8
    assert begins(4.0) == pytest.approx(10.0)


@pytest.mark.parametrize("pairs", [60, pytest.param(20_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("flow", [250.0, 1000.0])
def test_no_avoidable_crash_in_flows(flow, pairs, model) -> None:
    assert crashes(flow, range(pairs), model) == []


def crashes(flow, pairs, model) -> list[int]:
    """Pairs in which it had an avoidable crash with pedestrians of constant speed."""
    cell = load_scenario(
        "cctc_flow",
        [Setting("pedestrians.flow_per_hour", flow), Setting("arms.human", "human_recorded")],
    )
    runner = on_plain(cell, model)
    return [pair for pair in pairs if runner.run_arm(pair, Arm.HUMAN).record.avoidable]
