"""Sentences and numbers about results."""

from dataclasses import replace

import numpy as np
import pytest

from harness.comparison import Interval, PairColumns, proportion, summarise
from harness.report.page_tables import tiles
from harness.report.words import crash_lines, is_the_papers, measure_rows, per_cent, tau_lines
from harness.scenario import load_scenario, parse_setting


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
    """So many pairs in which nothing happened; τ is 0.8 or 0.9 in turn."""
    no, none = np.zeros(pairs, dtype=bool), np.zeros(pairs)
    av = np.where(np.arange(pairs) % 2, 8.0, 9.0)
    return PairColumns(
        time_s=(av, np.full(pairs, 10.0)),
        delay_s=(av - 7.4, np.full(pairs, 2.6)),
        stops=(none, none),
        stopped_s=(none, none),
        crashed=(no, no),
        front=(no, no),
        avoidable=(no, no),
        timed_out=(no, no),
        failed=(no, no),
        av_fallback=no,
        met=np.ones(pairs),
    )


@pytest.mark.parametrize(
    ("pairs", "one_sided", "two_sided"),
    # 1 − 0.05^(1/N) and 1 − 0.025^(1/N), in per cent.
    [(50, "5.8 %", "7.1 %"), (10_000, "0.030 %", "0.037 %")],
)
def test_no_crash_never_reads_as_no_risk(pairs: int, one_sided: str, two_sided: str) -> None:
    summary = summarise(columns(pairs), 60.0, np.random.default_rng(1))
    line, _ = crash_lines(summary)
    assert f"κ below {one_sided} with 95 % confidence, one-sided ({two_sided} two-sided)" in line
    rows = {name: interval for name, _, interval, _, _ in measure_rows(summary)}
    upper = rows["κ   crash rate, AV"].split(" … ")[1]
    assert float(upper.removesuffix(" %")) > 0


def test_crashes_are_counted_with_their_interval() -> None:
    summary = summarise(columns(50), 60.0, np.random.default_rng(1))
    summary = replace(summary, kappa=proportion(3, 50))
    # Clopper–Pearson for 3 of 50: 1.25 % to 16.55 % (binom.test in R).
    assert crash_lines(summary)[0] == (
        "The AV crashed in 3 of 50 episodes: κ = 6.00 % (1.25 … 16.55 %)."
    )


def test_what_mu_tells() -> None:
    summary = summarise(columns(50), 60.0, np.random.default_rng(1))
    (line,) = tau_lines(summary)
    assert "the AV took 15.0 % less time than the human driver: μ = 0.8500" in line
    assert "indicative: N too small" in line
    assert "not told" not in line
    (line,) = tau_lines(replace(summary, mu=Interval(1.02, 0.97, 1.08)))
    assert "2.0 % more" in line
    assert "the interval of μ holds 1: which is faster is not told" in line
    (line,) = tau_lines(replace(summary, mu=Interval(None, None, None)))
    assert line == "τ is defined in no pair: neither μ nor c_v can be told."


# N from which docs/method.md calls the intervals of μ and of c_v no longer indicative.
@pytest.mark.parametrize(
    ("pairs", "of_mu", "of_cv"), [(999, True, True), (1_000, False, True), (4_000, False, False)]
)
def test_each_interval_is_indicative_below_its_own_n(pairs: int, of_mu: bool, of_cv: bool) -> None:
    summary = summarise(columns(pairs), 60.0, np.random.default_rng(1))
    said = {
        tile["name"].split(",")[0]: "indicative: N too small" in tile["lines"]
        for tile in tiles(summary)
    }
    assert (said["μ"], said["c_v"]) == (of_mu, of_cv)
    (line,) = tau_lines(summary)
    assert ("; indicative: N too small" in line, "; c_v indicative" in line) == (
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
