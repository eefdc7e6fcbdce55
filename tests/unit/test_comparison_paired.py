"""Two cells over the same pairs, against published examples, scipy, and hand computation."""

import numpy as np
import pytest
from scipy import stats

from harness.old.statistics import holm, mcnemar, paired_difference, ratio_difference, sign_flip_p


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def table(both: int, only_a: int, only_b: int, neither: int) -> tuple[np.ndarray, np.ndarray]:
    """Columns of two cells with these counts, shuffled."""
    a = np.repeat([True, True, False, False], [both, only_a, only_b, neither])
    b = np.repeat([True, False, True, False], [both, only_a, only_b, neither])
    order = rng().permutation(len(a))
    return a[order], b[order]


@pytest.mark.parametrize(
    ("counts", "p", "digits"),
    [
        # Agresti (1990), approval of the president; R's exact2x2 gives 3.716e-05.
        ((794, 86, 150, 570), 3.716e-05, 5e-9),
        # Approval of a cabinet (S. Aoki's course); R's binom.test gives 0.45.
        ((48, 28, 35, 53), 0.45, 5e-3),
        # By hand: 2 (1 + 14 + 91 + 364) / 2^14.
        ((1, 11, 3, 5), 2 * 470 / 2**14, 1e-12),
        # By hand: 2 (1 + 6) / 2^6.
        ((0, 1, 5, 94), 14 / 64, 1e-12),
        # Everything on one side: 2 / 2^6, the fewest that can be significant at 5 %.
        ((3, 6, 0, 91), 2 / 64, 1e-12),
        ((0, 4, 4, 10), 1.0, 1e-12),
    ],
)
def test_mcnemar(counts: tuple[int, int, int, int], p: float, digits: float) -> None:
    a, b = table(*counts)
    ran = np.ones(len(a), dtype=bool)
    test = mcnemar(a, b, ran, ran)
    assert (test.pairs, test.only_a, test.only_b) == (sum(counts), counts[1], counts[2])
    assert test.p == pytest.approx(p, abs=digits)
    assert test.kappa_difference == pytest.approx(a.mean() - b.mean())
    assert mcnemar(b, a, ran, ran).p == test.p


def test_mcnemar_without_discordant_pairs_and_with_failed_ones() -> None:
    a, _ = table(4, 0, 0, 46)
    ran = np.ones(50, dtype=bool)
    test = mcnemar(a, a, ran, ran)
    assert (test.only_a, test.only_b, test.p, test.kappa_difference) == (0, 0, 1.0, 0.0)
    a = np.array([True, True, False, True, False])
    b = np.array([False, False, True, True, False])
    ran_a = np.array([True, False, True, True, True])
    ran_b = np.array([True, True, False, True, True])
    test = mcnemar(a, b, ran_a, ran_b)
    assert (test.pairs, test.only_a, test.only_b) == (3, 1, 0)
    nothing = mcnemar(a, b, ~ran_a, ran_a)
    assert (nothing.pairs, nothing.p, nothing.kappa_difference) == (0, 1.0, None)


def test_holm_by_hand_and_step_by_step() -> None:
    # 0.01 · 4; 0.02 · 3; 0.03 · 2 = 0.06, not below the one before; 0.04 · 1, raised to 0.06.
    assert holm([0.04, 0.01, 0.03, 0.02]) == pytest.approx([0.06, 0.04, 0.06, 0.06])
    # 0.005 · 3, 0.3 · 2, 0.9 · 1; at most 1.
    assert holm([0.3, 0.9, 0.005]) == pytest.approx([0.6, 0.9, 0.015])
    assert holm([0.7, 0.6]) == [1.0, 1.0]
    assert holm([1.0, 1.0, 1.0]) == [1.0, 1.0, 1.0]
    assert holm([0.2]) == [0.2]
    assert holm([]) == []
    # The procedure as Holm states it: go up from the smallest p while p_(j) < 0.05 / (m − j + 1).
    generator = rng()
    for _ in range(200):
        p = generator.beta(0.3, 3.0, size=6)
        rejected = set()
        for j, index in enumerate(np.argsort(p)):
            if p[index] >= 0.05 / (len(p) - j):
                break
            rejected.add(int(index))
        assert {i for i, adjusted in enumerate(holm(p)) if adjusted < 0.05} == rejected


