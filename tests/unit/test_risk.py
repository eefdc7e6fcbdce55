"""How rare an event is: the estimator on probabilities known in closed form, and its parts."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from harness.core.encounter import Arm, Ending
from harness.core.errors import InputError
from harness.core.seeding import has_drawn_more
from harness.encounter.arms import check_arms, draws_of
from harness.encounter.arrivals import planned_arrivals
from harness.measures import MEASURES, EpisodeRecord, Measure
from harness.model.interaction import load_model
from harness.old.report.screens.risk_terminal import _rows, person_words, risk_screen, risk_tables
from harness.old.report.screens.screen import screen_lines
from harness.old.statistics.findings import Note, Rank
from harness.old.studies.risk.asking import Settings, SettingsDocument, question_of
from harness.old.studies.risk.event import parse_event
from harness.old.studies.risk.findings import RiskFindings
from harness.old.studies.risk.fitting import first_components, spread
from harness.old.studies.risk.interval import Tally, estimate_of
from harness.old.studies.risk.layout import Layout
from harness.old.studies.risk.normals import Normals, fitted
from harness.old.studies.risk.outcomes import Outcomes
from harness.old.studies.risk.placing import Placing
from harness.old.studies.risk.proposal import NOMINAL_SHARE, nominal
from harness.old.studies.risk.running import Evaluation
from harness.old.studies.risk.space import space_of
from harness.old.studies.risk.ways import drawn_of, people_of
from harness.old.studies.workers.this_process import ThisProcess
from harness.scenario import Scenario, load_scenario, validate
from tests.risks import CROWD, LAYOUT, crowd, estimated, half_space, outcomes, scored, union
from tests.scenes import on_plain

DATA = Path(__file__).parents[1] / "data" / "risk"


FLAT = [(case, LAYOUT, p, 5) for case in (half_space, union) for p in (1e-2, 1e-4, 1e-6)]


@pytest.mark.parametrize(("case", "layout", "p", "seed"), [*FLAT, (crowd, CROWD, 1e-4, 6)])
def test_known_probabilities_lie_near_the_estimate(case, layout, p: float, seed: int) -> None:
    score, truth = case(p)
    findings = estimated(score, seed, layout=layout)
    estimate = findings.estimate
    # Five standard errors of a coefficient of variation of 0.1, which was asked for.
    assert abs(estimate.probability / truth - 1) < 0.5
    assert estimate.ci_low < estimate.probability < estimate.ci_high
    assert estimate.coefficient_of_variation < 0.15
    episodes = findings.episodes
    brute_force = (1 - truth) / truth / estimate.coefficient_of_variation**2
    if p == 1e-4:
        assert episodes < brute_force / 20
    if p == 1e-6:
        assert episodes < brute_force / 1000


def test_brute_force_where_it_is_affordable() -> None:
    evaluate, truth = half_space(1e-2)
    findings = estimated(evaluate, 3)
    assert findings.explorations == ()
    assert (findings.weights == 1).all()
    assert findings.estimate.ci_low < truth < findings.estimate.ci_high
    # (1 − p)/(p cv²) is 9,900 for a coefficient of variation of 0.1.
    assert findings.episodes < 3 * 9_900
    # The first look ends, however little is wanted of it.
    rare = estimated(half_space(1e-6)[0], 3, 1.0)
    assert len(rare.explorations) == 3
    assert rare.episodes < 60_000
    findings = estimated(half_space(1e-2)[0], 3, 0.5)
    estimate = findings.estimate
    assert 0 < estimate.events < 30
    exact = stats.binomtest(estimate.events, estimate.draws).proportion_ci(method="exact")
    assert (estimate.ci_low, estimate.ci_high) == pytest.approx((exact.low, exact.high))
    assert findings.notes == ()
    event = np.arange(1_000) < 3
    estimate = estimate_of(event.astype(float), Tally(1_000, 3), weighted=False)
    low, high = stats.binomtest(3, 1_000).proportion_ci(method="exact")
    found = (estimate.probability, estimate.ci_low, estimate.ci_high)
    assert found == pytest.approx((0.003, low, high))


def test_events_of_everybody_of_nobody_and_those_that_the_estimate_missed() -> None:
    findings = estimated(scored(lambda z: -np.ones(len(z))), 1)
    assert findings.estimate.probability == 1
    assert findings.estimate.ci_high == 1
    findings = estimated(scored(lambda z: np.full(len(z), np.inf)), 1)
    estimate = findings.estimate
    assert estimate.probability is None
    # All draws are nominal: (1 − p)^n = 0.05.
    assert estimate.ci_high == pytest.approx(1 - 0.05 ** (1 / findings.episodes))
    assert (estimate.nominal.draws, estimate.nominal.events) == (findings.episodes, 0)
    findings = estimated(half_space(0.1)[0], 3, most_draws=1)
    assert findings.estimate.probability is None
    # A thousand draws of the first look at least, whose events have a standard deviation of 9.5.
    assert findings.events_in_all > 50


def test_an_event_of_the_first_look_alone_is_counted_in_the_bound() -> None:
    """Issue: the bound said that no event is among the draws, and left the first look's out."""
    seen = 0

    def evaluate(z: np.ndarray, what: str, *_options: object) -> Outcomes:
        nonlocal seen
        score = np.full((len(z), 1), np.inf)
        if what == "a first look" and not seen:
            score[0], seen = -1.0, 1
        return outcomes(score)

    findings = estimated(evaluate, 1)
    estimate = findings.estimate
    assert estimate.probability is None
    assert findings.first_look.events == estimate.nominal.events == 1
    assert estimate.nominal.draws == findings.episodes
    # One event in n draws: P(at most one | p) = 0.05 at the bound.
    few = stats.binom.cdf(1, findings.episodes, estimate.ci_high)
    assert few == pytest.approx(0.05)
    words = " ".join(note.text for note in findings.notes)
    assert f"1 of the {findings.first_look.draws:,} episodes of the first look and" in words


