"""Gap-Yield in the shipped flow scenario: no crash in 2,000 pairs, and faster than Soft-Yield."""

import numpy as np
import pytest

from harness.core.encounter import Arm
from harness.scenario import Setting, load_scenario
from tests.scenes import on_plain

PAIRS = 2000


def pass_times(strategy: str, model) -> np.ndarray:
    """Of the AV's arm; the plain engine drives as SUMO does (test_engines_agree)."""
    settings = [Setting("arms.av", strategy), Setting("arms.human", "constant_speed")]
    scenario = load_scenario("cctc_flow", settings)
    outcomes = on_plain(scenario, model).run(range(PAIRS))
    records = [outcome.record for outcome in outcomes if outcome.arm is Arm.AV]
    assert {record.ending for record in records} == {"crossed"}
    return np.array([record.pass_time_s for record in records])


@pytest.mark.slow
def test_no_crash_and_less_time_than_soft_yield(model) -> None:
    gap, soft = (pass_times(name, model) for name in ("gap_yield", "soft_yield"))
    assert len(gap) == PAIRS
    saved = soft - gap
    # The same pedestrians: the mean of the differences, four standard errors above 0.
    assert saved.mean() > 4 * saved.std() / np.sqrt(PAIRS)
