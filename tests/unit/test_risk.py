"""How rare an event is: the estimator on probabilities known in closed form, and its parts."""

import math
from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
import pytest
from scipy import stats

from harness.core.errors import InputError
from harness.core.vocabulary import Arm, Behaviour, Ending
from harness.encounter.arrivals import planned_arrivals
from harness.measures import MEASURES, EpisodeRecord
from harness.model.interaction import load_model
from harness.results.folder import RiskAsked
from harness.results.tables import DRAWS
from harness.scenario import Scenario, load_scenario, validate
from harness.scenario.sections import PerceptionSection
from harness.studies.risk.densities import NormalMixture, fitted
from harness.studies.risk.draws import (
    DrawInputs,
    DrawOutcome,
    Proposal,
    RunDraws,
    Units,
    draw_units,
)
from harness.studies.risk.estimate import risk_findings, risk_notes
from harness.studies.risk.space import LIMITED, Space, parse_event, space_of
from tests.risks import CROWD, FLAT, crowd, drawn, found, gain, half_space, rounds, union
from tests.scenes import on_plain

ASKED = RiskAsked(event="crashed", arm="av", target_cv=0.01, not_sampled=[])


@pytest.mark.parametrize(
    ("case", "space", "p"),
    [*((case, FLAT, p) for case in (half_space, union) for p in (1e-2, 1e-4, 1e-6)),
     (crowd, CROWD, 1e-4)],
)  # fmt: skip
def test_known_probabilities_lie_near_the_estimate(case, space: Space, p: float) -> None:
    run, truth = case(p)
    numbers = found(run, space, 5)
    estimate = numbers["probability"]
    # Five standard errors of a coefficient of variation of 0.1, which was asked for.
    assert abs(estimate.value / truth - 1) < 0.5
    assert estimate.low < estimate.value < estimate.high
    assert estimate.reliable
    assert numbers["coefficient_of_variation"].value < 0.15
    assert gain(numbers) > {1e-2: 1 / 1.15 / (1 + 10_000 / 9_900), 1e-4: 5, 1e-6: 50}[p]


def test_brute_force_where_it_is_affordable() -> None:
    """Its interval is the exact one, and its first look is not in the estimate."""
    run, truth = half_space(1e-2)
    units = rounds(run, FLAT, 3, 0.5)
    estimate = risk_findings(units)["probability"]
    exact = stats.binomtest(estimate.events, estimate.n).proportion_ci(method="exact")
    assert (estimate.low, estimate.high) == pytest.approx((exact.low, exact.high))
    assert (units[-1].count, units[-1].events) == (estimate.n, estimate.events)
    assert estimate.low < truth < estimate.high


POINTS = np.array([[0.0, 1.5, -1.0, 0.5]])
"""Fixed number, speed, arrival after the passage, other number."""


@pytest.mark.parametrize(("mean_s", "culprit"), [(-1.0, 0), (3.5, 1)])
def test_the_mean_weight_is_the_probability_whatever_the_density(mean_s, culprit: int) -> None:
    """Exactly two of a Poisson number of four come: most of the placed may come after the window.

    The culprit is the first or the second of them.  The ego passes a second later, and 0.1 m/s
    slower, for each who comes before 3 s.
    """

    def outcome(episode: DrawInputs) -> DrawOutcome:
        early = int((episode.people[:, 0] < 3.0).sum())
        event = len(episode.people) == 2
        passed_s = 4.0 + float(episode.fixed[0]) / 10 + early
        return DrawOutcome(
            event, culprit if event else None, passed_s=passed_s, passed_mps=1.5 - 0.1 * early
        )

    place = POINTS + np.array([0.0, 0.0, 1.0 + mean_s, 0.0])
    placed = NormalMixture(np.ones(1), place, np.diag([1.0, 0.1, 4.0, 2.0])[None])
    fixed = NormalMixture(np.ones(1), np.array([[1.0]]), np.array([[[0.5]]]))
    proposal = Proposal(fixed, placed, 1.5)
    units = drawn(proposal, CROWD, 0, 6_000, lambda episodes: [*map(outcome, episodes)])
    error = units.value.std() / math.sqrt(6_000)
    assert abs(units.value.mean() - stats.poisson.pmf(2, 4.0)) < 4 * error
    assert units.rows.to_pandas().query("placed")["due"].any()
    assert units.weights.max() <= 10  # the nominal share is a tenth
    # Of the fixed numbers alone: P(z > 2).
    beyond = drawn(proposal._replace(placed=None, many=0.0), CROWD, 1, 6_000, _above_2)
    error = beyond.value.std() / math.sqrt(6_000)
    assert abs(beyond.value.mean() - stats.norm.sf(2.0)) < 4 * error