def test_an_estimate_by_brute_force_after_an_exploration_without_events_says_so() -> None:
    def evaluate(z: np.ndarray, what: str, *_options: object) -> Outcomes:
        score = np.full((len(z), 1), np.inf)
        score[: what == "estimating"] = -1.0
        return outcomes(score)

    findings = estimated(evaluate, 1)
    assert (findings.weighted, findings.estimate.events > 0) == (False, True)
    words = [note.text for note in findings.notes]
    assert words == ["The estimate uses brute force: the exploration found no event."]


def test_the_bound_on_other_ways_rests_on_every_nominal_draw() -> None:
    findings = estimated(half_space(1e-4)[0], 5)
    nominal = findings.estimate.nominal
    # The first look, the first points of three explorations, a tenth of the last draws.
    tenth = nominal.draws - findings.first_look.draws - 3_000
    assert tenth == pytest.approx(0.1 * findings.estimate.draws, rel=0.2)
    assert stats.binom.cdf(nominal.events, nominal.draws, nominal.high) == pytest.approx(0.05)


def findings_in(name: str, **changes: object) -> RiskFindings:
    """Findings written by hand."""
    text = (DATA / f"{name}.json").read_text(encoding="utf-8")
    return RiskFindings.model_validate(json.loads(text) | changes)


@pytest.mark.parametrize("name", ["weighted", "brute_force", "no_way"])
def test_the_first_screen_of_a_risk(name: str) -> None:
    given = {"name": "cctc", "arm": Arm.AV, "event": "crashed", "target_cv": 0.1, "seed": 7}
    given |= {"scenario": load_scenario("cctc").model_dump(mode="json"), "most_episodes": 1}
    settings = SettingsDocument(**given, in_sumo=False, versions={}, model={})
    lines = screen_lines(risk_screen(findings_in(name), Path("my runs"), settings))
    assert lines == (DATA / f"{name}.txt").read_text(encoding="utf-8").splitlines()


def test_the_first_screen_shows_the_pedestrian_to_whom_the_event_is_due() -> None:
    first = {"arrival_s": 1.0, "side": "far", "walking_speed_mps": 1.3}
    first |= {"critical_gap_s": None, "seen_after_s": None}
    people = [first, first | {"arrival_s": 2.0}, first | {"arrival_s": 7.5, "culprit": True}]
    way = {"share": 1.0, "events": 3, "episode": 4, "critical_pairs": (0, 2)}
    findings = findings_in("weighted", ways=[way | {"pedestrians": people}])
    *_, row = _rows(findings)
    assert row[1] == "far at 7.5 s, walks at 1.30 m/s; 2 more"
    (table,) = (table for table in risk_tables(findings) if table.name == "way-1")
    assert [cells[-1].text for cells in table.rows] == ["", "", "yes"]
    assert table.headings[-1] == "event due to"


