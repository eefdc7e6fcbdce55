"""How rare an event is: the estimator on probabilities known in closed form, and its parts."""

import math

import numpy as np
import pytest
from scipy import stats

from harness.encounter import Ending
from harness.errors import InputError
from harness.risk.estimation import estimate_of, estimate_probability
from harness.risk.event import parse_event
from harness.risk.proposal import NOMINAL_SHARE, fit_proposal, nominal
from harness.risk.space import MOST_DIMENSIONS, space_of
from harness.scenario import Scenario, validate
from tests.risks import DIMENSIONS, half_space, union


@pytest.mark.parametrize("p", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("case", [half_space, union])
def test_known_probabilities_lie_near_the_estimate(case, p: float) -> None:
    score, truth = case(p)
    findings = estimate_probability(score, DIMENSIONS, np.random.default_rng(5))
    estimate = findings.estimate
    assert estimate.probability is not None
    # Five standard errors of a coefficient of variation of 0.1, which was asked for.
    assert abs(estimate.probability / truth - 1) < 0.5
    assert estimate.ci_low < estimate.probability < estimate.ci_high
    assert estimate.coefficient_of_variation < 0.15
    episodes = findings.first_draw + estimate.draws
    brute_force = (1 - truth) / truth / estimate.coefficient_of_variation**2
    if p == 1e-4:
        assert episodes < brute_force / 20
    if p == 1e-6:
        assert episodes < brute_force / 1000


def test_an_event_that_everybody_meets() -> None:
    findings = estimate_probability(
        lambda z, _: -np.ones((len(z), 1)), DIMENSIONS, np.random.default_rng(1)
    )
    assert findings.estimate.probability == 1
    assert findings.estimate.ci_high == 1


def test_an_event_that_nobody_meets_is_bounded_not_zero() -> None:
    findings = estimate_probability(
        lambda z, _: np.full((len(z), 1), np.inf), DIMENSIONS, np.random.default_rng(1)
    )
    estimate = findings.estimate
    assert estimate.probability is None
    # All draws are nominal: (1 − p)^n = 0.05.
    assert estimate.ci_high == pytest.approx(1 - 0.05 ** (1 / estimate.draws))
    assert estimate.draws == findings.first_draw + 2_000


def test_failed_episodes_are_no_events_but_are_weighed() -> None:
    def score(z: np.ndarray, _: str) -> np.ndarray:
        values = 1.5 - z[:, 0]
        return np.where(z[:, 1] > 0, np.nan, values)[:, None]

    findings = estimate_probability(score, 2, np.random.default_rng(1))
    tail = stats.norm.sf(1.5)
    assert findings.estimate.probability == pytest.approx(tail / 2, rel=0.5)
    assert findings.failed_weight == pytest.approx(0.5, abs=0.1)


def test_brute_force_is_the_special_case() -> None:
    weight, event = np.ones(1_000), np.arange(1_000) < 3
    estimate = estimate_of(weight, event)
    low, high = stats.binomtest(3, 1_000).proportion_ci(method="exact")
    assert (estimate.probability, estimate.ci_low, estimate.ci_high) == pytest.approx(
        (0.003, low, high)
    )


def test_weights_are_bounded_and_have_mean_one() -> None:
    rng = np.random.default_rng(3)
    failures = rng.standard_normal((300, 4)) * 0.2 + np.array([4.0, 0, 0, 0])
    proposal = fit_proposal(failures, np.ones(300), rng)
    weights = np.exp(proposal.log_weight(proposal.draw(100_000, rng)))
    assert weights.max() <= 1 / NOMINAL_SHARE * (1 + 1e-9)
    # E_q[φ/q] = 1, with a standard error of 0.01 at most.
    assert abs(weights.mean() - 1) < 0.05
    assert (np.exp(nominal(4).log_weight(failures)) == 1).all()


class Record:
    """An episode's record as far as an event looks at it."""

    def __init__(self, ending: Ending, **values: float) -> None:
        names = ("min_ttc_s", "pet_s", "min_gap_m", "contact_speed_mps", "max_drac_mps2")
        self.ending = ending
        for name in names:
            setattr(self, name, values.get(name))


def test_scores_fall_towards_the_event() -> None:
    crash = parse_event("crashed")
    nobody = Record(Ending.CROSSED)
    far = Record(Ending.CROSSED, min_gap_m=3.0)
    near = Record(Ending.CROSSED, min_gap_m=3.0, pet_s=2.0)
    nearer = Record(Ending.CROSSED, min_gap_m=1.0, pet_s=2.0, min_ttc_s=0.5)
    crashed = Record(Ending.CRASHED, contact_speed_mps=0.0, min_gap_m=0.0)
    graded = [crash.scores(record) for record in (nobody, far, near, nearer, crashed)]
    for scores in zip(*graded, strict=True):
        assert list(scores) == sorted(scores, reverse=True)
        assert scores[0] == math.inf
        assert scores[-2] > 0 >= scores[-1]
    assert all(map(math.isnan, crash.scores(Record(Ending.ENGINE_FAILED))))


def test_a_crash_is_in_an_event_that_it_leaves_undefined() -> None:
    event = parse_event("max_drac_mps2>8")
    assert event.holds(Record(Ending.CRASHED))
    assert not event.holds(Record(Ending.CROSSED))
    assert event.scores(Record(Ending.CROSSED, max_drac_mps2=5.0)) == (3.0, 3.0, 3.0)
    speed = parse_event("contact_speed_mps > 5")
    assert not speed.holds(Record(Ending.CRASHED, contact_speed_mps=3.0))
    assert speed.holds(Record(Ending.CRASHED, contact_speed_mps=6.0))


@pytest.mark.parametrize("text", ["crash", "min_ttc_s<", "min_tcc_s<1", "pet_s<nan", "pet_s=1", ""])
def test_what_is_no_event_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_event(text)


def test_the_sampled_uniforms_are_those_of_the_first_pedestrians() -> None:
    flow = space_of(Scenario())
    assert flow.dimensions == MOST_DIMENSIONS
    assert flow.axes[:3] == (("arrival", 0), ("side", 0), ("quantile", 0))
    paper = space_of(validate({"pedestrians": {"max_count": 1, "first_at_trigger": True}}, "test"))
    assert paper.axes == (("side", 0), ("quantile", 0))
    with pytest.raises(InputError, match="sumo"):
        space_of(validate({"pedestrians": {"behaviour": "sumo"}}, "test"))
