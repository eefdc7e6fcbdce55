"""Sentences and numbers about results."""

from dataclasses import replace

import numpy as np
import pytest

from harness.comparison import (
    ENCOUNTERS,
    EncounterColumns,
    Interval,
    PairColumns,
    Resampled,
    Summary,
    proportion,
    summarise,
)
from harness.report.result_tables import measure_rows, tiles
from harness.report.tables import per_cent
from harness.report.words import crash_lines, is_the_papers, time_lines, walker_lines
from harness.scenario import Scenario, load_scenario, parse_setting


@pytest.mark.parametrize(
    ("share", "decimals", "text"),
    [
        (0.05818, 1, "5.8"),
        (0.5, 1, "50.0"),
        (1.0, 1, "100.0"),
        (0.0, 1, "0.0"),
        (0.000307, 1, "0.031"),
        (0.0099, 1, "0.99"),
        (0.000378, 2, "0.038"),
        (1.5e-7, 2, "0.000015"),
        (0.0711, 2, "7.11"),
    ],
)
def test_small_shares_keep_two_digits(share: float, decimals: int, text: str) -> None:
    assert per_cent(share, decimals) == text


def columns(pairs: int) -> PairColumns:
    """So many pairs in which nothing happened; τ is near 0.8 or 0.9 in turn."""
    no, none = np.zeros(pairs, dtype=bool), np.zeros(pairs)
    last = np.arange(pairs) - (pairs - 1) / 2
    av = np.where(np.arange(pairs) % 2, 8.0, 9.0) + 1e-7 * last
    return PairColumns(
        time_s=(av, np.full(pairs, 10.0)),
        untouched_time_s=(av, np.full(pairs, 10.0)),
        delay_s=(av - 7.4, np.full(pairs, 2.6)),
        stops=(none, none),
        stopped_s=(none, none),
        crashed=(no, no),
        front=(no, no),
        avoidable=(no, no),
        timed_out=(no, no),
        failed=(no, no),
        failed_strategy=(no, no),
        met=(none + 1, none + 1),
        arrivals=(none + 1, none + 1),
        waited_s=(none, none),
        conditionings=(none + 4, none),
        clamped=(none + 1, none),
        speed_excess_mps=(none + 2.5, none * np.nan),
        range_excess_m=(none + 20.0, none * np.nan),
        max_speed_mps=(none + 5.0, none + 5.0),
        av_fallback=no,
    )


def having(summary: Summary, **intervals: Interval) -> Summary:
    """The summary with other findings under these names."""
    entries = {name: entry for entry in ENCOUNTERS for name in filter(None, entry.names)}
    met = summary.met_someone
    found = {name: entries[name].finding(name, of, met) for name, of in intervals.items()}
    return Summary({**summary.findings, **found})


@pytest.mark.parametrize(
    ("pairs", "one_sided", "two_sided"),
    # 1 − 0.05^(1/N) and 1 − 0.025^(1/N), in per cent.
    [(50, "5.8 %", "7.1 %"), (10_000, "0.030 %", "0.037 %")],
)
def test_no_crash_never_reads_as_no_risk(pairs: int, one_sided: str, two_sided: str) -> None:
    summary = summarise(EncounterColumns(columns(pairs), 60.0, 7.4, np.random.default_rng(1)))
    line, _ = crash_lines(summary)
    assert (
        f"κ below {one_sided} with 95 % confidence, one-sided ({two_sided} two-sided, 95 %)" in line
    )
    rows = {name: interval for name, _, interval, _, _ in measure_rows(summary)}
    upper = rows["κ: crash rate, AV"].split(" … ")[1]
    assert float(upper.removesuffix(" %")) > 0


def test_crashes_are_counted_with_their_interval() -> None:
    summary = summarise(EncounterColumns(columns(50), 60.0, 7.4, np.random.default_rng(1)))
    summary = having(summary, kappa=proportion(3, 50))
    # Clopper–Pearson for 3 of 50: 1.25 % to 16.55 % (binom.test in R).
    assert crash_lines(summary)[0] == (
        "The AV crashed in 3 of 50 episodes: κ = 6.00 % (1.25 … 16.55 %, 95 % interval)."
    )


def driven_by(av: str, human: str) -> Scenario:
    return load_scenario("cctc", {"arms.av": av, "arms.human": human})


def test_what_the_times_tell() -> None:
    summary = summarise(EncounterColumns(columns(50), 60.0, 7.4, np.random.default_rng(1)))
    own = driven_by("own:Av", "human_gmm")
    first, second = time_lines(summary, own)
    # 25 pairs of 8 s and 25 of 9 s against 50 of 10 s.
    assert "took 15.0 % less time than human_gmm, the reference: ratio of times 0.8500" in first
    assert "no pair left out" in first
    assert "unreliable below 1,000 informative pairs (has 50)" in first
    assert "not told" not in first
    same = having(summary, time_ratio=Resampled(1.0, 1.0, 1.0, 0))
    alike = time_lines(same, own)[0]
    assert "the AV took as much time as human_gmm" in alike
    assert "not told" not in alike
    assert "μ = 0.8500" in second
    first, _ = time_lines(having(summary, time_ratio=Resampled(1.02, 0.97, 1.08, 1_000)), own)
    assert "2.0 % more" in first
    assert "the interval holds 1: who takes less time is not told" in first
    _, second = time_lines(having(summary, mu=Resampled(None, None, None, 0)), own)
    assert second == "τ is defined in no pair: neither μ nor c_v can be told."
    (line,) = time_lines(having(summary, time_ratio=Resampled(None, None, None, 0)), own)
    assert "nothing is known of its time" in line