def test_the_culprit_of_an_episode_is_whom_the_ego_hits(tmp_path: Path) -> None:
    scenario = load_scenario(
        "cctc_flow", {"arms.av": "constant_speed", "pedestrians.flow_per_hour": 1000}
    )
    settings = Settings("cctc_flow", scenario, target_cv=0.3)
    question = question_of(settings)
    evaluation = Evaluation(question, tmp_path, ThisProcess(), lambda *_: None)
    z = question.space.layout.draw(60, np.random.default_rng(2))
    numbers = np.arange(60)
    evaluation.tell(z, numbers)
    runner, later = on_plain(scenario, question.model), 0
    for number, state, culprit in zip(
        numbers.tolist(), z, evaluation.events["culprit_index"].to_pylist(), strict=True
    ):
        case = [(number, question.space.given(state, number))]
        (outcome,) = runner.run_arm_given(Arm.AV, case, [].append)
        assert culprit == outcome.record.contact_index
        people = people_of(scenario, question.space, number, state, (), culprit)
        shown = [at for at, person in enumerate(people) if person.culprit]
        assert shown == [culprit][: culprit is not None and culprit < len(people)]
        later += shown > [0]
    assert later > 2


def test_an_estimate_that_is_doubted_is_not_reliable_and_says_why() -> None:
    doubt = Note(Rank.FEW_PAIRS, "The interval is too narrow.")
    finding = findings_in("weighted", notes=(doubt,)).findings["probability"]
    assert (finding.value, finding.low, finding.high) == (9.2e-10, 8.7e-10, 9.8e-10)
    assert (finding.n, finding.events) == (3_000, 1_522)
    assert (finding.reliable, finding.reason) == (False, doubt.text)
    assert findings_in("weighted").findings["probability"].reliable
    undefined = findings_in("no_way").findings["probability"]
    assert undefined.reason == "No draw of the estimate ended in the event."


def test_what_the_exploration_cannot_reach_or_simulate() -> None:
    evaluate = scored(lambda z: 1 + np.exp(-z[:, 0]))
    findings = estimated(evaluate, 1)
    assert findings.estimate.probability is None
    # It falls by less than a thousandth beyond z = 7, a tail of 1e-12: 12 levels of a tenth.
    assert all(len(exploration.levels) <= 12 + 3 for exploration in findings.explorations)

    def score(z: np.ndarray) -> np.ndarray:
        return np.where(z[:, 1] > 0, np.nan, 1.5 - z[:, 0])

    findings = estimated(scored(score), 1, layout=Layout(2))
    tail = stats.norm.sf(1.5)
    assert findings.estimate.probability == pytest.approx(tail / 2, rel=0.5)
    assert findings.failed_weight == pytest.approx(0.5, abs=0.1)


def test_weights_are_bounded_and_have_mean_one() -> None:
    rng = np.random.default_rng(3)
    failures = rng.standard_normal((300, 4)) * 0.2 + np.array([4.0, 0, 0, 0])
    layout = Layout(4)
    proposal = spread(layout, first_components(failures, rng))
    z, _, _ = proposal.draw(100_000, scored(lambda z: z[:, 0]), rng, "")
    weights = np.exp(proposal.log_weight(z))
    assert weights.max() <= 1 / NOMINAL_SHARE * (1 + 1e-9)
    # E_q[φ/q] = 1, with a standard error of 0.01 at most.
    assert abs(weights.mean() - 1) < 0.05
    assert (np.exp(nominal(layout).log_weight(failures)) == 1).all()


