"""Outside the interaction model's box: refused or counted, and the ways to do without it."""

import numpy as np
import pytest
from scipy import stats

from harness.core.vocabulary import Arm, Arrival, Side
from harness.encounter.arms import check_arms
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.measures import Outcome
from harness.model.interaction import ModelUseCounter
from harness.model.mixture.conditional import Conditional
from harness.results.cell_findings import cell_findings
from harness.results.rows import episode_rows
from harness.scenario import Cell, Scenario
from tests.scenes import on_plain, refusal_of, scenario

FAST = {"initial_speed_mps": 13.89, "trigger_range_m": 80.0}
ISSUE = {"ego": FAST, "crossing": {"length_m": 14.0}, "pedestrians": {"flow_per_hour": 120.0}}
NO_MODEL = {"pedestrians": {"flow_per_hour": 120.0, "walking_speed": {"mean_mps": 1.34}}}
YIELDS = {"arms": {"av": "hard_yield", "human": "human_yield"}}


def run(scene: Scenario, model, pairs: int = 20) -> list[Outcome]:
    return list(on_plain(scene, model).run(range(pairs)))


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        (ISSUE, "ego.initial_speed_mps"),
        ({"ego": {"trigger_range_m": 61.0}}, "ego.trigger_range_m"),
        # The walkers do without the model, the human driver does not; and the other way round.
        ({**NO_MODEL, "ego": FAST}, "ego.initial_speed_mps"),
        ({**YIELDS, "ego": FAST}, "ego.initial_speed_mps"),
    ],
)
def test_a_trigger_outside_the_box_is_refused(changes, key: str, model) -> None:
    scene = scenario(**changes)
    refusal_of(lambda: check_arms(scene, model), key, "model.extrapolate")
    check_arms(scenario(**changes, model={"extrapolate": True}), model)


def test_the_issues_case_says_how_often_the_model_was_asked_outside(model) -> None:
    scene = scenario(**ISSUE, model={"extrapolate": True})
    outcomes = run(scene, model)
    # Every walker who saw the car beyond the box's 60 m or faster than its 8 m/s, by hand.
    for outcome in outcomes:
        looks = [
            (walk.range_m, walk.vehicle_speed_mps)
            for walk in outcome.trace.walks
            if walk.start_s is not None and walk.range_m > 0
        ]
        outside = [look for look in looks if look[0] > 60.0 or look[1] > 8.0]
        record = outcome.record
        if outcome.arm is Arm.AV:
            assert (record.conditionings, record.clamped) == (len(looks), len(outside))
        else:
            # The human driver asks too, once a decision and pedestrian.
            assert record.conditionings >= len(looks)
            assert record.clamped >= len(outside)
        if outside:
            assert record.clamped_speed_excess_mps >= max(v for _, v in outside) - 8.0 - 1e-9
            assert record.clamped_range_excess_m >= max(r for r, _ in outside) - 60.0 - 1e-9
        else:
            assert outcome.arm is Arm.HUMAN or record.clamped_speed_excess_mps is None
    tables = {"episodes": episode_rows(0, outcomes)}
    found = cell_findings(Cell(0, {}, scene), tables, 0.0)
    assert float(found["clamped_share"].value) > 0.5


def test_near_and_standing_cars_are_counted_apart_and_the_last_bit_decides_nothing(model) -> None:
    counter = ModelUseCounter(model)
    states = [(30.0, 5.0), (1.0, 3.0), (20.0, 0.0), (60.0, 8.0), (61.0, 5.0), (30.0, 9.0)]
    for state in states:
        counter.note(*state)
    assert counter.counts == (6, 2, 2, pytest.approx(1.0), pytest.approx(1.0))
    outcomes = run(scenario(pedestrians={"flow_per_hour": 600.0}), model)
    assert sum(outcome.record.near_clamped for outcome in outcomes) > 0
    assert sum(outcome.record.clamped for outcome in outcomes) == 0
    counter = ModelUseCounter(model)
    for excess in (-1e-12, 0.0, 1e-12):
        counter.note(30.0, 0.3 + excess)
        counter.note(2.0 + excess, 5.0)
        counter.note(60.0, 8.0 + excess)
    assert (counter.counts.uses, counter.counts.clamped, counter.counts.near_clamped) == (9, 0, 0)
    counter.note(30.0, 0.2999)
    assert counter.counts.near_clamped == 1


def speeds(scene: Scenario, model, quantiles: np.ndarray, *state: float) -> np.ndarray:
    choose = WalkingSpeeds(scene, model)
    return np.array([choose(Arrival(0, 0.0, Side.NEAR, u), *state) for u in quantiles.tolist()])


def test_walking_speeds_without_a_look_at_the_car(model) -> None:
    scene = scenario(pedestrians={"walking_speed": {"mean_mps": 0.9, "std_mps": 0.5}})
    quantiles = np.array([0.0, 0.01, 0.3, 0.5, 0.97])
    wanted = stats.truncnorm((0.3 - 0.9) / 0.5, np.inf, 0.9, 0.5).ppf(quantiles)
    for state in ((30.0, 5.0), (80.0, 13.9), (-1.0, 3.0)):
        np.testing.assert_allclose(speeds(scene, model, quantiles, *state), wanted, atol=1e-12)
    scene = scenario(model={"pedestrian_reading": "unconditional"})
    quantiles = np.linspace(0.05, 0.95, 7)
    wanted = Conditional(model.mixture, 2, ()).ppf(quantiles, np.empty((7, 0)))
    for state in ((30.0, 5.0), (80.0, 13.9)):
        np.testing.assert_allclose(speeds(scene, model, quantiles, *state), wanted, rtol=1e-12)
    # Given the car they walk at another speed.
    assert np.abs(speeds(scenario(), model, quantiles, 30.0, 5.0) - wanted).max() > 1e-3
