"""Strategies compared pair by pair, on episodes that are made by hand."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy import stats

from harness.results.estimators import EQUAL, FEW
from harness.results.finding import Finding
from harness.results.result import Result
from harness.scenario import Scenario
from harness.studies.allowed import allowed_in
from harness.studies.candidates import groups_of
from harness.studies.comparison import compare
from tests.cells import FAILED, HUMAN_S, Fate, MadeRun, noisy, run_of, screen_text, study
from tests.scenes import refuses

THREE = "arms.av=soft_yield,hard_yield,constant_speed"
FLOWS = "pedestrians.flow_per_hour=50,250"
DIFFERENCES = ("time_ratio_difference", "mu_difference", "delay_difference_s")

Pair = tuple[Fate, Fate]


def by_hand(scenario: Scenario, pair: int) -> Pair:
    """At 50 per hour all three differ, at 250 the first two drive alike."""
    strategy = scenario.arms.av
    if scenario.pedestrians.flow_per_hour == 250:
        return (7.0 if strategy == "constant_speed" else 8.0), HUMAN_S
    if strategy == "constant_speed":
        return ("crashed" if pair < 10 else 7.0), HUMAN_S
    if strategy == "hard_yield":
        return ("timed_out" if pair == 3 else 9.0), HUMAN_S
    return 8.0, HUMAN_S


@pytest.fixture(scope="module")
def run() -> MadeRun:
    return run_of(study({}, THREE, FLOWS, name="cctc_flow"), by_hand, 40)


@pytest.fixture(scope="module")
def result(run: MadeRun) -> Result:
    return compare(run)


def test_differences_by_hand(result: Result) -> None:
    rows = list(result.records)
    value = {key: [row[key].value for row in rows] for key in DIFFERENCES}
    # τ is 0.8, 0.9 and 0.7 over the pairs in which both crossed.
    assert value["mu_difference"] == pytest.approx([-0.1, 0.1, 0.2, 0.0, 0.1, 0.1])
    assert value["delay_difference_s"] == pytest.approx([-1, 1, 2, 0, 1, 1])
    # Pair 3 of hard_yield counts with 300 s, the ten crashes are left out, the reference has 10 s.
    late = (39 * -1 + 8 - 300) / (40 * 10)
    assert value["time_ratio_difference"][0] == pytest.approx(late)
    assert value["time_ratio_difference"][1] == pytest.approx(0.1)
    # Pair 3 is one of the ten.
    assert value["time_ratio_difference"][2] == pytest.approx(0.2)
    worst = [row["delay_worst_difference_s"].value for row in rows[:2]]
    assert worst == pytest.approx([(39 * -1 + 8 - 300) / 40, (30 - 10 * 292) / 40])
    equal = rows[3]["time_ratio_difference"]
    assert equal == Finding(0.0, n=0, reason=EQUAL, p=1.0)
    assert rows[1]["mu_difference"].reason == EQUAL


def test_crashes_by_hand_and_holm_over_the_table(result: Result) -> None:
    rows = list(result.records)
    crashes = [row["kappa_difference"] for row in rows]
    assert [each.value for each in crashes[:3]] == pytest.approx([0.0, -0.25, -0.25])
    assert [(each.n, each.events) for each in crashes[:3]] == [(40, 0), (40, 10), (40, 10)]
    assert [row["kappa_all_difference"].events for row in rows[:3]] == [1, 10, 9]
    # 2 / 2^10 for ten on one side.  Six rows: the smallest p counts six times, the next no less.
    p = 2 / 2**10
    assert [each.p for each in crashes] == pytest.approx([1.0, p, p, 1.0, 1.0, 1.0])
    adjusted = [row["kappa_difference_p_holm"] for row in rows]
    assert adjusted == pytest.approx([1.0, 6 * p, 6 * p, 1.0, 1.0, 1.0])
    (table,) = [table for table in result.full if table.title == "Difference of crashes"]
    at = [column.key for column in table.columns].index("p_holm")
    assert [row[at].finding.value for row in table.rows] == pytest.approx(adjusted)
    said = {note.key: note.text for note in result.notes}
    more = "flow_per_hour 50, constant_speed crashes, times out or fails more often than soft_yield"
    assert said["more_crashes"].startswith(more)
    assert "over the pairs that count in both cells" in said["common_pairs"]


def drawn(scenario: Scenario, pair: int) -> Pair:
    """Times that share what is common to a pair, and differ by a noise of each strategy's own."""
    own = sum(scenario.arms.av.encode())
    return noisy(pair, own) + noisy(pair, 2), noisy(pair, 1, 20.0)


