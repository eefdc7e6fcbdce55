"""Peaks over threshold on tails of known probability, and counts of conflicts."""

import csv
import math
from itertools import product

import numpy as np
import pytest
from scipy.stats import binom, genpareto, norm

from benchmarks import surrogates
from benchmarks.surrogate_cases import CASES, Truth
from benchmarks.surrogates import CONFLICTS, DATA, Sample, conflicts, tail_of
from benchmarks.tails import EXCESSES, FEWEST_VALUES, Tail, fit_tail
from harness.core.encounter import FloatArray

SHAPES = (-0.1, 0.0, 0.2)


def drawn(shape: float, kappa: float, size: int, rng: np.random.Generator) -> FloatArray:
    """A measure whose excesses are generalised Pareto above every threshold, and P(≤ 0) = κ."""
    at_crash = genpareto.isf(kappa, shape)
    values: FloatArray = at_crash - genpareto.rvs(shape, size=size, random_state=rng)
    return values


def fits(shape: float, kappa: float, size: int, repeats: int) -> list[Tail]:
    rng = np.random.default_rng(29)
    found = []
    for _ in range(repeats):
        values = drawn(shape, kappa, size, rng)
        fit = fit_tail(values[values > 0], size)
        assert fit is not None
        found.append(fit)
    return found


@pytest.mark.parametrize("shape", SHAPES)
def test_intervals_hold_a_known_probability_as_often_as_they_say(shape: float) -> None:
    """With 1,000 excesses the likelihood is near its limit: 95 %, up to chance (1 in 1,000)."""
    kappa, repeats = 1e-6, 120
    found = fits(shape, kappa, 20_000, repeats)
    held = sum(fit.low <= kappa <= fit.high for fit in found)
    assert held >= binom.ppf(1e-3, repeats, 0.95)
    # An interval without end would always hold it.
    assert np.median([fit.high for fit in found]) < 50 * kappa
    assert held < repeats


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("size", "kappa"), [(1_000, 1e-5), (20_000, 1e-6), (100_000, 1e-7)])
def test_coverage_of_a_known_probability(shape: float, size: int, kappa: float) -> None:
    """50 excesses are few: their intervals hold the truth in 90 % at least."""
    repeats = 500
    held = sum(fit.low <= kappa <= fit.high for fit in fits(shape, kappa, size, repeats))
    if size == 1_000:
        assert 0.9 * repeats <= held <= 0.97 * repeats
    else:
        assert binom.ppf(1e-3, repeats, 0.95) <= held <= binom.ppf(1 - 1e-3, repeats, 0.95)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_fit_is_scipys_and_near_the_truth(shape: float) -> None:
    kappa, size = 1e-5, 50_000
    values = drawn(shape, kappa, size, np.random.default_rng(7))
    values = values[values > 0]
    fit = fit_tail(values, size)
    assert fit is not None
    excess = fit.threshold - values[values < fit.threshold]
    assert len(excess) == fit.excesses == round(0.05 * len(values))
    xi, _, sigma = genpareto.fit(excess, floc=0)
    assert fit.shape == pytest.approx(xi, abs=0.01)
    assert fit.scale == pytest.approx(sigma, rel=0.01)
    # Asymptotic standard error of the maximum likelihood estimate (Smith 1987).
    assert abs(fit.shape - shape) < 4 * (1 + shape) / math.sqrt(len(excess))


def test_a_tail_that_ends_before_the_crash_predicts_none() -> None:
    """TTC is uniform from 1 s on, as if every episode stopped in time: ξ = −1, end at 1 s."""
    fit = fit_tail(np.linspace(1.0, 3.0, 2_000), 2_000)
    assert fit is not None
    assert (fit.probability, fit.low, fit.high) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "values",
    [np.linspace(1, 3, FEWEST_VALUES - 1), np.repeat([1.17, 1.2], [29, 971])],
    ids=["few", "tied"],
)
def test_too_few_values_or_excesses_are_not_fitted(values: FloatArray) -> None:
    assert fit_tail(values, 1_000) is None