def test_units_have_the_probability_as_their_mean_whomever_they_place() -> None:
    """Mecke's formula, of an event whose probability is known: k people come, k is Poisson."""
    rng = np.random.default_rng(4)
    flow = Layout(fixed=1, marks=2, rate_per_s=0.5, window_s=8.0)
    density = Normals(
        np.array([0.7, 0.3]),
        np.array([[1.0, 1.0, 0.5, 0.2], [-0.5, 2.0, -3.0, 1.0]]),
        np.array([np.eye(4) + 0.3, 0.5 * np.eye(4)]),
    )
    edges_mps, counts = np.array([1.2]), np.array([0.4, 3.0])
    placing = Placing(flow, density.first(1), density, edges_mps, counts)
    for number in (1, 3):
        units = placing.draw(40_000, Company(flow, number), rng, "")
        truth = stats.poisson.pmf(number, 4.0)
        error = units.value.std() / np.sqrt(len(units.value))
        assert abs(units.value.mean() - truth) < 4 * error < 0.1 * truth
        assert units.weight.max() <= 1 / NOMINAL_SHARE
        assert np.sum(units.weight) == pytest.approx(np.sum(units.value))
    # Nobody in the crowd is to blame: only first episodes are counted.
    alone = placing.draw(20_000, Company(flow, 2, blamed=False), rng, "")
    assert abs(alone.value.mean() - stats.poisson.pmf(2, 4.0)) < 4 * alone.value.std() / 141
    assert not alone.hit.any()


def test_an_ego_that_never_passes_leaves_brute_force() -> None:
    def evaluate(z: np.ndarray, *options: object) -> Outcomes:
        return Company(CROWD, 40)(z, *options)._replace(
            passed_s=np.full(len(z), np.nan), passed_mps=np.full(len(z), np.nan)
        )

    findings = estimated(evaluate, 1, 0.5, layout=CROWD)
    assert findings.estimate.probability is None
    assert not findings.weighted


class Company:
    """In the event are the states in which ``number`` people come; due to the first of them.

    The ego passes a second later, and 0.1 m/s slower, for each who comes before 3 s.
    """

    def __init__(self, layout: Layout, number: int, *, blamed: bool = True) -> None:
        self._layout, self._number, self._blamed = layout, number, blamed

    def __call__(
        self, z: np.ndarray, _what: str, numbers: object = None, _asked: object = None
    ) -> Outcomes:
        arrivals_s = self._layout.arrivals_s(z)
        early = (arrivals_s < 3.0).sum(axis=1)
        event = (~np.isnan(arrivals_s)).sum(axis=1) == self._number
        first = np.where(np.isnan(arrivals_s), np.inf, arrivals_s).argmin(axis=1)
        score = np.where(event, -1.0, 1.0)[:, None]
        keys = np.arange(len(z)) if numbers is None else np.asarray(numbers)
        culprit = np.where(event & self._blamed, first, -1)
        passed_s, passed_mps = 4.0 + z[:, 0] / 10 + early, 1.5 - 0.1 * early
        return Outcomes(score, keys, passed_s, passed_mps, culprit, np.zeros_like(score))


def test_whom_the_ego_hit_is_to_blame_and_others_have_scores_of_their_own(tmp_path: Path) -> None:
    """At 6 s the front of a car that never brakes is where somebody has walked 3.2 m at 1.3 m/s."""
    scenario = load_scenario("cctc_flow", {"arms.av": "constant_speed"})
    question = question_of(Settings("flow", scenario))
    layout = question.space.layout
    hit, early = 3.5, 0.1  # s; who comes early is beyond the lane by then
    z = np.full((3, layout.width), np.nan)
    for state, arrivals in zip(z, [(hit, early), (early, hit), (early,)], strict=True):
        for person, arrival_s in zip(layout.people(state[None])[0], arrivals, strict=False):
            person[:] = stats.norm.ppf(arrival_s / layout.window_s), -1.0, 0.0
    evaluation = Evaluation(question, tmp_path, ThisProcess(), lambda *_: None)
    outcomes = evaluation(z, "", np.arange(3), np.array([0, 0, -1]))
    assert outcomes.culprit.tolist() == [0, 1, -1]
    assert outcomes.event.tolist() == [True, True, False]
    assert (outcomes.own[:, 0] <= 0).tolist() == [True, False, False]
    assert np.isinf(outcomes.own[2]).all()  # everybody belongs to the flow
    assert outcomes.passed_s[2] == pytest.approx(30 / 5)
    assert outcomes.passed_mps[2] == pytest.approx(5.0)
    # Without a contact: the gap to the first of them alone is what the event is about.
    near = question_of(Settings("flow", scenario, event="min_gap_m<1000"))
    evaluation = Evaluation(near, tmp_path / "near", ThisProcess(), lambda *_: None)
    assert evaluation(z, "", np.arange(3)).culprit.tolist() == [0, 1, 0]