def test_less_time_is_said_of_sums_and_not_of_a_mean_of_quotients() -> None:
    # 10 s against 5 s and 10 s against 20 s: μ = (2 + 0.5)/2 = 1.25, and 20 s against 25 s.
    pairs, human = columns(2), np.array([5.0, 20.0])
    av = np.array([10.0, 10.0])
    pairs = replace(pairs, time_s=(av, human), untouched_time_s=(av, human))
    summary = summarise(EncounterColumns(pairs, 60.0, 5.0, np.random.default_rng(1)))
    first, second = time_lines(summary, driven_by("own:Av", "human_gmm"))
    assert "took 20.0 % less time" in first
    assert "μ = 1.2500" in second


def test_what_the_ratio_of_times_leaves_out_stands_beside_it() -> None:
    pairs = columns(4)
    crashed = np.array([True, False, False, False])
    times = (np.where(crashed, np.nan, pairs.time_s[0]), pairs.time_s[1])
    pairs = replace(pairs, time_s=times, crashed=(crashed, np.zeros(4, dtype=bool)))
    summary = summarise(EncounterColumns(pairs, 60.0, 7.4, np.random.default_rng(1)))
    # 8 + 9 + 8 s against 30 s; at its worst the crash counts with the time-out, 85 s against 40.
    first, _ = time_lines(summary, driven_by("own:Av", "human_gmm"))
    assert "ratio of times 0.8333" in first
    assert "1 pair left out, as the AV crashed or an arm failed: worst case 2.1250" in first


@pytest.mark.parametrize(
    ("human", "ratio", "opposite"),
    # docs/study.md, cctc: Gap-Yield takes less time than human_gmm, more than human_recorded.
    [
        ("human_gmm", 0.72, "more time than human_recorded"),
        ("human_yield", 0.96, "more time than human_recorded"),
        ("human_recorded", 1.10, "less time than human_gmm"),
        ("human_gmm", 1.10, None),
        ("human_recorded", 0.72, None),
        ("own.driver", 0.72, None),
    ],
)
def test_known_disagreement_of_the_references_is_said(human, ratio, opposite) -> None:
    summary = summarise(EncounterColumns(columns(50), 60.0, 7.4, np.random.default_rng(1)))
    summary = having(summary, time_ratio=Resampled(ratio, ratio, ratio, 0))
    line, _ = time_lines(summary, driven_by("gap_yield", human))
    assert f"time than {human}, the reference" in line
    assert ("the references disagree" in line) == (opposite is not None)
    assert (opposite or "") in line


# N from which docs/method.md calls the intervals of μ and of c_v no longer indicative.
@pytest.mark.parametrize(
    ("pairs", "of_mu", "of_cv"), [(999, True, True), (1_000, False, True), (4_000, False, False)]
)
def test_each_interval_is_indicative_below_its_own_n(pairs: int, of_mu: bool, of_cv: bool) -> None:
    summary = summarise(EncounterColumns(columns(pairs), 60.0, 7.4, np.random.default_rng(1)))
    said = {
        tile["name"].split(",")[0]: any("unreliable below" in line for line in tile["lines"])
        for tile in tiles(summary, "human_gmm")
    }
    assert (said["μ"], said["c_v"]) == (of_mu, of_cv)
    _, line = time_lines(summary, driven_by("own:Av", "human_gmm"))
    assert ("; unreliable below" in line, "; c_v: unreliable below" in line) == (
        of_mu,
        of_cv and not of_mu,
    )


@pytest.mark.parametrize(
    ("setting", "papers"),
    [
        ("experiment.pairs=2000", True),
        ("model.name=dut-k10", True),
        ("ego.initial_speed_mps=6", False),
        ("arms.av=hard_yield", False),
        ("crossing.oncoming_lanes=0", False),
        ("strategies.soft_yield.time_margin_s=0", True),
        ("strategies.soft_yield.time_margin_s=1", False),
        ("strategies.human_gmm.reading=marginal", False),
        ("pedestrians.behaviour=reactive", False),
        ("pedestrians.max_count=2", False),
    ],
)
def test_the_papers_numbers_stand_beside_its_own_experiment_alone(
    setting: str, papers: bool
) -> None:
    assert is_the_papers(load_scenario("cctc", [parse_setting(setting)])) is papers


@pytest.mark.parametrize(
    ("setting", "drawn"),
    [
        ("experiment.pairs=20", True),
        ("model.pedestrian_reading=unconditional", False),
        ("model.name=dut-k10", False),
    ],
)
def test_walking_speeds_of_dut_are_said_to_hardly_depend_on_the_car(setting, drawn) -> None:
    assert bool(walker_lines([load_scenario("cctc", [parse_setting(setting)])])) is drawn