def test_a_difference_depends_on_neither_the_other_rows_nor_the_run() -> None:
    both = "soft_yield,hard_yield"
    (alone,) = compare(run_of(study({}, f"arms.av={both}"), drawn, 60)).records
    among = compare(run_of(study({}, f"arms.av=constant_speed,{both}"), drawn, 60)).records[2]
    apart = [run_of(study({"arms.av": name}), drawn, 60, name=name) for name in both.split(",")]
    (between,) = compare(*apart).records
    for key in DIFFERENCES:
        assert alone[key] == among[key] == between[key]


def test_a_p_of_0_is_shown_as_small() -> None:
    """All of 2,000 differences have one sign: 2^−1999 is no number."""
    of, mean_s = study({}, "arms.av=soft_yield,hard_yield"), {"soft_yield": 8, "hard_yield": 14}
    times = [{name: noisy(pair, at, at) for name, at in mean_s.items()} for pair in range(2_000)]
    made = run_of(of, lambda cell, pair: (times[pair][cell.arms.av], HUMAN_S), 2_000)
    assert "< 0.001" in screen_text(compare(made), 120)


@pytest.mark.parametrize(("pairs", "reliable"), [(499, False), (500, True)])
def test_from_500_pairs_that_differ_on_an_interval_is_reliable(pairs: int, reliable: bool) -> None:
    made = compare(run_of(study({}, "arms.av=soft_yield,hard_yield"), drawn, pairs))
    (row,) = made.records
    assert {row[key].reliable for key in DIFFERENCES} == {reliable}
    assert ("few_differ" in {note.key for note in made.notes}) != reliable


def test_what_has_no_interval_or_no_value_says_why() -> None:
    of = study({}, "arms.av=soft_yield,hard_yield")
    fates: dict[str, Fate] = {"soft_yield": 8.0, "hard_yield": FAILED}
    failed = compare(run_of(of, lambda cell, _: (fates[cell.arms.av], HUMAN_S), 5))
    (row,) = failed.records
    for key in DIFFERENCES:
        assert (row[key].value, row[key].reason) == (None, "no pair counts in both")
    one = compare(run_of(of, drawn, 1))
    assert one.records[0]["mu_difference"].reason == FEW
    assert "few_differ" in {note.key for note in one.notes}
    same = compare(run_of(of, lambda *_: (8.0, HUMAN_S), 5))
    assert "In 1 of 1 rows A − B is the same in every pair" in str(same.notes)


def version(name: str, seconds: float, pairs: int = 30, **changes: object) -> MadeRun:
    """A run of one strategy."""
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    of = study({"arms.av": "gap_yield"} | dotted)
    return run_of(of, lambda _, pair: (noisy(pair, 5, seconds), HUMAN_S), pairs, name=name)