def _above_2(episodes: Sequence[DrawInputs]) -> list[DrawOutcome]:
    return [DrawOutcome(bool(each.fixed[0] > 2.0)) for each in episodes]


def rows(values: Sequence[float], weights: Sequence[float], run: RunDraws | None = None) -> Units:
    """A unit for each value: below 0 an event, NaN a failure; with a weight of its own."""

    def outcomes(episodes: Sequence[DrawInputs]) -> list[DrawOutcome]:
        of = [values[each.unit] for each in episodes]
        return [DrawOutcome(v < 0, reason="it broke" if math.isnan(v) else None) for v in of]

    made = draw_units(Proposal(), FLAT, 0, range(len(values)), run or outcomes)
    given = [
        {**row, "weight": weight, "nominal": weight == 1}
        for row, weight in zip(made, weights, strict=True)
    ]
    return Units.of(DRAWS.of(given))


def test_what_a_risk_says_of_its_draws() -> None:
    """No round but the last is in the estimate; each nominal draw is in the bound."""
    look = rows([-1.0] * 3 + [1.0] * 997, [1.0] * 1_000)
    even = rows([-1.0] * 50 + [1.0] * 950, [0.001] * 900 + [1.0] * 100)
    numbers = risk_findings([look, even])
    assert numbers["probability"].value == pytest.approx(50 * 0.001 / 1_000)
    assert numbers["probability"].events == 50
    # One-sided, by Clopper and Pearson: 3 events in the 1,100 nominal draws of both rounds.
    high = stats.beta.ppf(0.95, 4, 1_100 - 3)
    assert numbers["nominal_high"].value == pytest.approx(high)
    assert numbers["all_ways_high"].value == pytest.approx(high + numbers["probability"].high)
    assert numbers["probability"].reason == "3 of 1,100 nominal draws are events"
    # One draw holds 1/(1 + 0.05 · …) of an estimate.
    heavy = rows([-1.0] * 100 + [1.0] * 900, [0.1] + [0.005] * 99 + [1.0] * 900)
    found_ = risk_findings([heavy])["probability"]
    assert found_.reliable is False
    assert "one draw holds 17 % of the estimate" in found_.reason
    light = rows([-1.0] * 100 + [1.0] * 900, [0.04] + [0.005] * 99 + [1.0] * 900)
    numbers = risk_findings([light])
    assert numbers["probability"].reliable
    assert "target_missed" in [note.key for note in risk_notes(numbers, ASKED)]
    # Failures: the worst case, and no nominal draws.
    failing = rows([-1.0] * 40 + [math.nan] * 10 + [1.0] * 50, [1.0] * 100)
    numbers = risk_findings([failing])
    assert numbers["probability"].value == 0.4
    assert numbers["probability_worst"].value == 0.5
    assert (numbers["nominal_high"].n, numbers["failures"].value) == (90, 10)
    # Those of another round are not in the estimate: 0, not 1.
    (note, *_) = risk_notes(risk_findings([failing, rows([1.0] * 9, [1.0] * 9)]), ASKED)
    assert note.text.endswith("its probability would be 0.")
    nothing = risk_findings([rows([math.nan] * 9, [1.0] * 9)])
    assert (nothing["probability"].value, nothing["nominal_high"].value) == (None, None)
    assert nothing["brute_force_episodes"].value is None


def test_the_second_way_is_found() -> None:
    """It has 30 % of the probability, so an estimate without it is 0.7 of the truth."""
    run, truth = union(1e-4)
    for seed in range(5):
        assert found(run, FLAT, seed)["probability"].value > 0.85 * truth


def test_a_risk_of_which_every_episode_fails_ends_with_its_first_look() -> None:
    units = rounds(
        lambda episodes: [DrawOutcome(False, reason="it broke")] * len(episodes), FLAT, 1
    )
    assert len(units) == 1
    # An ego that never passes leaves brute force.
    crowded = rounds(lambda episodes: [DrawOutcome(False)] * len(episodes), CROWD, 1, 1.0)
    assert not crowded[-1].weighted