def test_paired_difference_against_scipy() -> None:
    generator = np.random.default_rng(7)
    shared = generator.lognormal(-0.3, 0.4, 80)
    a, b = shared + generator.gamma(2.0, 0.02, 80), shared * 1.02
    ours = paired_difference(a, b, rng())
    assert ours.value == pytest.approx(np.mean(a) - np.mean(b), rel=1e-9)
    theirs = [
        stats.bootstrap(
            (a, b),
            lambda x, y, axis: np.mean(x, axis=axis) - np.mean(y, axis=axis),
            paired=True,
            method="BCa",
            n_resamples=9_999,
            rng=seed,
            vectorized=True,
        ).confidence_interval
        for seed in (1, 2, 3)
    ]
    low, high = np.mean([t.low for t in theirs]), np.mean([t.high for t in theirs])
    assert ours.low == pytest.approx(low, abs=0.08 * (high - low))
    assert ours.high == pytest.approx(high, abs=0.08 * (high - low))
    # Unpaired, the same columns tell next to nothing: the spread they share does not cancel.
    assert high - low < 0.1 * 4 * np.std(shared) / np.sqrt(80)


def test_differences_of_undefined_equal_and_no_pairs() -> None:
    a = np.array([0.5, np.nan, 0.9, 0.7, 1.0])
    b = np.array([0.4, 0.8, np.nan, 0.4, 0.8])
    difference = paired_difference(a, b, rng())
    assert difference.value == pytest.approx((0.1 + 0.3 + 0.2) / 3)
    assert difference.informative == 3
    assert 0.0 <= difference.low <= difference.high <= 0.3 + 1e-12
    a = np.repeat([0.5, 0.75, 1.0, np.nan], 3)
    same = paired_difference(a, a, rng())
    assert (same.value, same.low, same.high, same.informative, same.p) == (0.0, 0.0, 0.0, 0, 1.0)
    shifted = paired_difference(a + 0.25, a, rng())
    assert (shifted.value, shifted.low, shifted.high) == (0.25, 0.25, 0.25)
    assert (shifted.informative, shifted.p) == (9, 2 / 2**9)
    one = paired_difference(a[8:], a[8:] - 0.5, rng())
    assert (one.value, one.low, one.high) == (0.5, None, None)
    none = paired_difference(a[9:], a[9:], rng())
    assert (none.value, none.low, none.high, none.p) == (None, None, None, 1.0)


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
    # Pairs that do not differ say nothing.
    values = np.array([*differences, *[0.0] * 50]) * unit
    assert sign_flip_p(values) == pytest.approx(p, rel=1e-12)
    assert sign_flip_p(-values) == sign_flip_p(values)


@pytest.mark.parametrize("few", [4, 12])
def test_sign_flips_against_scipy(few: int) -> None:
    # A few large differences above many small ones, where a normal sum would be far off.
    generator = np.random.default_rng(few)
    large = generator.gamma(4.0, 1.0, few) * np.where(np.arange(few) < few - 2, 1, -1)
    values = np.concatenate([large, generator.normal(0.0, 0.2, 60)])
    theirs = stats.permutation_test(
        (values,), np.sum, permutation_type="samples", n_resamples=40_000, rng=1
    ).pvalue
    assert sign_flip_p(values) == pytest.approx(theirs, abs=4 * np.sqrt(theirs / 40_000))


def test_sign_flips_of_equal_sizes_are_the_sign_test() -> None:
    for k in (10, 30, 101):
        for ups in range(k // 2, k + 1, 3):
            values = np.where(np.arange(k) < ups, 1.0, -1.0)
            theirs = stats.binomtest(ups, k).pvalue
            assert sign_flip_p(values) == pytest.approx(theirs, abs=0.003)


def test_an_interval_leaves_out_0_only_where_the_test_rejects() -> None:
    # Three of 2,000 pairs differ, all in one direction: p = 0.25, and 0 is no limit's outside.
    a = np.zeros(2_000)
    a[:3] = [0.2, 0.3, 0.4]
    three = paired_difference(a, np.zeros(2_000), rng())
    assert (three.low, three.p, three.informative) == (0.0, 0.25, 3)
    assert three.high > three.value > 0
    a[:6] = [0.2, 0.3, 0.4, 0.2, 0.3, 0.4]
    six = paired_difference(a, np.zeros(2_000), rng())
    assert six.p == 2 / 2**6
    assert six.low > 0
    times = ratio_difference(a[:100] + 7.4, np.full(100, 7.4), np.full(100, 8.0), rng())
    assert times.value == pytest.approx(1.8 / 800)
    assert (times.p, times.informative) == (2 / 2**6, 6)