def test_two_runs_are_told_apart_by_their_folders_and_share_their_first_pairs() -> None:
    yesterday = version("yesterday", 9.0)
    today = version("today", 8.0, 20, conflicts__ttc_s=2.0)
    made = compare(yesterday, today)
    (row,) = made.records
    assert (row["a"], row["b"]) == ("gap_yield (yesterday)", "gap_yield (today)")
    assert row["kappa_difference"].n == 20
    assert row["mu_difference"].value == pytest.approx(0.1)
    assert "20 to 30 pairs" in made.scope
    flows = run_of(study({}, FLOWS, name="cctc_flow"), by_hand, 40, name="flows")
    crowd = study({"arms.av": "hard_yield"}, name="cctc_flow")
    scope = compare(flows, run_of(crowd, by_hand, 40, name="crowd")).scope
    assert scope.endswith("without a partner: flow_per_hour 50, soft_yield (flows)")
    # A note of a cell has its name, though neither run varies anything.
    late = compare(version("a", 9.0), replace_fates(version("b", 9.0), "timed_out"))
    (note,) = [note for note in late.notes if note.key == "left_out"]
    assert note.text.startswith(
        "gap_yield (b): The ratio of times uses 30 of 30 pairs, μ and c_v use 0"
    )


def replace_fates(run: MadeRun, fate: Fate) -> MadeRun:
    """The same run with this end of the AV in every pair."""
    return run_of(run.study, lambda *_: (fate, HUMAN_S), 30, name=run.path.name)


def test_what_cannot_be_compared_is_refused_in_one_line() -> None:
    one, same_path = version("one", 9.0), version("one", 8.0)
    flows = run_of(study({}, FLOWS, name="cctc_flow"), by_hand, 3)
    town = replace(one, path=Path("town"), study=study({}, name="traffic"))
    slower = run_of(one.study, lambda _, pair: (8.0, HUMAN_S + (pair == 7)), 30, name="other")
    older: Any = {**one.manifest, "simulated_with": {"code": {"the rows": "1"}, "versions": {}}}
    fewer = run_of(
        one.study,
        lambda _, pair: (8.0, {"pass_time_s": HUMAN_S, "pedestrians": 1 + (pair == 4)}),
        30,
        name="people",
    )
    for runs, words in (
        ((one, same_path), "is named twice"),
        ((one, replace(slower, finished=False)), "other: is not finished"),
        ((one, replace(slower, manifest=older)), "other: has rows of other code or versions"),
        ((one, town), "town: is a run of simulations; allowed: runs of encounters, as one"),
        ((one,), "has no two cells that differ only in the AV"),
        ((flows,), "has no two cells that differ only in the AV"),
        ((one, slower), "drove otherwise than one in pair 7"),
        ((one, fewer), "drove otherwise than one in pair 4"),
        ((one, version("x", 9.0, experiment__seed=2)), "experiment.seed"),
        ((one, version("x", 9.0, pedestrians__max_count=2)), "pedestrians.max_count"),
        ((one, version("x", 9.0, arms__human="hard_yield")), "arms.human"),
        ((one, version("x", 9.0, strategies__human_gmm__speed="sampled")), "human_gmm.speed"),
        ((), "runs: there is none"),
    ):
        refuses(words, partial(compare, *runs))


P1 = "strategies.soft_yield.p1=0.3,0.1,0.2"


def bolder(scenario: Scenario, pair: int) -> Pair:
    """μ is 0.7, 0.9 and 1.1 at p1 = 0.1, 0.2 and 0.3; at 0.1 a quarter crashes."""
    p1: Any = scenario.strategies["soft_yield"]["p1"]
    if p1 == 0.1 and pair % 4 == 0:
        return "crashed", HUMAN_S
    return noisy(pair, 9, 5.0 + 20 * p1), HUMAN_S


@pytest.fixture(scope="module")
def swept() -> MadeRun:
    return run_of(study({}, P1), bolder, 2_700)


class Judged(NamedTuple):
    """The columns of the verdicts."""

    values: tuple[float, ...]
    mu: tuple[Finding, ...]
    kappa: tuple[Finding, ...]
    verdicts: tuple[str, ...]


def judged(run: MadeRun, mu0: float, kappa0: float) -> Judged:
    (found,) = allowed_in(groups_of([run]), mu0, kappa0, 0.95)
    assert (found.key, found.where) == ("strategies.soft_yield.p1", "")
    return Judged(*zip(*found.rows, strict=True))