def test_a_mixture_of_normals_is_conditioned_and_fitted() -> None:
    rng = np.random.default_rng(5)
    covariance = np.array([[1.0, 0.6], [0.6, 2.0]])
    one = Normals(np.ones(1), np.array([[1.0, -1.0]]), covariance[None])
    y = one.draw(20_000, rng)
    exact = stats.multivariate_normal([1.0, -1.0], covariance)
    assert one.density(y[:5]) == pytest.approx(exact.pdf(y[:5]))
    # Of two normal numbers the second given the first is N(μ₂ + 0.6 (y₁ − μ₁), 2 − 0.36).
    given = one.given(np.array([[2.0]])).density(np.array([[0.5]]))
    assert given == pytest.approx(stats.norm(-0.4, np.sqrt(1.64)).pdf(0.5))
    # Points around it that are weighted back have its moments; the third number is nominal.
    wide = Normals(np.ones(1), np.zeros((1, 2)), 6.0 * np.eye(2)[None])
    drawn = wide.draw(20_000, rng)
    points = np.column_stack([drawn, rng.standard_normal(len(drawn))])
    standard = np.array([False, False, True])
    found = fitted(points, one.density(drawn) / wide.density(drawn), standard, rng)
    assert found.shares @ found.means == pytest.approx([1.0, -1.0, 0.0], abs=0.1)
    assert (found.covariances[:, 2] == np.array([0.0, 0.0, 1.0])).all()


def test_a_crowd_is_drawn_as_a_poisson_process() -> None:
    z = CROWD.draw(20_000, np.random.default_rng(2))
    number = (~np.isnan(CROWD.arrivals_s(z))).sum(axis=1)
    # Mean and variance of a Poisson number are both Λ = 4; standard errors 0.014 and 0.045.
    assert abs(number.mean() - 4.0) < 0.06
    assert abs(number.var() - 4.0) < 0.2
    present = CROWD.arrivals_s(z)
    assert abs(np.nanmean(present) - 4.0) < 0.05


class Record:
    """An episode's record as far as an event looks at it."""

    def __init__(self, ending: Ending, **values: float) -> None:
        self.ending = ending
        for measure in MEASURES:
            setattr(self, measure.column, values.get(measure.column))


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
    assert event.scores(Record(Ending.CROSSED, max_drac_mps2=5.0)) == (3.0, 3.0, 3.0, 3.0)
    # What undoes a measure is on one side of its limits: a crash is no long post-encroachment time.
    assert parse_event("pet_s<1").holds(Record(Ending.CRASHED))
    assert not parse_event("pet_s>1").holds(Record(Ending.CRASHED))
    # Two bodies touch while the points by which a time advantage goes are seconds apart.
    touched = Record(Ending.CRASHED, min_time_advantage_s=0.9)
    for limit in (0.1, 1.0):
        event = parse_event(f"min_time_advantage_s<{limit}")
        assert event.holds(touched)
        assert max(event.scores(touched)) <= 0
        assert not parse_event(f"min_time_advantage_s>{limit}").holds(touched)
    assert not parse_event("pass_time_s<60").holds(Record(Ending.CRASHED))
    assert not parse_event("pass_time_s>60").holds(Record(Ending.CRASHED))
    speed = parse_event("contact_speed_mps > 5")
    assert not speed.holds(Record(Ending.CRASHED, contact_speed_mps=3.0))
    assert speed.holds(Record(Ending.CRASHED, contact_speed_mps=6.0))


