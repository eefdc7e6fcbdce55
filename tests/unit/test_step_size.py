"""Results do not hang on the step: the method is exact on its grid, or off by a step at most."""

import pytest

from harness.core.encounter import Side
from harness.measures import EpisodeRecord, measure
from harness.scenario import Scenario
from harness.strategies.constant_speed import ConstantSpeed
from harness.strategies.hard_yield import HardYield
from harness.strategies.soft_yield import SoftYield
from tests.scenes import on_plain, play, scenario

# Walkers for whom Soft-Yield has an answer at (30 m, 5 m/s): 0.976 to 1.5 m/s.
WINDOW = [0.98, 1.0, 1.037, 1.1, 1.2, 1.25, 1.3, 1.337, 1.4, 1.45, 1.49]


def with_step(step_s: float) -> Scenario:
    return scenario(experiment={"step_s": step_s})


def record_of(strategy, step_s: float, *walkers: tuple[float, Side, float]) -> EpisodeRecord:
    (record,) = measure([play(strategy(), walkers, with_step(step_s))])
    return record


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("walking_speed", WINDOW)
def test_soft_yield_inside_its_window(walking_speed: float, side: Side) -> None:
    # Arrival is exact at any step; what is left is the moment of resuming, at a step's end.
    walker = (0.0, side, walking_speed)
    times = [record_of(SoftYield, step, walker).pass_time_s for step in (0.1, 0.05, 0.025)]
    assert abs(times[0] - times[1]) < 1e-3
    assert abs(times[1] - times[2]) < 1e-3


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("walking_speed", [0.3, 0.5, 0.8, 0.97, *WINDOW, 1.6, 2.5])
@pytest.mark.parametrize("strategy", [HardYield, ConstantSpeed, SoftYield])
def test_others_by_one_coarse_step_at_most(strategy, walking_speed: float, side: Side) -> None:
    coarse, fine = (record_of(strategy, step, (0.0, side, walking_speed)) for step in (0.1, 0.05))
    # Whoever is hit at one step is hit at the other, at the same moment.
    assert coarse.ending is fine.ending
    if coarse.contact is not None:
        assert strategy is ConstantSpeed
        assert coarse.contact_time_s == pytest.approx(fine.contact_time_s, abs=1e-9)
    else:
        assert abs(coarse.pass_time_s - fine.pass_time_s) <= 0.1 + 1e-9


def test_the_papers_pairs_by_one_coarse_step_at_most(model) -> None:
    # Both arms of the paper's experiment: same pedestrians, half the step.
    def pass_times(step_s: float) -> list[float | None]:
        scene = scenario(
            pedestrians={"max_count": 1, "first_at_trigger": True}, experiment={"step_s": step_s}
        )
        runner = on_plain(scene, model)
        return [outcome.record.pass_time_s for outcome in runner.run(range(40))]

    coarse, fine = pass_times(0.1), pass_times(0.05)
    assert sum(time is not None for time in coarse) > 70
    for one, other in zip(coarse, fine, strict=True):
        if one is None or other is None:
            assert one is other
        else:
            assert abs(one - other) <= 0.1 + 1e-9