def test_bounds_hold_over_all_values_together(swept: MadeRun) -> None:
    found = judged(swept, 1.0, 0.05)
    assert found.values == (0.1, 0.2, 0.3)
    assert found.verdicts == ("denied", "allowed", "denied")
    # Three values have six upper bounds, each at 1 − 0.05/6 (Bonferroni).
    level = 0.05 / 6
    _, middle, _ = found.kappa
    assert middle.high == pytest.approx(1 - level ** (1 / 2_700), rel=1e-9)
    crashed = found.kappa[0]
    assert (crashed.events, crashed.n) == (675, 2_700)
    assert crashed.low == pytest.approx(stats.beta.ppf(level, 675, 2_026), rel=1e-6)
    tau = np.array([noisy(pair, 9, 9.0) for pair in range(2_700)]) / HUMAN_S
    reach = stats.norm.ppf(1 - level) * tau.std() / math.sqrt(2_700)
    assert found.mu[1].value == pytest.approx(tau.mean())
    assert found.mu[1].high - tau.mean() == pytest.approx(reach, rel=0.07)
    assert [each.n for each in found.mu] == [2_025, 2_700, 2_700]
    full = compare(swept, mu0=1.0, kappa0=0.05).full
    (table,) = [table for table in full if "μ <" in table.title]
    rows = [(row[0], row[-1]) for row in table.rows]
    assert rows == [*zip(found.values, found.verdicts, strict=True)]


@pytest.mark.parametrize(
    ("mu0", "kappa0", "verdicts"),
    [
        (0.8, 0.5, ("allowed", "denied", "denied")),
        (1.0, 0.26, ("undecided", "allowed", "denied")),
        # 0 of 2,700 is below 0.18 %, and that is not below 0.1 %.
        (1.0, 0.001, ("denied", "undecided", "denied")),
        (0.9, 0.5, ("allowed", "undecided", "denied")),
    ],
)
def test_verdicts(swept: MadeRun, mu0: float, kappa0: float, verdicts: tuple[str, ...]) -> None:
    assert judged(swept, mu0, kappa0).verdicts == verdicts


def test_an_unreliable_bound_of_mu_decides_nothing() -> None:
    """1,999 informative pairs are too few, however far μ is from its limit; κ decides alone."""
    few = judged(run_of(study({}, P1), bolder, 1_999), 1.5, 0.05)
    assert few.verdicts == ("denied", "undecided", "undecided")
    assert {each.reliable for each in few.mu} == {False}
    assert few.mu[1].reason == "unreliable below 2,000 informative pairs (has 1,999)"
    # Equal in all pairs: there is no bound at all, and it says so.
    equal = judged(run_of(study({}, P1), lambda *_: (8.0, HUMAN_S), 2_500), 1.5, 0.05)
    assert {*equal.verdicts} == {"undecided"}
    assert {(each.reliable, each.reason) for each in equal.mu} == {(None, EQUAL)}


def test_time_outs_and_failures_are_not_allowed() -> None:
    """A strategy that does not arrive gains nothing: κ counts what it missed."""
    of = study({}, "strategies.soft_yield.p1=0.1,0.2")
    ends: tuple[Fate, Fate] = ("timed_out", FAILED)
    driving_on = {"ending": "crashed", "pass_time_ignoring_contact_s": 8.0}

    def fates(scenario: Scenario, pair: int) -> Pair:
        late = scenario.strategies["soft_yield"]["p1"] == 0.1
        human: Fate = HUMAN_S if pair < 2_400 else driving_on
        return (ends[0 if late else 1] if pair < 400 else noisy(pair, 9, 5.0)), human

    found = judged(run_of(of, fates, 2_500), 1.0, 0.05)
    assert [each.events for each in found.kappa] == [400, 400]
    # Nor does it by the 100 pairs in which the reference crashed, who counts as driving on.
    tau = [noisy(pair, 9, 5.0) / (10 if pair < 2_400 else 8) for pair in range(400, 2_500)]
    assert (found.mu[0].value, found.mu[0].n) == (pytest.approx(np.mean(tau)), 2_100)
    assert found.verdicts == ("denied", "denied")