@pytest.mark.parametrize("measure", MEASURES, ids=lambda measure: measure.column)
@pytest.mark.parametrize("sign", ["<", ">"])
def test_every_measure_makes_an_event(measure: Measure, sign: str) -> None:
    event = parse_event(f"{measure.column}{sign}1")
    for value in (0, 2):
        record = Record(Ending.CROSSED, **{measure.column: value})
        assert event.holds(record) is ((value < 1) is (sign == "<"))
        assert all((score <= 0) is event.holds(record) for score in event.scores(record))
    undefined = Record(Ending.TIMED_OUT)
    assert not event.holds(undefined)
    assert all(score > 0 for score in event.scores(undefined))


@pytest.mark.parametrize("text", ["crash", "min_ttc_s<", "min_tcc_s<1", "pet_s<nan", "pet_s=1", ""])
def test_what_is_no_event_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_event(text)


def test_the_sampled_uniforms_are_those_of_the_people_who_come() -> None:
    flow = space_of(Scenario(), Arm.AV)
    assert (flow.fixed, flow.marks) == ((), ("arrival", "side", "quantile"))
    one = {"pedestrians": {"max_count": 1, "first_at_trigger": True}}
    paper = space_of(validate(one, "test"), Arm.AV)
    assert (paper.fixed, paper.marks) == (("side", "quantile"), ())
    with pytest.raises(InputError, match="sumo"):
        space_of(validate({"pedestrians": {"behaviour": "sumo"}}, "test"), Arm.AV)
    with pytest.raises(InputError, match="nothing in an episode is random"):
        space_of(validate({"pedestrians": {"flow_per_hour": 0.0}}, "test"), Arm.AV)


DEAD = "benchmarks.faults:Dead"


def test_what_strategy_and_perception_draw_first_is_sampled() -> None:
    settings = {"arms.av": DEAD, f'strategies."{DEAD}".share': 1e-3}
    space = space_of(load_scenario("cctc", settings), Arm.AV)
    assert space.fixed == ("side", "quantile", "av_strategy", "av_strategy")
    assert space_of(load_scenario("cctc"), Arm.AV).fixed == ("side", "quantile")
    eyes = {"perception.position_sd_m": 0.2, "perception.dropout_probability": 0.1}
    flow = load_scenario("cctc_flow", {**eyes, "perception.detection_probability": 0.9})
    space = space_of(flow, Arm.AV)
    person = ("side", "quantile", "detection", "redetection", "perception_error")
    assert space.marks == ("arrival", *person, "perception_error")
    assert len(space.by_chance) == 2
    # Two people: each has one uniform of every stream, and two errors in a row.
    z = space.layout.draw(1, np.random.default_rng(1))
    people = space.layout.people(z)[0]
    people[2:] = np.nan
    people[:2, 0], people[:2, 6] = (-1.0, 1.0), (0.5, 1.5)
    errors = space.given(z[0], 0)["perception_error"]
    assert errors[1::2] == pytest.approx(stats.norm.cdf([0.5, 1.5]))


def test_a_strategy_gets_the_uniforms_of_its_state_and_again_in_its_critical_pair() -> None:
    settings = {"arms.av": DEAD, f'strategies."{DEAD}".share': 1e-3}
    scenario = load_scenario("cctc", settings)
    space, model = space_of(scenario, Arm.AV), load_model("dut")
    runner = on_plain(scenario, model)
    # A far-side walker of 1.1 m/s meets a car of 5 m/s that does not brake.
    dead, alive = np.array([1.0, -0.2, -3.2, 0.0]), np.array([1.0, -0.2, -3.0, 0.0])
    cases = [(9, space.given(state, 9)) for state in (dead, alive)]
    generators: list[np.random.Generator | None] = []
    hit, missed = runner.run_arm_given(Arm.AV, cases, generators.append)
    assert (hit.record.ending, missed.record.ending) == (Ending.CRASHED, Ending.CROSSED)
    # Φ(−3.2) = 6.9e-4 is below 1e-3, Φ(−3) = 1.35e-3 is not; it drew once.
    assert not any(
        has_drawn_more(rng, draws_of(scenario, Arm.AV, 9, given=given))
        for rng, (_, given) in zip(generators, cases, strict=True)
    )
    drawn = [drawn_of(space, 9, state) for state in (dead, alive)]
    again = load_scenario("cctc", {**settings, "pedestrians.drawn": drawn, "experiment.pairs": 2})
    runner = on_plain(again, model)
    assert [runner.run_arm(pair, Arm.AV).record for pair in (0, 1)] == [hit.record, missed.record]


