"""μ, c_v and κ with their intervals, against scipy, closed forms and hand counts."""

import math
from dataclasses import fields

import numpy as np
import pytest
from scipy import stats

from harness.comparison import (
    INDICATIVE_BELOW,
    PairColumns,
    bootstrap_mean_and_cv,
    proportion,
    summarise,
    zero_bound,
)
from harness.report.words import indicative, measure_rows


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def population_cv(values: np.ndarray, axis: int = -1) -> np.ndarray:
    return np.std(values, axis=axis) / np.mean(values, axis=axis)


SAMPLES = {
    "lognormal": np.random.default_rng(1).lognormal(-0.3, 0.3, 50),
    "heavy": np.random.default_rng(2).pareto(3.0, 80) + 0.6,
    "two groups": np.concatenate(
        [
            np.random.default_rng(3).normal(0.67, 0.02, 45),
            np.random.default_rng(4).normal(1.25, 0.1, 5),
        ]
    ),
    "a dozen": np.random.default_rng(5).gamma(4.0, 0.2, 12),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_bca_against_scipy(name: str) -> None:
    values = SAMPLES[name]
    ours = bootstrap_mean_and_cv(values, rng())
    for interval, statistic in zip(ours, (np.mean, population_cv), strict=True):
        assert interval.value == pytest.approx(float(statistic(values)), rel=1e-12)
        theirs = [
            stats.bootstrap(
                (values,), statistic, method="BCa", n_resamples=9_999, rng=seed, batch=500
            )
            for seed in (1, 2, 3)
        ]
        lows, highs = (
            np.array([getattr(result.confidence_interval, end) for result in theirs])
            for end in ("low", "high")
        )
        # Resampling noise of a 2.5 % point from 5,000 draws: some 3 % of the interval's width.
        width = (highs - lows).mean()
        assert interval.low == pytest.approx(lows.mean(), abs=0.08 * width)
        assert interval.high == pytest.approx(highs.mean(), abs=0.08 * width)


def test_bca_is_not_the_percentile_interval() -> None:
    # On a skewed sample the correction is many times the noise: the test above can tell.
    values = SAMPLES["heavy"]
    _, cv = bootstrap_mean_and_cv(values, rng())
    percentile = stats.bootstrap((values,), population_cv, method="percentile", rng=1)
    shift = abs(cv.high - percentile.confidence_interval.high)
    assert shift > 0.15 * (cv.high - cv.low)


def test_far_limits_have_resamples_beyond_them() -> None:
    # 99.99 %: from 5,000 resamples the limits would be the outermost of them, well inside.
    values = SAMPLES["a dozen"]
    ours = bootstrap_mean_and_cv(values, rng(), 1 - 1e-4)[0]
    theirs = stats.bootstrap(
        (values,), np.mean, confidence_level=1 - 1e-4, n_resamples=400_000, batch=20_000, rng=1
    ).confidence_interval
    width = theirs.high - theirs.low
    assert ours.low == pytest.approx(theirs.low, abs=0.02 * width)
    assert ours.high == pytest.approx(theirs.high, abs=0.02 * width)


def test_zero_spread_gives_the_point() -> None:
    mu, cv = bootstrap_mean_and_cv(np.full(20, 0.7), rng())
    assert (mu.low, mu.high) == (mu.value, mu.value)
    assert mu.value == pytest.approx(0.7, rel=1e-15)
    assert (cv.value, cv.low, cv.high) == (0.0, 0.0, 0.0)


def test_too_few_pairs() -> None:
    for interval in bootstrap_mean_and_cv(np.array([]), rng()):
        assert (interval.value, interval.low, interval.high) == (None, None, None)
    mu, _ = bootstrap_mean_and_cv(np.array([0.8]), rng())
    assert (mu.value, mu.low, mu.high) == (0.8, None, None)


def test_two_values_stay_between_them() -> None:
    mu, cv = bootstrap_mean_and_cv(np.array([0.5, 1.0]), rng())
    assert mu.value == 0.75
    assert 0.5 <= mu.low <= mu.high <= 1.0
    assert cv.value == pytest.approx(1 / 3)
    assert 0.0 <= cv.low <= cv.high <= 1 / 3 + 1e-12


@pytest.mark.parametrize(("successes", "trials"), [(0, 50), (1, 50), (7, 50), (50, 50), (3, 3)])
def test_clopper_pearson_by_beta_quantiles(successes: int, trials: int) -> None:
    interval = proportion(successes, trials)
    # Clopper–Pearson (1934): B(0.025; k, n − k + 1) and B(0.975; k + 1, n − k).
    low = 0.0 if successes == 0 else stats.beta.ppf(0.025, successes, trials - successes + 1)
    high = 1.0 if successes == trials else stats.beta.ppf(0.975, successes + 1, trials - successes)
    assert interval.value == successes / trials
    assert interval.low == pytest.approx(low, abs=1e-10)
    assert interval.high == pytest.approx(high, abs=1e-10)


def test_no_crash_in_fifty() -> None:
    # (1 − p)^50 = 0.05 one-sided, 0.025 two-sided.
    assert zero_bound(50) == pytest.approx(1 - 0.05 ** (1 / 50), abs=1e-12)
    assert round(100 * zero_bound(50), 1) == 5.8
    assert proportion(0, 50).high == pytest.approx(1 - 0.025 ** (1 / 50), abs=1e-10)
    assert round(100 * proportion(0, 50).high, 1) == 7.1
    assert proportion(0, 50).low == 0.0


def test_no_trials_no_proportion() -> None:
    interval = proportion(0, 0)
    assert (interval.value, interval.low, interval.high) == (None, None, None)


# Eight pairs, counted by hand.  c: crossed, x: crashed (f with the front), t: timed out, e: engine.
#           AV       human
PAIRS = [
    ("c", 6.0, "c", 10.0),  # τ = 0.6
    ("c", 9.0, "c", 10.0),  # τ = 0.9, fallback
    ("c", 12.0, "c", 8.0),  # τ = 1.5
    ("x", None, "c", 9.0),
    ("f", None, "c", 9.0),
    ("t", None, "c", 30.0),  # time-out counted: 60/30 = 2
    ("c", 15.0, "t", None),  # 15/60 = 0.25
    ("e", None, "x", None),
]


def columns() -> PairColumns:
    """Filled by name, whatever else the comparison keeps beside these."""
    av, human = [row[0] for row in PAIRS], [row[2] for row in PAIRS]
    passed = [
        np.array([math.nan if t is None else t for t in column], dtype=float)
        for column in ([row[1] for row in PAIRS], [row[3] for row in PAIRS])
    ]
    known = {
        "time_s": tuple(passed),
        "delay_s": tuple(times - 7.4 for times in passed),
        "stops": (np.zeros(8), np.zeros(8)),
        "stopped_s": (np.zeros(8), np.zeros(8)),
        "crashed": tuple(np.array([e in "xf" for e in arm]) for arm in (av, human)),
        "timed_out": tuple(np.array([e == "t" for e in arm]) for arm in (av, human)),
        "failed": tuple(np.array([e == "e" for e in arm]) for arm in (av, human)),
        "front": tuple(np.array([e == "f" for e in arm]) for arm in (av, human)),
        "avoidable": tuple(np.array([e == "f" for e in arm]) for arm in (av, human)),
        "av_fallback": np.array([False, True] + [False] * 6),
        "met": np.array([2, 1, 0, 1, 1, 3, 0, 1]),
    }
    return PairColumns(**{field.name: known[field.name] for field in fields(PairColumns)})


def test_summary_of_hand_counted_pairs() -> None:
    summary = summarise(columns(), 60.0, rng())
    assert (summary.pairs, summary.defined_pairs) == (8, 3)
    assert (summary.timed_out, summary.failed) == (2, 1)
    assert (summary.fallbacks, summary.met_nobody) == (1, 2)
    tau = np.array([0.6, 0.9, 1.5])
    assert summary.mu.value == pytest.approx(1.0)
    assert summary.cv.value == pytest.approx(math.sqrt(((tau - 1) ** 2).mean()))
    assert summary.mu_without_fallback == pytest.approx((0.6 + 1.5) / 2)
    # Timed-out arms counted at 60 s; crashed and failed ones have no time at all.
    assert summary.mu_timeout == pytest.approx((0.6 + 0.9 + 1.5 + 2.0 + 0.25) / 5)
    # κ: 2 crashes in the 7 AV episodes that ran; the human's 1 in all 8.
    assert summary.kappa.value == pytest.approx(2 / 7)
    assert summary.kappa_front == pytest.approx(1 / 7)
    # Those with the front were avoidable, by the hand that made the pairs.
    assert summary.kappa_avoidable.value == pytest.approx(1 / 7)
    assert summary.kappa_avoidable.high == pytest.approx(stats.beta.ppf(0.975, 2, 6), abs=1e-10)
    assert (summary.kappa_avoidable_human.successes, summary.kappa_avoidable_human.trials) == (0, 8)
    assert summary.kappa_human.value == pytest.approx(1 / 8)
    assert summary.kappa.low == pytest.approx(stats.beta.ppf(0.025, 2, 6), abs=1e-10)


def test_resampling_does_not_change_with_the_batches() -> None:
    one, other = (bootstrap_mean_and_cv(SAMPLES["heavy"], rng()) for _ in range(2))
    assert one == other


def test_few_pairs_are_said_to_be_few() -> None:
    # Every bootstrap interval of a cell, printed with three pairs; exact ones never.
    remarks = {row[0]: row[4] for row in measure_rows(summarise(columns(), 60.0, rng()))}
    marked = {name for name, remark in remarks.items() if "N too small" in remark}
    assert marked == {"μ   mean of τ", "c_v spread of τ", "delay AV, s", "delay human, s"}
    for name, limit in INDICATIVE_BELOW.items():
        assert (indicative(limit - 1, name), indicative(limit, name)) == (
            "indicative: N too small",
            "",
        )
