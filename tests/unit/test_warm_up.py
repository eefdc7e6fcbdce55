"""People who are on the crosswalk at the trigger, since they came before it."""

import numpy as np
import pytest

from harness.core.vocabulary import Side
from harness.encounter.arrivals import already_walking, planned_arrivals
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.scenario import Scenario
from tests.scenes import on_plain, scenario

FLOW = 900.0
PAIRS = 500


def scene(warm_up_s: float, **pedestrians: object) -> Scenario:
    people = {"flow_per_hour": FLOW, "warm_up_s": warm_up_s, **pedestrians}
    return scenario(pedestrians=people, arms={"human": "constant_speed"})


def present(warm_up_s: float, model, pairs: int = PAIRS):
    of = scene(warm_up_s)
    walking = WalkingSpeeds(of, model).unconditional
    return [already_walking(of, pair, walking, 0) for pair in range(pairs)]


@pytest.fixture(scope="module")
def sample(model) -> np.ndarray:
    """Walking speeds of whole rows drawn from the model: its marginal."""
    return model.mixture.sample(10_000, np.random.default_rng(1))[:, 2]


@pytest.mark.parametrize("warm_up_s", [4.0, 60.0])
def test_as_many_as_littles_law_says(warm_up_s: float, model, sample) -> None:
    # A Poisson number with mean λ E[min(L0/v_p, warm-up)].
    mean = FLOW / 3600 * np.minimum(9.0 / sample, warm_up_s).mean()
    counts = np.array([len(people) for people in present(warm_up_s, model)])
    assert counts.mean() == pytest.approx(mean, abs=4 * np.sqrt(mean / PAIRS))
    assert counts.var() == pytest.approx(mean, rel=4 * np.sqrt(2 / PAIRS))


def test_they_are_spread_over_the_crosswalk_slow_ones_more_often(model, sample) -> None:
    legs = [(p.side, *p.path) for people in present(60.0, model) for p in people]
    progress = np.array([leg.y_m if side is Side.NEAR else 9.0 - leg.y_m for side, leg in legs])
    speeds = np.array([abs(leg.y_mps) for _, leg in legs])
    assert ((progress >= 0) & (progress < 9.0)).all()
    # In a steady flow those present are spread evenly, and weighed by their time on it, 1/v_p.
    assert progress.mean() == pytest.approx(4.5, abs=4 * 9 / np.sqrt(12 * len(legs)))
    assert speeds.mean() == pytest.approx(1 / (1 / sample).mean(), abs=0.04)
    assert {side for side, _ in legs} == set(Side)
    assert all((leg.y_mps > 0) == (side is Side.NEAR) for side, leg in legs)


def test_both_arms_meet_them_on_the_crosswalk_at_the_trigger(model) -> None:
    of = scene(60.0, flow_per_hour=1800.0)
    walking, met = WalkingSpeeds(of, model).unconditional, 0
    for outcome in on_plain(of, model).run(range(10)):
        planned = len(planned_arrivals(of, outcome.pair))
        wanted = already_walking(of, outcome.pair, walking, planned)
        walks = {walk.arrival: walk for walk in outcome.trace.walks}
        assert [walks[person].start_s for person in wanted] == [0.0] * len(wanted)
        met += len(wanted)
    assert met > 50


def test_a_class_changes_nobody_who_came_before_the_trigger() -> None:
    kinds = [{"share": 0.5, "mean_mps": 1.0}]
    of = [scene(60.0, walking_speed={"mean_mps": 1.4, "classes": each}) for each in ([], kinds)]
    for pair in range(50):
        one, other = (already_walking(each, pair, lambda u, _: 0.5 + u, 0) for each in of)
        assert one == other
