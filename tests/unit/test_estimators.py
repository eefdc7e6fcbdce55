"""Estimators against SciPy, closed forms, published examples and hand counts."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from harness.results import estimators as of
from harness.results.finding import Finding, finding_to_dict
from harness.studies.differences import holm


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def at(confidence: float = 0.95) -> of.Sampling:
    return of.Sampling(rng(), confidence)


def population_cv(values: np.ndarray, axis: int = -1) -> np.ndarray:
    return np.std(values, axis=axis) / np.mean(values, axis=axis)


SAMPLES = {
    "lognormal": rng(1).lognormal(-0.3, 0.3, 50),
    "heavy": rng(2).pareto(3.0, 80) + 0.6,
    "two groups": np.concatenate([rng(3).normal(0.67, 0.02, 45), rng(4).normal(1.25, 0.1, 5)]),
    "a dozen": rng(5).gamma(4.0, 0.2, 12),
}


@pytest.mark.parametrize("name", SAMPLES)
@pytest.mark.parametrize(
    ("ours", "theirs"), [(of.mean, np.mean), (of.coefficient_of_variation, population_cv)]
)
def test_bca_against_scipy(name: str, ours, theirs) -> None:
    values = SAMPLES[name]
    found = ours(values, at())
    assert found.value == pytest.approx(float(theirs(values)), rel=1e-12)
    assert (found.n, found.reliable) == (len(values), True)
    ends = [
        stats.bootstrap((values,), theirs, method="BCa", n_resamples=9_999, rng=seed, batch=500)
        for seed in (1, 2, 3)
    ]
    low, high = np.mean([each.confidence_interval for each in ends], axis=0)
    # Resampling noise of a 2.5 % point from 5,000 draws: some 3 % of the interval's width.
    assert (found.low, found.high) == pytest.approx((low, high), abs=0.08 * (high - low))


def test_bca_is_not_the_percentile_interval_and_far_limits_have_resamples_beyond() -> None:
    # On a skewed sample the correction is many times the noise: the test above can tell.
    cv = of.coefficient_of_variation(SAMPLES["heavy"], at())
    percentile = stats.bootstrap((SAMPLES["heavy"],), population_cv, method="percentile", rng=1)
    assert abs(cv.high - percentile.confidence_interval.high) > 0.15 * (cv.high - cv.low)
    # 99.99 %: from 5,000 resamples the limits would be the outermost of them, well inside.
    values = SAMPLES["a dozen"]
    ours = of.mean(values, at(1 - 1e-4))
    theirs = stats.bootstrap(
        (values,), np.mean, confidence_level=1 - 1e-4, n_resamples=400_000, batch=20_000, rng=1
    ).confidence_interval
    width = theirs.high - theirs.low
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.02 * width)


def test_ratio_of_sums_against_scipy() -> None:
    # A few crowds among many pairs with one: the bias and the acceleration are large.
    people = np.floor(2 * rng(11).pareto(1.5, 40)) + 1
    waits = 10 * np.sqrt(people) * rng(12).random(40)
    ours = of.ratio(waits, people, at())
    assert ours.value == pytest.approx(waits.sum() / people.sum(), rel=1e-12)
    low, high = stats.bootstrap(
        (waits, people),
        lambda a, b, axis=-1: a.sum(axis=axis) / b.sum(axis=axis),
        paired=True,
        n_resamples=19_999,
        rng=1,
        batch=500,
    ).confidence_interval
    assert (ours.low, ours.high) == pytest.approx((low, high), abs=0.05 * (high - low))


def test_intervals_are_undefined_or_missing_with_a_reason() -> None:
    nan = np.nan
    for estimate in (of.mean, of.coefficient_of_variation):
        assert estimate(np.full(3, nan), at()) == Finding(None, n=0)
    assert of.coefficient_of_variation(np.array([0.8, nan]), at()).value is None
    assert of.ratio(np.zeros(2), np.zeros(2), at()) == Finding(None, n=0)
    one = of.mean(np.array([0.8, nan]), at())
    assert (one.value, one.low, one.reliable, one.reason) == (0.8, None, None, of.FEW)
    # One pair with people: whatever leaves it out, or does not draw it, has no ratio.
    alone = of.ratio(np.array([6.0, 0, 0]), np.array([3.0, 0, 0]), at())
    assert (alone.value, alone.low, alone.reason) == (2.0, None, of.FEW)
    equal = (
        of.mean(np.full(20, 0.7), at()),
        of.ratio(np.array([2.0, 4, 6]), np.array([1.0, 2, 3]), at()),
        of.coefficient_of_variation(np.full(20, 0.7), at()),
    )
    values = [found.value for found in equal]
    assert values == pytest.approx([0.7, 2.0, 0.0], abs=1e-12)
    assert {(f.low, f.high, f.n, f.reliable, f.reason) for f in equal} == {
        (None, None, 0, None, of.EQUAL)
    }
    # Whoever asks for no interval is given none, and no reason.
    assert of.mean(SAMPLES["a dozen"], of.Sampling(None, 0.0)).reason is None


@given(st.lists(st.floats(0.1, 10.0), min_size=2, max_size=30))
def test_an_interval_of_a_mean_lies_within_the_values(values: list[float]) -> None:
    found = of.mean(np.array(values), at())
    if found.low is None:
        assert found.reason in (of.EQUAL, of.FEW)
    else:
        assert min(values) - 1e-9 <= found.low <= found.high <= max(values) + 1e-9
    read: dict = finding_to_dict(found)
    assert Finding(**read) == found


def test_pairs_that_met_nobody_tell_nothing() -> None:
    # Of 1,000 pairs at a low flow three met someone; in the last bits no two sums are the same.
    last_bits = 1e-15 * rng().integers(-3, 4, 1_000)
    tau = np.where(np.arange(1_000) < 3, [0.8, 1.4, 0.9] + [1.0] * 997, 1.0) + last_bits
    free_s = np.full(1_000, 7.4)
    for found in (
        of.mean(tau, at()),
        of.coefficient_of_variation(tau, at()),
        of.ratio(free_s * tau, free_s, at()),
        of.ratio(free_s * tau + 1.0, free_s, at()),
    ):
        assert found.n == 3
    assert of.informative(rng().normal(size=1_000)) == 1_000
    assert of.informative(np.array([])) == 0
    # Two equal values are as much the most common one as 997.
    assert of.informative(np.array([1.0, 1.0, 2.0, 3.0])) == 2


def test_resampling_depends_on_neither_batches_nor_earlier_calls(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sampling = at()
    whole = of.mean(SAMPLES["heavy"], sampling)
    monkeypatch.setattr(of, "_DRAWS_IN_MEMORY", 7 * 80)
    assert of.mean(SAMPLES["heavy"], sampling) == whole


@pytest.mark.parametrize(("events", "n"), [(0, 50), (1, 50), (7, 50), (50, 50), (3, 3)])
def test_clopper_pearson_by_beta_quantiles(events: int, n: int) -> None:
    marked, trials = np.arange(n + 5) < events, np.arange(n + 5) < n
    found = of.share(marked, trials, at())
    assert (found.value, found.events, found.n, found.reliable) == (events / n, events, n, True)
    low = stats.beta.ppf(0.025, events, n - events + 1) if events else 0.0
    high = stats.beta.ppf(0.975, events + 1, n - events) if events < n else 1.0
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-10)


def test_shares_without_an_interval() -> None:
    none, every = np.zeros(5, dtype=bool), np.ones(5, dtype=bool)
    assert of.share(every, none, at()) == Finding(None, n=0, events=0)
    again = of.share(none, every, at()._replace(repeated=True))
    assert again == Finding(0.0, n=5, events=0, reason=of.REPEATED)
    assert of.share(none, every, at(0.0)) == Finding(0.0, n=5, events=0)


@given(st.integers(1, 5_000), st.sampled_from([0.9, 0.95, 0.975, 1 - 0.05 / 6]))
def test_the_bound_at_no_event_is_one_sided_at_any_confidence(n: int, confidence: float) -> None:
    """(1 − p)^n = 0.05: n trials without an event have that probability at the bound."""
    found = of.share(np.zeros(n, dtype=bool), np.ones(n, dtype=bool), at(confidence))
    assert found.high == pytest.approx(1 - ((1 - confidence) / 2) ** (1 / n), rel=1e-9)
    assert of.zero_bound(found.high, confidence) == pytest.approx(1 - 0.05 ** (1 / n), rel=1e-9)


def test_the_limits_of_a_quantile_keep_their_errors() -> None:
    # 59 values are the fewest whose largest bounds the 95 % quantile with 95 %: 0.95⁵⁹ < 0.05.
    assert of.quantile(np.arange(59.0), 0.95, 0.9).high == 58.0
    few = of.quantile(np.arange(58.0), 0.95, 0.9)
    assert (few.value, few.high, few.reason) == (55.0, None, of.FEW_BEYOND)
    assert of.quantile(np.array([np.nan]), 0.95, 0.9).value is None
    limits = [of.quantile(row, 0.95, 0.9) for row in rng(4).random((4_000, 150))]
    most = 0.05 + 3 * math.sqrt(0.05 * 0.95 / 4_000)
    assert np.mean([limit.high < 0.95 for limit in limits]) <= most
    assert np.mean([limit.low > 0.95 for limit in limits]) <= most


def columns(both: int, only_a: int, only_b: int, neither: int) -> tuple[np.ndarray, np.ndarray]:
    """Shuffled columns of two cells with these counts of marked pairs."""
    counts = [both, only_a, only_b, neither]
    a, b = (np.repeat(marks, counts) for marks in ([1, 1, 0, 0], [1, 0, 1, 0]))
    order = rng().permutation(len(a))
    return a[order] > 0, b[order] > 0


@pytest.mark.parametrize(
    ("counts", "p", "digits"),
    [
        # Agresti (1990), approval of the president; R's exact2x2 gives 3.716e-05.
        ((794, 86, 150, 570), 3.716e-05, 5e-9),
        # Approval of a cabinet (S. Aoki's course); R's binom.test gives 0.45.
        ((48, 28, 35, 53), 0.45, 5e-3),
        # By hand: 2 (1 + 14 + 91 + 364) / 2^14.
        ((1, 11, 3, 5), 2 * 470 / 2**14, 1e-12),
        # Everything on one side: 2 / 2^6, the fewest that can be significant at 5 %.
        ((3, 6, 0, 91), 2 / 64, 1e-12),
        ((0, 4, 4, 10), 1.0, 1e-12),
        ((4, 0, 0, 46), 1.0, 1e-12),
    ],
)
def test_mcnemar(counts: tuple[int, int, int, int], p: float, digits: float) -> None:
    a, b = columns(*counts)
    ran = np.ones(len(a), dtype=bool)
    found = of.share_difference(a, b, ran, ran)
    assert (found.n, found.events) == (sum(counts), counts[1] + counts[2])
    assert found.p == pytest.approx(p, abs=digits)
    assert found.value == pytest.approx(a.mean() - b.mean())
    assert of.share_difference(b, a, ran, ran).p == found.p


def test_holm_by_hand_and_step_by_step() -> None:
    # 0.01 · 4; 0.02 · 3; 0.03 · 2 = 0.06, not below the one before; 0.04 · 1, raised to 0.06.
    assert holm([0.04, 0.01, 0.03, 0.02]) == pytest.approx([0.06, 0.04, 0.06, 0.06])
    # 0.005 · 3, 0.3 · 2, 0.9 · 1; at most 1.
    assert holm([0.3, 0.9, 0.005]) == pytest.approx([0.6, 0.9, 0.015])
    assert (holm([0.7, 0.6]), holm([0.2]), holm([])) == ([1.0, 1.0], [0.2], [])


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12))
def test_holm_rejects_what_the_procedure_does(p: list[float]) -> None:
    """As Holm states it: go up from the smallest p while p_(j) ≤ 0.05 / (m − j + 1)."""
    adjusted, rejected = holm(p), set()
    for j, index in enumerate(np.argsort(p, kind="stable")):
        if p[index] * (len(p) - j) > 0.05:
            break
        rejected.add(int(index))
    assert {i for i, value in enumerate(adjusted) if value <= 0.05} == rejected
    assert all(own <= value <= 1.0 for own, value in zip(p, adjusted, strict=True))


@pytest.mark.parametrize("unit", [1.0, 0.1, 1 / 3])
@pytest.mark.parametrize(
    ("differences", "p"),
    [
        # By hand: all of one sign, 2/2^k; a sign test says the same.
        ([0.3, 0.1, 0.2], 2 / 8),
        ([-1.0] * 6, 2 / 2**6),
        # 1, 2 and 4 have sums ±7, ±5, ±3, ±1: 5 is reached by two of eight on either side.
        ([4.0, 2.0, -1.0], 4 / 8),
        # Ties: ±1 ±1 ±2 are at least 2 in absolute value unless they are 0: 1 − 2/8.
        ([1.0, -1.0, 2.0], 6 / 8),
        ([], 1.0),
    ],
)
def test_sign_flips_by_hand(differences: list[float], p: float, unit: float) -> None:
    values = np.array([*differences, *[0.0] * 50]) * unit  # equal pairs say nothing
    assert of.sign_flip_p(values) == pytest.approx(p, rel=1e-12)
    assert of.sign_flip_p(-values) == of.sign_flip_p(values)


@pytest.mark.parametrize("few", [4, 12])
def test_sign_flips_against_scipy(few: int) -> None:
    # A few large differences above many small ones, where a normal sum would be far off.
    generator = rng(few)
    large = generator.gamma(4.0, 1.0, few) * np.where(np.arange(few) < few - 2, 1, -1)
    values = np.concatenate([large, generator.normal(0.0, 0.2, 60)])
    theirs = stats.permutation_test(
        (values,), np.sum, permutation_type="samples", n_resamples=40_000, rng=1
    ).pvalue
    assert of.sign_flip_p(values) == pytest.approx(theirs, abs=4 * np.sqrt(theirs / 40_000))


def test_differences_of_undefined_equal_and_no_pairs() -> None:
    nan = np.nan
    a, b = np.array([0.5, nan, 0.9, 0.7, 1.0]), np.array([0.4, 0.8, nan, 0.4, 0.8])
    found = of.difference(a, b, at())
    assert (found.value, found.n) == (pytest.approx((0.1 + 0.3 + 0.2) / 3), 3)
    a = np.repeat([0.5, 0.75, 1.0, nan], 3)
    same, shifted = of.difference(a, a, at()), of.difference(a + 0.25, a, at())
    # An interval is missing where all differences are equal; the test still tells them from 0.
    assert same == Finding(0.0, n=0, reason=of.EQUAL, p=1.0)
    assert shifted == Finding(0.25, n=9, reason=of.EQUAL, p=2 / 2**9)
    assert of.difference(a[8:], a[8:] - 0.5, at()) == Finding(0.5, n=1, reason=of.FEW, p=1.0)
    assert of.difference(a[9:], a[9:], at()) == Finding(None, n=0)  # no pair, no test
    # Σ(a − b) / Σ reference, over the pairs in which all three are known.
    times = of.difference(
        np.array([9.0, 8.0, nan, 8.0]),
        np.array([8.0, 8.0, 7.0, 9.0]),
        at(),
        np.array([10.0, 5.0, 8.0, nan]),
    )
    assert times.value == pytest.approx(1 / 15)


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.integers(8, 60), st.floats(0.0, 1.0), st.floats(0.0, 2.0))
def test_an_interval_leaves_out_0_where_p_is_below_5_percent(
    seed: int, n: int, shift: float, skewness: float
) -> None:
    values = rng(seed).lognormal(0.0, skewness + 0.1, n) - shift * np.exp(skewness**2 / 2)
    found = of.difference(values, np.zeros(n), at())
    assert (found.p < 0.05) == (not found.low <= 0.0 <= found.high)


@pytest.mark.parametrize("times", [1.1, 1.15, 1.2])
def test_p_is_that_of_the_interval_that_ends_at_0(times: float) -> None:
    values = SAMPLES["heavy"] - times * np.mean(SAMPLES["heavy"])
    found = of.difference(values, 0 * values, at())
    assert of.sign_flip_p(values) < found.p
    assert of.mean(values, at(1 - found.p)).high == pytest.approx(0.0, abs=2e-3)


def test_an_interval_leaves_out_0_only_where_the_test_rejects() -> None:
    # Three of 2,000 pairs differ, all in one direction: p = 0.25, and 0 is no limit's outside.
    a, b = np.zeros(2_000), np.zeros(2_000)
    a[:3] = [0.2, 0.3, 0.4]
    three = of.difference(a, b, at())
    assert (three.low, three.p, three.n) == (0.0, 0.25, 3)
    assert three.high > three.value > 0
    a[:6] = [0.2, 0.3, 0.4, 0.2, 0.3, 0.4]
    six = of.difference(a, b, at())
    assert (six.p, six.low > 0) == (2 / 2**6, True)
    times = of.difference(a[:100] + 7.4, b[:100] + 7.4, at(), np.full(100, 8.0))
    assert (times.value, times.p, times.n) == (pytest.approx(1.8 / 800), 2 / 2**6, 6)