def test_who_may_be_missed_leaves_something_to_chance() -> None:
    child = {"name": "child", "side": "near", "start_lateral_m": 4.0}
    child |= {"speed_mps": 1.4, "impact_share": 0.5}
    people = {"flow_per_hour": 0.0, "timed": [child]}
    tree = {"pedestrians": people, "perception": {"detection_probability": 0.5}}
    scenario = validate(tree, "test")
    space = space_of(scenario, Arm.AV)
    assert space.fixed == ("timed_detection",)
    (arrival,) = planned_arrivals(scenario, 3, space.given(np.array([1.0]), 3))
    assert arrival.detection_quantile == pytest.approx(stats.norm.cdf(1.0))
    # 1 − Φ(1) = 0.159 is more than 0.5³ and less than 0.5².
    (person,) = people_of(scenario, space, 3, np.array([1.0]), (1.4,), None)
    # The third update is two steps of 0.1 s after the first.
    assert person_words(person) == "near at 0.0 s, walks at 1.40 m/s, seen after 0.2 s"
    blind = scenario.model_copy(
        update={"perception": scenario.perception.model_copy(update={"detection_probability": 0.0})}
    )
    (person,) = people_of(blind, space, 3, np.array([1.0]), (), None)
    assert person.seen_after_s is None
    assert person_words(person) == "near at 0.0 s, does not walk"


def test_who_was_missed_is_met_again_at_a_speed_that_the_model_does_not_know() -> None:
    settings = {
        "pedestrians.timed_case": "CPNCO-50",
        "ego.initial_speed_mps": 50 / 3.6,  # the box of dut ends at 8 m/s
        "perception.detection_probability": 0.3,
        "arms.av": "emergency_brake",
    }
    scenario = load_scenario("euro_ncap_vru", settings)
    space = space_of(scenario, Arm.AV)
    # The car that hides the child may hide them again: the wait after that is sampled too.
    assert space.fixed == ("timed_detection", "redetection")
    state = np.array([2.0, 0.5])
    drawn = [drawn_of(space, 5, state)]
    again = load_scenario("euro_ncap_vru", {**settings, "pedestrians.drawn": drawn})
    for of in (scenario, again):
        check_arms(of, load_model(of.model.name, of.model.path))
    assert planned_arrivals(again, 0) == planned_arrivals(scenario, 5, space.given(state, 5))


@pytest.mark.parametrize("first_at_trigger", [False, True])
def test_a_state_is_met_in_the_streams(first_at_trigger: bool) -> None:
    scenario = validate({"pedestrians": {"first_at_trigger": first_at_trigger}}, "test")
    space = space_of(scenario, Arm.AV)
    layout = space.layout
    z = layout.draw(1, np.random.default_rng(3))
    arrivals = planned_arrivals(scenario, 7, space.given(z[0], 7))[int(first_at_trigger) :]
    people = layout.people(z)[0]
    people = people[np.argsort(people[:, 0])][: (~np.isnan(people[:, 0])).sum()]
    assert len(people) >= 1
    came = [arrival.arrival_s for arrival in arrivals[: len(people)]]
    assert came == pytest.approx(space.layout.window_s * stats.norm.cdf(people[:, 0]))
    quantiles = [arrival.quantile for arrival in arrivals[: len(people)]]
    assert quantiles == pytest.approx(stats.norm.cdf(people[:, 2]))
    assert arrivals[len(people)].arrival_s > space.layout.window_s


def test_an_episode_met_again_is_the_same_with_all_its_streams() -> None:
    def record(pair: int, **pedestrians: object) -> EpisodeRecord:
        tree = {"pedestrians": {"flow_per_hour": 900.0, "warm_up_s": 30.0, **pedestrians}}
        scenario = validate({**tree, "experiment": {"pairs": 1}}, "test")
        return on_plain(scenario, load_model("dut")).run_arm(pair, Arm.HUMAN).record

    # The human driver draws from a stream of its own, and so do those who are there at the start.
    assert record(0, drawn=[{"episode": 9}]) == record(9)
    assert record(0, drawn=[{"episode": 9}]) != record(0)