def test_at_least_fifty_excesses() -> None:
    fit = fit_tail(np.linspace(1, 3, FEWEST_VALUES), 1_000)
    assert fit is not None
    assert fit.excesses == EXCESSES


HAND_MADE = Sample(
    Truth(0.25, 0.0, "by hand"),
    np.array([True, False, False, False]),
    np.array(
        [
            [math.nan, math.nan, math.nan],  # a crash
            [1.5, 0.99, 3.35],  # TTC and DRAC equal their thresholds
            [1.49, 1.0, 8.01],
            [math.nan, 1.2, math.nan],
        ]
    ),
)


def test_conflicts_of_a_hand_made_table() -> None:
    """By hand: strictly beyond the threshold, undefined never, a crash never."""
    counts = [conflicts(HAND_MADE, *conflict) for conflict in CONFLICTS]
    assert counts == [1, 3, 1, 1, 1]


def test_crashes_as_zero_reach_the_crash() -> None:
    """The tail of 2 − y ends at 2 − 0.5/0.3 = 0.33 s, unless five crashes at 0 belong to it."""
    values = np.full((200, 3), math.nan)
    values[5:, 0] = 2.0 - genpareto.rvs(-0.3, scale=0.5, size=195, random_state=1)
    values[:5] = math.nan
    crashed = np.arange(200) < 5
    sample = Sample(Truth(0.025, 0.0, "by hand"), crashed, values)
    without, with_them = (tail_of(sample, "min_ttc_s", how) for how in ("left out", "as 0"))
    assert without is not None
    assert with_them is not None
    assert without.probability == 0
    assert with_them.probability > 0


def test_episodes_crash_as_often_as_their_known_probability() -> None:
    """κ is from integrals, sums, or other seeds; the episodes of the predictions are their own."""
    with (DATA / "surrogates_scenarios.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["case"] for row in rows] == list(CASES)
    for row in rows:
        kappa, error = float(row["kappa"]), float(row["standard_error"])
        assert error <= 0.1 * kappa
        episodes, crashed = int(row["episodes"]), int(row["crashed"])
        if error == 0:
            low, high = binom.ppf([1e-4, 1 - 1e-4], episodes, kappa)
            assert low <= crashed <= high
        else:
            both = math.hypot(error, math.sqrt(kappa * (1 - kappa) / episodes))
            assert abs(crashed / episodes - kappa) <= norm.isf(1e-4) * both


def test_ratios_and_ends_are_counted_by_hand() -> None:
    tails = [Tail(0.02, 0.01, 0.03, 0.1, 1, 1, 50), Tail(0.0, 0.0, 0.005, -0.5, 1, 1, 50), None]
    verdict = surrogates.verdict(tails, 0.01)
    asked = ("samples", "no_fit", "no_crash", "held", "too_low", "too_high", "ratio")
    assert [verdict[key] for key in asked] == [3, 1, 1, 1, 1, 0, "1"]


def test_the_page_has_the_tables_numbers() -> None:
    page = (DATA.parents[1] / "docs" / "surrogates.md").read_text(encoding="utf-8")
    for name in CASES:
        cells = next(
            line.split(" | ")[1:]
            for line in page.splitlines()
            if line.startswith(f"| `{name}` |") and len(line.split(" | ")) == 7
        )
        for cell, (measure, size) in zip(
            cells, product(("min_ttc_s", "pet_s"), ("1000", "10000", "100000")), strict=True
        ):
            (row,) = rows_of("tails", name, measure, size)
            fitted = int(row["samples"]) - int(row["no_fit"])
            expected = f"; {row['held']} of {fitted}" if fitted else "no fit"
            assert cell.removesuffix(" |").endswith(expected), (name, measure, size)


def rows_of(table: str, *key: str) -> list[dict[str, str]]:
    """The rows of a table in which crashes are left out, by scenario, measure and size."""
    with (DATA / f"surrogates_{table}.csv").open(encoding="utf-8") as file:
        return [
            row
            for row in csv.DictReader(file)
            if row["crashes"] == "left out"
            and (row["case"], row["measure"], row["episodes"]) == key
        ]