def test_a_mixture_of_normals_is_conditioned_and_fitted() -> None:
    rng = np.random.default_rng(5)
    covariance = np.array([[1.0, 0.6], [0.6, 2.0]])
    one = NormalMixture(np.ones(1), np.array([[1.0, -1.0]]), covariance[None])
    known = np.empty((20_000, 0))
    y = one.given(known).points(rng.random(20_000), rng.standard_normal((20_000, 2)))
    exact = stats.multivariate_normal([1.0, -1.0], covariance)
    assert one.given(known[:5]).density(y[:5]) == pytest.approx(exact.pdf(y[:5]))
    # Of two normal numbers the second given the first is N(μ₂ + 0.6 (y₁ − μ₁), 2 − 0.36).
    given = one.given(np.array([[2.0]])).density(np.array([[0.5]]))
    assert given == pytest.approx(stats.norm(-0.4, np.sqrt(1.64)).pdf(0.5))
    # Points around it that are weighted back have its moments; the third number is nominal.
    wide = stats.multivariate_normal([0.0, 0.0], 6.0 * np.eye(2))
    points = wide.rvs(20_000, random_state=rng)
    weights = exact.pdf(points) / wide.pdf(points)
    third = rng.standard_normal((20_000, 1))
    standard = np.array([False, False, True])
    mixture = fitted(np.hstack([points, third]), weights, standard, rng)
    assert mixture.weights @ mixture.locations == pytest.approx([1.0, -1.0, 0.0], abs=0.1)
    assert (mixture.scales[:, 2] == np.array([0.0, 0.0, 1.0])).all()


class Record:
    """An episode's record as far as an event looks at it."""

    def __init__(self, ending: Ending, **values: float) -> None:
        self.ending = ending
        for measure in MEASURES:
            setattr(self, measure.column, values.get(measure.column))


def test_scores_fall_towards_the_event() -> None:
    crash: Any = parse_event("crashed")
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


def test_a_crash_is_in_events_of_small_values() -> None:
    for text in ("crashed", "pet_s<1", "min_ttc_s<1", "min_gap_m<1"):
        event: Any = parse_event(text)
        assert event.holds(Record(Ending.CRASHED))
        assert not event.holds(Record(Ending.CROSSED))
        failed = Record(Ending.FAILED, pet_s=0.0, min_ttc_s=0.0, min_gap_m=0.0)
        assert not event.holds(failed)
    speed: Any = parse_event("contact_speed_mps > 5")
    assert not speed.holds(Record(Ending.CRASHED, contact_speed_mps=3.0))
    assert speed.holds(Record(Ending.CRASHED, contact_speed_mps=6.0))
    assert speed.scores(Record(Ending.CRASHED, contact_speed_mps=3.0)) == (2.0, 2.0, 2.0, 2.0)


@pytest.mark.parametrize("text", LIMITED)
def test_an_event_is_a_measure_beyond_a_limit(text: str) -> None:
    event: Any = parse_event(f"{text}1")
    for value in (0, 2):
        record = Record(Ending.CROSSED, **{text[:-1]: value})
        assert event.holds(record) is ((value < 1) is (text[-1] == "<"))
        assert all((score <= 0) is event.holds(record) for score in event.scores(record))
    undefined = Record(Ending.TIMED_OUT)
    assert not event.holds(undefined)
    assert all(score > 0 for score in event.scores(undefined))


@pytest.mark.parametrize(
    "text", ["crash", "min_ttc_s<", "min_tcc_s<1", "pet_s<nan", "pet_s>1", "pet_s<0.0", ""]
)
def test_what_is_no_event_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_event(text)


DEAD = "benchmarks.faults:Dead"


def test_the_sampled_uniforms_are_those_of_people_strategy_and_perception() -> None:
    flow = space_of(Scenario(), Arm.AV)
    assert (flow.fixed, flow.marks) == ((), ("side", "quantile"))
    one = {"pedestrians": {"max_count": 1, "first_at_trigger": True}}
    paper = space_of(validate(one, "test"), Arm.AV)
    assert (paper.fixed, paper.marks, paper.rate_per_s) == (("side", "quantile"), (), 0.0)
    with pytest.raises(InputError, match="nothing here is random"):
        space_of(validate({"pedestrians": {"flow_per_hour": 0.0}}, "test"), Arm.AV)
    settings = {"arms.av": DEAD, f'strategies."{DEAD}".share': 1e-3}
    space = space_of(load_scenario("cctc", settings), Arm.AV)
    assert space.fixed == ("side", "quantile", "av_strategy", "av_strategy")
    eyes = {"perception.position_sd_m": 0.2, "perception.dropout_probability": 0.1}
    more = {"perception.detection_probability": 0.9, "pedestrians.warm_up_s": 30.0}
    space = space_of(seen := load_scenario("cctc_flow", eyes | more), Arm.AV)
    person = ("side", "quantile", "detection", "redetection", "perception_error")
    assert space.marks == (*person, "perception_error")
    assert len(space.by_chance) == 3
    assert space_of(seen, Arm.HUMAN).marks == person[:2]  # ``perception`` is the AV's alone
    # Two people: each has one uniform of every stream, and two errors in a row.
    people = space.crowd(np.random.default_rng(1))[:2].copy()
    people[:, 6] = 0.5, 1.5
    errors = space.given(np.empty(0), people, 0)["perception_error"]
    assert errors[1::2] == pytest.approx(stats.norm.cdf([0.5, 1.5]))
    # The car that hides the child may hide them again: the wait after that is sampled too.
    child = {"pedestrians.timed_case": "CPNCO-50", "perception.detection_probability": 0.3}
    fast = {"ego.initial_speed_mps": 50 / 3.6, "arms.av": "emergency_brake"}
    hidden = space_of(load_scenario("euro_ncap_vru", {**child, **fast}), Arm.AV)
    assert hidden.fixed == ("timed_detection", "redetection")


