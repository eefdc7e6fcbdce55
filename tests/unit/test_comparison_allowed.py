"""The allowed interval of aggressiveness: all three verdicts on data made by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from harness.old.statistics import (
    Limits,
    SweepVerdict,
    SweptValue,
    Verdict,
    allowed_interval,
    swept_value,
)

LEVEL = 0.05


def swept(tau: np.ndarray, crashes: int, values: int, runs: int | None = None) -> SweptValue:
    """A value at which ``crashes`` of the pairs crashed; τ is as given in all the same."""
    count = len(tau)
    ran = np.arange(count) < (count if runs is None else runs)
    crashed = np.arange(count) < crashes
    met = int(np.isfinite(tau).sum())
    rng = np.random.default_rng(0)
    return swept_value(tau, crashed, ran, met, rng, values, LEVEL, repeated=False)


def spread(mean: float, count: int) -> np.ndarray:
    """Normal scores of this mean and population standard deviation 0.1."""
    scores = stats.norm.ppf((np.arange(count) + 0.5) / count)
    return mean + 0.1 * (scores - scores.mean()) / scores.std()


def test_bounds_are_one_sided_and_shared_by_the_sweep() -> None:
    # Five values have ten upper bounds: each at 1 − 0.05/10.
    value = swept(spread(0.7, 400), 0, 5)
    assert value.kappa.high == pytest.approx(1 - 0.005 ** (1 / 400), rel=1e-9)
    # Symmetric values: the bound on the mean is the normal one up to resampling noise.
    reach = stats.norm.ppf(0.995) * 0.1 / math.sqrt(400)
    assert value.mu.high - 0.7 == pytest.approx(reach, rel=0.07)
    assert 0.7 - value.mu.low == pytest.approx(reach, rel=0.07)
    tau = np.where(np.arange(400) < 100, np.nan, spread(0.7, 400))
    value = swept(tau, 100, 5)
    assert (value.pairs, value.mu.informative, value.kappa.trials) == (400, 300, 400)


def test_some_values_are_allowed() -> None:
    # Upper bound of 0 of 2,000 at 1 − 0.05/6: 0.0024.
    sweep = [
        swept(np.full(1_000, 0.8), 40, 3),  # too many crashes: lower bound 0.025
        swept(spread(0.85, 2_000), 0, 3),  # fine
        swept(spread(0.95, 2_000), 0, 3),  # too slow
    ]
    found = allowed_interval(sweep, Limits(0.9, 0.01), LEVEL)
    assert found.verdict is SweepVerdict.SOME
    verdicts = [judgement.verdict for judgement in found.judgements]
    assert verdicts == [Verdict.DENIED, Verdict.ALLOWED, Verdict.DENIED]
    assert found.pairs_needed is None
    assert {judgement.pairs_needed for judgement in found.judgements} == {None}


@pytest.mark.parametrize(
    ("sweep", "limits"),
    [
        # Each is denied by one of the two alone.
        ([swept(np.full(1_000, 0.8), 40, 2), swept(spread(0.95, 2_000), 0, 2)], Limits(0.9, 0.01)),
        # On the limit: below is asked for; without spread nothing is undecided.
        ([swept(np.full(400, 0.75), 0, 1)], Limits(0.75, 0.5)),
        # μ is undefined, the crashes deny.
        ([swept(np.full(50, np.nan), 50, 1)], Limits(0.9, 0.2)),
    ],
)
def test_none_is_allowed(sweep: list[SweptValue], limits: Limits) -> None:
    found = allowed_interval(sweep, limits, LEVEL)
    assert found.verdict is SweepVerdict.NONE
    assert {judgement.verdict for judgement in found.judgements} == {Verdict.DENIED}
    assert found.pairs_needed is None


def test_too_few_pairs_for_the_crash_rate() -> None:
    sweep = [swept(np.full(100, 0.8), 0, 2), swept(np.full(100, 1.0), 0, 2)]
    found = allowed_interval(sweep, Limits(0.9, 0.01), LEVEL)
    assert found.verdict is SweepVerdict.TOO_FEW_PAIRS
    assert [item.verdict for item in found.judgements] == [Verdict.UNDECIDED, Verdict.DENIED]
    # No crash in n: 1 − 0.0125^(1/n) < 0.01, so n > ln 0.0125 / ln 0.99 = 436.01.
    assert found.pairs_needed == math.ceil(math.log(0.0125) / math.log(0.99)) == 437
    assert found.judgements[0].pairs_needed == 437
    # With so many the verdict falls, with one less it does not.
    for pairs, verdict in ((437, SweepVerdict.SOME), (436, SweepVerdict.TOO_FEW_PAIRS)):
        more = [swept(np.full(pairs, 0.8), 0, 2), swept(np.full(pairs, 1.0), 0, 2)]
        assert allowed_interval(more, Limits(0.9, 0.01), LEVEL).verdict is verdict
    # Of 100 pairs 50 ran: 437 runs take 874 pairs.
    found = allowed_interval(
        [swept(np.full(100, 0.8), 0, 2, runs=50)] * 2, Limits(0.9, 0.01), LEVEL
    )
    assert found.pairs_needed == 874


def test_too_few_pairs_for_the_mean_and_the_larger_number_of_the_two() -> None:
    value = swept(spread(0.85, 2_000), 0, 1)
    found = allowed_interval([value], Limits(0.853, 0.5), LEVEL)
    assert found.verdict is SweepVerdict.TOO_FEW_PAIRS
    # Distance of the bound 1.96 · 0.1 / √N = 0.003 at N = 4,268.
    assert found.pairs_needed == pytest.approx((1.96 * 0.1 / 0.003) ** 2, rel=0.1)
    pairs = math.ceil(1.1 * found.pairs_needed)
    enough = allowed_interval([swept(spread(0.85, pairs), 0, 1)], Limits(0.853, 0.5), LEVEL)
    assert enough.verdict is SweepVerdict.SOME
    alone = allowed_interval([value], Limits(0.853, 0.5), LEVEL).pairs_needed
    both = allowed_interval([value], Limits(0.853, 0.001), LEVEL).pairs_needed
    # ln 0.025 / ln 0.999 = 3,687; the mean needs about 4,268.
    assert (alone, both) == (alone, max(alone, 3_688))
    strict = allowed_interval([value], Limits(0.853, 1e-4), LEVEL).pairs_needed
    assert strict == math.ceil(math.log(0.025) / math.log(0.9999))


@pytest.mark.parametrize(
    ("mean", "crashes", "verdict", "pairs"),
    [
        # The bound lies far from μ0 = 0.9 on either side, but 200 of 800 pairs are informative:
        # 2,000 of them need 8,000 pairs.
        (0.7, 0, Verdict.UNDECIDED, 8_000),
        (1.3, 0, Verdict.UNDECIDED, 8_000),
        # 80 of 800 crash against κ0 = 0.05: the exact bound of κ denies.
        (0.7, 80, Verdict.DENIED, None),
        # 34 of 800 are below κ0 = 0.05.  The bound of κ would show it at
        # N ≈ 1.96² · 0.0425 · 0.9575 / 0.0075² = 2,779, which is less than 8,000.
        (0.7, 34, Verdict.UNDECIDED, 8_000),
    ],
)
def test_an_unreliable_bound_of_mu_allows_nothing_and_denies_nothing(
    mean: float, crashes: int, verdict: Verdict, pairs: int | None
) -> None:
    tau = np.append(np.full(600, mean), spread(mean, 200))
    found = allowed_interval([swept(tau, crashes, 1)], Limits(0.9, 0.05), LEVEL)
    (judgement,) = found.judgements
    assert judgement.swept.unreliable
    assert (judgement.verdict, judgement.pairs_needed) == (verdict, pairs)
    assert judgement.unreliable == (verdict is Verdict.UNDECIDED)
    # With 2,000 informative pairs the bound decides.
    tau = np.append(np.full(6_000, mean), spread(mean, 2_000))
    (more,) = allowed_interval([swept(tau, 0, 1)], Limits(0.9, 0.05), LEVEL).judgements
    assert more.verdict is (Verdict.ALLOWED if mean < 0.9 else Verdict.DENIED)


def test_the_bound_on_the_side_of_the_limit_has_to_reach_it() -> None:
    # Bounds 0.01 below and 0.03 above μ = 0.85 from 2,000 pairs; the distances fall with 1/√N.
    value = swept(spread(0.85, 2_000), 0, 1)
    value = replace(value, mu=replace(value.mu, value=0.85, low=0.84, high=0.88))
    for mu0, pairs in ((0.86, 2_000 * 3**2), (0.845, 2_000 * 2**2)):
        found = allowed_interval([value], Limits(mu0, 0.5), LEVEL)
        assert found.pairs_needed == pytest.approx(pairs, abs=1.1)


def test_what_would_deny_all() -> None:
    # 3 crashes of 100 against κ0 = 0.01: the estimate points beyond, the lower bound does not yet.
    found = allowed_interval([swept(np.full(100, 0.8), 3, 1)], Limits(0.9, 0.01), LEVEL)
    assert found.verdict is SweepVerdict.TOO_FEW_PAIRS
    needed = found.pairs_needed

    def low(crashes: int, runs: int) -> float:
        test = stats.binomtest(crashes, runs, alternative="greater")
        return float(test.proportion_ci(1 - 0.025, method="exact").low)

    # At the same share of 3 %; whole crashes lie within 1/0.03 = 33 episodes of each other.
    after = math.ceil(0.03 * needed)
    before = after - 2
    assert low(after, round(after / 0.03)) >= 0.01
    assert low(before, round(before / 0.03)) < 0.01


def test_the_quicker_way_to_deny_and_the_first_that_could_be_allowed_count() -> None:
    quick = swept(spread(0.95, 2_500), 0, 2)  # μ beyond by 1.5 standard errors
    slow = swept(np.full(2_500, 0.8), 30, 2)  # κ beyond, 30 of 2,500 against 0.01
    limits = Limits(0.947, 0.01)
    each = [allowed_interval([value, value], limits, LEVEL).pairs_needed for value in (quick, slow)]
    assert None not in each
    assert each[0] < each[1]
    assert allowed_interval([quick, slow], limits, LEVEL).pairs_needed == each[1]
    near, far = swept(spread(0.899, 2_500), 0, 2), swept(spread(0.897, 2_500), 0, 2)
    found = allowed_interval([near, far], Limits(0.9, 0.2), LEVEL)
    assert found.verdict is SweepVerdict.TOO_FEW_PAIRS
    # Distances to the limit of 0.001 and 0.003: nine times the pairs.
    needed = [judgement.pairs_needed for judgement in found.judgements]
    assert needed[0] == pytest.approx(9 * needed[1], rel=0.1)
    assert found.pairs_needed == needed[1]


@pytest.mark.parametrize(
    ("tau", "crashes", "limits"),
    [
        (np.full(50, np.nan), 0, Limits(0.9, 0.2)),  # τ undefined in every pair
        (np.append(np.full(49, np.nan), 0.8), 0, Limits(0.9, 0.2)),  # no interval from one
        (np.append(np.full(31, np.nan), np.full(19, 0.8)), 0, Limits(0.9, 0.2)),  # 19 equal ones
        (np.full(50, 0.8), 1, Limits(0.9, 0.02)),  # the estimate lies on the limit
    ],
)
def test_where_no_number_can_be_named(tau: np.ndarray, crashes: int, limits: Limits) -> None:
    found = allowed_interval([swept(tau, crashes, 1)], limits, LEVEL)
    assert found.verdict is SweepVerdict.TOO_FEW_PAIRS
    assert found.pairs_needed is None


@pytest.mark.parametrize("values", [1, 3, 10])
def test_wrongly_allowed_by_crashes_at_most_the_level(values: int) -> None:
    # κ = κ0 at every value: P(some upper bound below κ0), over all outcomes, independent values.
    kappa0, runs = 0.03, 400
    counts = np.arange(runs + 1)
    allowed = [
        crashes
        for crashes in counts[:30]
        if swept(np.full(runs, 0.8), int(crashes), values).kappa.high < kappa0
    ]
    single = float(stats.binom.pmf(allowed, runs, kappa0).sum())
    assert 1 - (1 - single) ** values <= LEVEL / 2
    # At 95 % each, without Bonferroni, ten values would not keep it.
    naive = [c for c in counts[:30] if stats.beta.ppf(0.95, c + 1, runs - c) < kappa0]
    assert 1 - (1 - stats.binom.pmf(naive, runs, kappa0).sum()) ** 10 > 2 * LEVEL