@pytest.mark.parametrize("behaviour", get_args(Behaviour))
def test_what_a_risk_samples_is_all_that_is_random_about_a_person(behaviour: Behaviour) -> None:
    walking = {"mean_mps": 1.4, "classes": [{"share": 0.5, "mean_mps": 0.9}]}
    people = {"behaviour": behaviour, "walking_speed": walking, "kerb_wait_s": 0.0}
    keys = {"pedestrians": people, "perception": {"detection_probability": 0.5}}
    given = dict.fromkeys(("arrival", *space_of(validate(keys, "test"), Arm.AV).marks), (0.4,))
    seeds = [validate({**keys, "experiment": {"seed": seed}}, "test") for seed in range(9)]
    assert len({planned_arrivals(each, 0, given)[0] for each in seeds}) == 1


def test_a_new_perception_error_counts_as_random() -> None:
    class More(PerceptionSection):
        ghosts_per_hour: float = 0.0

    assert More(ghosts_per_hour=1.0).draws
    assert not More(latency_s=0.3, human=True).draws


def test_a_strategy_gets_the_uniforms_of_its_state() -> None:
    scenario = load_scenario("cctc", {"arms.av": DEAD, f'strategies."{DEAD}".share': 1e-3})
    space, runner = space_of(scenario, Arm.AV), on_plain(scenario, load_model("dut"))
    # A far-side walker of 1.1 m/s meets a car of 5 m/s that does not brake.
    dead, alive = np.array([1.0, -0.2, -3.2, 0.0]), np.array([1.0, -0.2, -3.0, 0.0])
    cases = [(9, space.given(state, np.empty((0, 1)), 9)) for state in (dead, alive)]
    hit, missed = runner.run_arm_given(Arm.AV, cases)
    # Φ(−3.2) = 6.9e-4 is below 1e-3, Φ(−3) = 1.35e-3 is not.
    assert (hit.record.ending, missed.record.ending) == (Ending.CRASHED, Ending.CROSSED)


@pytest.mark.parametrize("first_at_trigger", [False, True])
def test_a_state_is_met_in_the_streams(first_at_trigger: bool) -> None:
    scenario = validate({"pedestrians": {"first_at_trigger": first_at_trigger}}, "test")
    space = space_of(scenario, Arm.AV)
    people = np.array([[0.7, 1.0, -0.4], [2.0, -1.0, 0.3], [2.1, 0.2, 1.2]])
    given = space.given(np.zeros(len(space.fixed)), people, 7)
    arrivals = planned_arrivals(scenario, 7, given)[int(first_at_trigger) :]
    came = arrivals[: len(people)]
    assert [arrival.arrival_s for arrival in came] == pytest.approx(people[:, 0])
    assert [each.quantile for each in came] == pytest.approx(stats.norm.cdf(people[:, 2]))
    assert arrivals[len(people)].arrival_s > space.window_s
    # Mean and variance of a Poisson number are both λ · window; standard errors of 2,000 draws.
    many = [len(space.crowd(np.random.default_rng(seed))) for seed in range(2_000)]
    mean = space.rate_per_s * space.window_s
    assert np.mean(many) == pytest.approx(mean, abs=4 * math.sqrt(mean / 2_000))
    assert np.var(many) == pytest.approx(mean, rel=0.2)


def test_an_episode_met_again_is_the_same_with_all_its_streams() -> None:
    def record(pair: int, **pedestrians: object) -> EpisodeRecord:
        tree = {"pedestrians": {"flow_per_hour": 900.0, "warm_up_s": 30.0, **pedestrians}}
        scenario = validate({**tree, "experiment": {"pairs": 1}}, "test")
        return on_plain(scenario, load_model("dut")).run_arm(pair, Arm.HUMAN).record

    assert record(0, drawn=[{"episode": 9}]) == record(9)
    assert record(0, drawn=[{"episode": 9}]) != record(0)
