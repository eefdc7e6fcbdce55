"""μ, c_v and κ with their intervals, against scipy, closed forms and hand counts."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from harness.old.statistics import (
    ENCOUNTERS,
    EncounterColumns,
    PairColumns,
    Resampled,
    bootstrap,
    bootstrap_mean,
    bootstrap_mean_and_cv,
    bootstrap_ratio,
    clustered_proportion,
    columns_of,
    findings_from,
    proportion,
    quantile,
    row_of,
    summarise,
    zero_bound,
)


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


def test_the_acceleration_is_of_the_values_without_each(monkeypatch: pytest.MonkeyPatch) -> None:
    values, left_out = SAMPLES["a dozen"], []
    monkeypatch.setattr(bootstrap, "_bca", lambda *given: left_out.append(given[2]))
    bootstrap_mean_and_cv(values, rng())
    without = [np.delete(values, index) for index in range(len(values))]
    np.testing.assert_allclose(left_out[0], [rest.mean() for rest in without])
    np.testing.assert_allclose(left_out[1], [rest.std() / rest.mean() for rest in without])


@pytest.mark.parametrize("unit", [0.1, 0.7, 1 / 3])
def test_bca_in_another_unit(unit: float) -> None:
    # Sums of whole numbers are exact; of a few of them many resamples equal the estimate.  In
    # another unit the same resamples differ from it in their last bits, and the limits scale.
    whole = np.array([7.0, 7, 8, 8, 8, 9, 9, 10, 10, 10, 11, 11, 12, 12, 13])
    exact, scaled = bootstrap_mean(whole, rng()), bootstrap_mean(unit * whole, rng())
    assert scaled.low == pytest.approx(unit * exact.low, rel=1e-9)
    assert scaled.high == pytest.approx(unit * exact.high, rel=1e-9)


def test_bca_is_not_the_percentile_interval_and_far_limits_have_resamples_beyond() -> None:
    # On a skewed sample the correction is many times the noise: the test above can tell.
    values = SAMPLES["heavy"]
    _, cv = bootstrap_mean_and_cv(values, rng())
    percentile = stats.bootstrap((values,), population_cv, method="percentile", rng=1)
    shift = abs(cv.high - percentile.confidence_interval.high)
    assert shift > 0.15 * (cv.high - cv.low)
    # 99.99 %: from 5,000 resamples the limits would be the outermost of them, well inside.
    values = SAMPLES["a dozen"]
    ours = bootstrap_mean_and_cv(values, rng(), 1 - 1e-4)[0]
    theirs = stats.bootstrap(
        (values,), np.mean, confidence_level=1 - 1e-4, n_resamples=400_000, batch=20_000, rng=1
    ).confidence_interval
    width = theirs.high - theirs.low
    assert ours.low == pytest.approx(theirs.low, abs=0.02 * width)
    assert ours.high == pytest.approx(theirs.high, abs=0.02 * width)


def test_intervals_of_equal_of_few_and_of_two_values() -> None:
    mu, cv = bootstrap_mean_and_cv(np.full(20, 0.7), rng())
    assert (mu.low, mu.high, mu.value) == (mu.value, mu.value, pytest.approx(0.7, rel=1e-15))
    assert (cv.value, cv.low, cv.high) == (0.0, 0.0, 0.0)
    for interval in bootstrap_mean_and_cv(np.array([]), rng()):
        assert (interval.value, interval.low, interval.high) == (None, None, None)
    mu, _ = bootstrap_mean_and_cv(np.array([0.8]), rng())
    assert (mu.value, mu.low, mu.high) == (0.8, None, None)
    mu, cv = bootstrap_mean_and_cv(np.array([0.5, 1.0]), rng())
    assert mu.value == 0.75
    assert 0.5 <= mu.low <= mu.high <= 1.0
    assert cv.value == pytest.approx(1 / 3)
    assert 0.0 <= cv.low <= cv.high <= 1 / 3 + 1e-12
    _, cv = bootstrap_mean_and_cv(np.array([0.5, 0.5]), rng())
    assert (cv.value, cv.low, cv.high) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("successes", "trials"), [(0, 50), (1, 50), (7, 50), (50, 50), (3, 3)])
def test_clopper_pearson_by_beta_quantiles(successes: int, trials: int) -> None:
    interval = proportion(successes, trials)
    # Clopper–Pearson (1934): B(0.025; k, n − k + 1) and B(0.975; k + 1, n − k).
    low = 0.0 if successes == 0 else stats.beta.ppf(0.025, successes, trials - successes + 1)
    high = 1.0 if successes == trials else stats.beta.ppf(0.975, successes + 1, trials - successes)
    assert interval.value == successes / trials
    assert interval.low == pytest.approx(low, abs=1e-10)
    assert interval.high == pytest.approx(high, abs=1e-10)


def test_no_crash_in_fifty_and_no_trial_at_all() -> None:
    # (1 − p)^50 = 0.05 one-sided, 0.025 two-sided.
    # Of 0 in 50 the two-sided interval ends at 1 − (half the error)^(1/50).
    for confidence in (0.95, 0.975):
        high = 1 - ((1 - confidence) / 2) ** (1 / 50)
        bound = zero_bound(high, confidence)
        assert bound == pytest.approx(1 - 0.05 ** (1 / 50), abs=1e-12)
        assert round(100 * bound, 1) == 5.8
    assert proportion(0, 50).high == pytest.approx(1 - 0.025 ** (1 / 50), abs=1e-10)
    assert round(100 * proportion(0, 50).high, 1) == 7.1
    assert proportion(0, 50).low == 0.0
    interval = proportion(0, 0)
    assert (interval.value, interval.low, interval.high) == (None, None, None)


# Nine pairs, counted by hand.  c: crossed, x: crashed (f with the front), t: timed out, s: the
# strategy failed.  The last number: when the human would have passed had nobody been touched.
#           AV       human
PAIRS = [
    ("c", 6.0, "c", 10.0, 10.0),  # τ = 0.6
    ("c", 9.0, "c", 10.0, 10.0),  # τ = 0.9, fallback
    ("c", 12.0, "c", 8.0, 8.0),  # τ = 1.5
    ("x", None, "c", 9.0, 9.0),
    ("f", None, "c", 9.0, 9.0),
    ("t", None, "c", 30.0, 30.0),
    ("c", 15.0, "t", None, None),
    ("s", None, "x", None, None),
    ("c", 20.0, "x", None, 8.0),  # as if untouched: τ = 2.5
]
MET = ([1, 1, 0, 1, 1, 2, 0, 0, 1], [1, 0, 0, 0, 0, 1, 0, 1, 1])
ARRIVALS = [1, 2, 0, 1, 1, 2, 0, 5, 1]
WAITED_S = [2, 0, 0, 1, 3, 10, 0, 99, 4]


def columns() -> PairColumns:
    """The pairs above."""
    av, human = [row[0] for row in PAIRS], [row[2] for row in PAIRS]
    numbers = [np.array([row[i] for row in PAIRS], dtype=float) for i in (1, 3, 4)]
    passed, none = (numbers[0], numbers[1]), np.zeros(len(PAIRS))

    def endings(*letters: str) -> tuple[np.ndarray, np.ndarray]:
        return np.array([e in letters for e in av]), np.array([e in letters for e in human])

    return PairColumns(
        time_s=passed,
        untouched_time_s=(numbers[0], numbers[2]),
        delay_s=(passed[0] - 7.4, passed[1] - 7.4),
        stops=(none, none),
        stopped_s=(none, none),
        crashed=endings("x", "f"),
        front=endings("f"),
        avoidable=endings("f"),
        avoidable_attentive=endings("f"),
        timed_out=endings("t"),
        failed=endings("s"),
        failed_strategy=endings("s"),
        met=(np.array(MET[0]), np.array(MET[1])),
        arrivals=(np.array(ARRIVALS, dtype=float), none),
        waited_s=(np.array(WAITED_S, dtype=float), none),
        conditionings=(none + 4, none),
        clamped=(none + 1, none),
        speed_excess_mps=(none + 2.5, none * np.nan),
        range_excess_m=(none + 20.0, none * np.nan),
        max_speed_mps=(none + 5.0, none + 5.0),
        steps=(none + 100, none + 100),
        rms_acceleration_mps2=(none + 1.0, none),
        rms_jerk_mps3=(none + 2.0, none),
        max_deceleration_mps2=(none + 3.0, none),
        max_jerk_mps3=(none + 4.0, none),
        av_fallback=np.arange(len(PAIRS)) == 1,
    )


def summary_of(pairs: PairColumns):
    return summarise(EncounterColumns(pairs, 60.0, 7.4, rng()))


def test_mean_times_are_over_the_pairs_of_their_ratio() -> None:
    """Pairs 0, 1, 2, 5, 6 and 8 count: nobody failed, the AV did not crash; a time-out is 60 s."""
    findings = summary_of(columns()).findings
    assert findings["time_s"].value == pytest.approx((6 + 9 + 12 + 60 + 15 + 20) / 6)
    # The human timed out in pair 6 and crashed in pair 8, where 8 s is the time of driving on.
    assert findings["time_human_s"].value == pytest.approx((10 + 10 + 8 + 30 + 60 + 8) / 6)
    # The delay is over the episodes of each arm that crossed; the human has six of them.
    assert findings["delay_human_s"].value == pytest.approx((10 + 10 + 8 + 9 + 9 + 30) / 6 - 7.4)


def test_comfort_counts_steps_and_whoever_met_someone() -> None:
    pairs = columns()
    count = int((pairs.met_someone & ~pairs.failed[0]).sum())
    met = np.flatnonzero(pairs.met_someone & ~pairs.failed[0])
    steps, rms, jerk = (np.full(len(pairs.tau), value) for value in (100.0, 1.0, 4.0))
    steps[met[0]], rms[met[0]], jerk[met[0]] = 300.0, 2.0, 9.0
    rms[~pairs.met_someone] = jerk[~pairs.met_someone] = 99.0
    made = replace(
        pairs,
        steps=(steps, steps),
        rms_acceleration_mps2=(rms, rms),
        max_jerk_mps3=(jerk, jerk),
    )
    summary = summary_of(made)
    # 300 steps of 2 m/s² and 100 of 1 m/s² from each of the others.
    assert summary.acceleration_rms_mps2.value == pytest.approx(
        math.sqrt((300 * 4 + 100 * (count - 1)) / (300 + 100 * (count - 1)))
    )
    assert summary.max_jerk_p95_mps3.value == 9.0
    assert summary.max_jerk_p95_mps3.high is None


def test_the_limits_of_a_quantile_keep_their_errors() -> None:
    """59 values are the fewest whose largest bounds the 95 % quantile with 95 %: 0.95⁵⁹ < 0.05."""
    assert quantile(np.arange(59.0), 0.95, 0.9).high == 58.0
    assert quantile(np.arange(58.0), 0.95, 0.9).high is None
    draws = np.random.default_rng(4).random((4_000, 150))
    limits = [quantile(row, 0.95, 0.9) for row in draws]
    assert np.mean([limit.high < 0.95 for limit in limits]) <= 0.05 + 3 * math.sqrt(
        0.05 * 0.95 / 4_000
    )
    assert np.mean([limit.low > 0.95 for limit in limits]) <= 0.05 + 3 * math.sqrt(
        0.05 * 0.95 / 4_000
    )


def test_summary_of_hand_counted_pairs() -> None:
    summary = summary_of(columns())
    assert (summary.pairs, summary.defined_pairs) == (9, 3)
    assert (summary.timed_out, summary.failed) == (2, 1)
    assert (summary.timed_out_av, summary.timed_out_human) == (1, 1)
    assert (summary.failed_strategy, summary.failed_engine) == (1, 0)
    assert (summary.failed_av, summary.failed_human) == (1, 0)
    assert (summary.fallbacks, summary.met_nobody, summary.met_someone) == (1, 2, 7)
    tau = np.array([0.6, 0.9, 1.5])
    assert summary.mu.value == pytest.approx(1.0)
    assert summary.cv.value == pytest.approx(math.sqrt(((tau - 1) ** 2).mean()))
    assert summary.mu_without_fallback == pytest.approx((0.6 + 1.5) / 2)
    # The AV's arm asks 4 times an episode, once outside the box; the human's never.
    assert (summary.clamped_share, summary.clamped_share_human) == (0.25, None)
    assert (summary.clamped_speed_excess_mps, summary.clamped_range_excess_m) == (2.5, 20.0)
    # κ: 2 crashes in the 8 AV episodes that ran; the human's 2 in all 9.
    assert summary.kappa.value == pytest.approx(2 / 8)
    assert summary.kappa_front.value == pytest.approx(1 / 8)
    # Those with the front were avoidable, by the hand that made the pairs.
    assert summary.kappa_avoidable.value == pytest.approx(1 / 8)
    assert summary.kappa_avoidable.high == pytest.approx(stats.beta.ppf(0.975, 2, 7), abs=1e-10)
    assert (summary.kappa_avoidable_human.successes, summary.kappa_avoidable_human.trials) == (0, 9)
    assert summary.kappa_avoidable_attentive.value == pytest.approx(1 / 8)
    assert summary.kappa_human.value == pytest.approx(2 / 9)
    assert summary.kappa.low == pytest.approx(stats.beta.ppf(0.025, 2, 7), abs=1e-10)


def test_what_is_left_out_by_hand() -> None:
    summary = summary_of(columns())
    # The pair in which the human alone crashed comes back: 20 s against 8 s.
    assert summary.pairs_all == 4
    assert summary.mu_all.value == pytest.approx((0.6 + 0.9 + 1.5 + 2.5) / 4)
    assert summary.delay_difference_human_s.value == pytest.approx((-4 - 1 + 4 + 12) / 4)
    # 2 crashes, a time-out and a failure of the AV in 9 pairs.
    assert summary.kappa_worst.value == pytest.approx(4 / 9)
    assert summary.kappa_worst.low == pytest.approx(stats.beta.ppf(0.025, 4, 6), abs=1e-10)
    assert summary.kappa_worst.high == pytest.approx(stats.beta.ppf(0.975, 5, 5), abs=1e-10)
    # The AV's count at 60 s; a human who never passed counts as free, 7.4 s.
    worst = [0.6, 0.9, 1.5, 60 / 9, 60 / 9, 60 / 30, 15 / 7.4, 60 / 7.4, 2.5]
    assert summary.mu_worst.value == pytest.approx(np.mean(worst))
    # SciPy's bootstrap draws its own resamples; two of 9,999 agree to some 3 % of the width.
    other = stats.bootstrap((worst,), np.mean, n_resamples=9_999, rng=1)
    low, high = other.confidence_interval
    assert summary.mu_worst.low == pytest.approx(low, abs=0.05 * (high - low))
    assert summary.mu_worst.high == pytest.approx(high, abs=0.05 * (high - low))


def test_ratio_of_times_by_hand() -> None:
    summary = summary_of(columns())
    # Time-outs of either arm count with 60 s, the human's crash with 8 s; the AV's two crashes and
    # its failure are left out.
    av_s, human_s = [6, 9, 12, 60, 15, 20], [10, 10, 8, 30, 60, 8]
    assert summary.time_ratio_pairs == 6
    assert summary.time_ratio.value == pytest.approx(sum(av_s) / sum(human_s))
    assert summary.time_ratio.low < 122 / 126 < summary.time_ratio.high
    assert (summary.time_s.value, summary.time_human_s.value) == pytest.approx((122 / 6, 126 / 6))
    # Over all: the AV's three with 60 s, a human who never passed free, 7.4 s.
    worst = (sum(av_s) + 3 * 60) / (10 + 10 + 8 + 9 + 9 + 30 + 7.4 + 7.4 + 8)
    assert summary.time_ratio_worst.value == pytest.approx(worst)
    pairs = columns()
    stuck = np.where(pairs.crashed[1], np.nan, pairs.untouched_time_s[1])
    pairs = replace(pairs, untouched_time_s=(pairs.untouched_time_s[0], stuck))
    summary = summary_of(pairs)
    assert summary.time_ratio_pairs == 6
    assert summary.time_ratio.value == pytest.approx(122 / (126 - 8 + 60))
    pairs = columns()
    none = np.full(len(PAIRS), np.nan)
    summary = summary_of(replace(pairs, untouched_time_s=(none, none)))
    assert summary.time_ratio_pairs == 5
    assert summary.time_ratio.value == pytest.approx((122 - 20) / (126 - 8))


def test_pairs_that_met_someone_by_hand() -> None:
    summary = summary_of(columns())
    assert summary.defined_pairs_met_someone == 2
    assert summary.mu_met_someone.value == pytest.approx((0.6 + 0.9) / 2)
    # Seven such pairs, in one of which the AV failed.
    assert (summary.kappa_met_someone.successes, summary.kappa_met_someone.trials) == (2, 6)
    assert summary.delay_met_someone_s.value == pytest.approx((6 + 9 + 20) / 3 - 7.4)
    # One fallback in the six AV episodes in which somebody stepped off.
    assert summary.fallback_share == pytest.approx(1 / 6)
    # 20 s of waits of 8 people: the failed episode's do not count.
    assert summary.pedestrian_delay_s.value == pytest.approx(20 / 8)
    assert summary.pedestrian_delay_human_s.value is None


def test_an_av_that_hurries_through_people_gains_nothing() -> None:
    # τ of the AV's crashes would be 0.5: neither μ nor mu_all may count them.
    pairs = columns()
    untouched = np.where(pairs.crashed[0], 4.5, pairs.untouched_time_s[0])
    hurried = replace(pairs, untouched_time_s=(untouched, pairs.untouched_time_s[1]))
    one, other = map(summary_of, (pairs, hurried))
    assert one == other


def test_ratio_of_sums_against_scipy_and_of_few_or_none() -> None:
    # A few crowds among many pairs with one: the bias and the acceleration are large.
    generator = np.random.default_rng(11)
    persons = np.floor(2 * generator.pareto(1.5, 40)) + 1
    waits = 10 * np.sqrt(persons) * generator.random(40)
    ours = bootstrap_ratio(waits, persons, rng())
    assert ours.value == pytest.approx(waits.sum() / persons.sum(), rel=1e-12)

    def ratio(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
        return a.sum(axis=axis) / b.sum(axis=axis)

    theirs = stats.bootstrap(
        (waits, persons), ratio, paired=True, method="BCa", n_resamples=19_999, rng=1, batch=500
    ).confidence_interval
    width = theirs.high - theirs.low
    assert ours.low == pytest.approx(theirs.low, abs=0.05 * width)
    assert ours.high == pytest.approx(theirs.high, abs=0.05 * width)
    # One pair with people: whatever leaves it out, or does not draw it, has no ratio.
    for waits, persons, expected in (([0, 0], [0, 0], None), ([6, 0, 0], [3, 0, 0], 2.0)):
        found = bootstrap_ratio(np.array(waits, float), np.array(persons, float), rng())
        assert (found.value, found.low, found.high) == (expected, None, None)
    # Everybody waits 2 s: the point.
    found = bootstrap_ratio(np.array([2.0, 4.0, 6.0]), np.array([1.0, 2.0, 3.0]), rng())
    assert (found.value, found.low, found.high) == (2.0, 2.0, 2.0)


def test_resampling_does_not_change_with_the_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = bootstrap_mean_and_cv(SAMPLES["heavy"], rng())
    # In batches of 7 resamples of 80 values, and not of 25,000.
    monkeypatch.setattr(bootstrap, "_DRAWS_IN_MEMORY", 7 * 80)
    assert bootstrap_mean_and_cv(SAMPLES["heavy"], rng()) == whole


def test_clusters_by_hand() -> None:
    ones = np.ones(1_000)
    found = clustered_proportion((np.arange(1_000) % 10 == 0).astype(float), ones)
    alone = stats.binomtest(100, 1_000).proportion_ci(method="exact")
    assert (found.value, found.successes, found.trials) == (0.1, 100, 1_000)
    assert (found.low, found.high) == pytest.approx((alone.low, alone.high), rel=1e-3)
    # Everybody in a cluster goes together: 40 clusters of 25 are 39 trials (k - 1 in the variance
    # between), less the ratio of Student's t for 999 and for 39 degrees of freedom, squared.
    trials = np.full(40, 25.0)
    found = clustered_proportion(np.repeat([25.0, 0.0], [10, 30]), trials)
    worth = 39 * (stats.t.ppf(0.975, 999) / stats.t.ppf(0.975, 39)) ** 2
    low = stats.beta.ppf(0.025, worth / 4, worth * 3 / 4 + 1)
    high = stats.beta.ppf(0.975, worth / 4 + 1, worth * 3 / 4)
    assert (found.value, found.low, found.high) == pytest.approx((0.25, low, high))
    five = clustered_proportion(np.zeros(5), np.full(5, 400.0))
    assert (five.value, five.low) == (0.0, 0.0)
    # No fewer than what 2,000 independent trials leave open, 0.18 %.
    assert five.high > 1 - 0.025 ** (1 / 2_000)
    one = clustered_proportion(np.array([3.0]), np.array([400.0]))
    assert (one.value, one.low, one.high) == (0.0075, None, None)
    none = clustered_proportion(np.zeros(2), np.zeros(2))
    assert (none.value, none.low, none.trials) == (None, None, 0)


@pytest.mark.parametrize("hours", [10, 40])
def test_crashes_that_come_together_are_covered(hours: int) -> None:
    # Beta-binomial hours of 700 passages, κ = 1 %, correlation 0.01 within an hour.
    generator, share = np.random.default_rng(8), 0.01
    trials, held = np.full(hours, 700.0), {"hours": 0, "passages": 0}
    for _ in range(400):
        rates = generator.beta(99 * share, 99 * (1 - share), hours)
        crashes = generator.binomial(700, rates).astype(float)
        independent = proportion(int(crashes.sum()), 700 * hours)
        for name, found in (
            ("hours", clustered_proportion(crashes, trials)),
            ("passages", independent),
        ):
            assert found.low is not None
            assert found.high is not None
            held[name] += found.low <= share <= found.high
    assert held["hours"] >= stats.binom.ppf(0.001, 400, 0.91)
    assert held["passages"] < 0.7 * 400


def test_same_pairs_have_the_same_interval() -> None:
    # Everybody met someone: what is over those pairs is over all, in both arms.
    generator = np.random.default_rng(3)
    times = generator.lognormal(2.1, 0.3, (2, 50))
    met = replace(
        columns().where(np.zeros(50, dtype=int)),
        time_s=tuple(times),
        delay_s=tuple(times - 7.4),
        met=(np.ones(50), np.ones(50)),
    )
    found = summary_of(met)
    assert found.met_someone == 50
    assert found.mu_met_someone == found.mu
    assert found.delay_met_someone_s == found.delay_s
    assert found.delay_human_met_someone_s == found.delay_human_s


RESAMPLED = {
    name: entry
    for entry in ENCOUNTERS
    if entry.interval is Resampled
    for name in filter(None, entry.names)
}


@pytest.mark.parametrize("name", RESAMPLED)
def test_few_pairs_are_said_to_be_few(name: str) -> None:
    entry = RESAMPLED[name]
    least = entry.least(name)
    assert least in (200, 1_000, 4_000)
    few = entry.finding(name, Resampled(1.0, 0.9, 1.1, least - 1), 50)
    words = f"unreliable below {least:,} informative pairs (has {least - 1:,})"
    assert (few.reliable, few.reason, few.n) == (False, words, least - 1)
    assert entry.finding(name, Resampled(1.0, 0.9, 1.1, least), 50).reliable
    # Where there is no interval, there is nothing to be called narrow.
    assert entry.finding(name, Resampled(1.0, None, None, 1), 50).reliable is None


def test_what_a_summary_says_of_its_reliability_and_keeps_when_written() -> None:
    nine = summary_of(columns()).findings
    unreliable = {name for name, finding in nine.items() if finding.reliable is False}
    assert unreliable == {name for name in RESAMPLED if nine[name].low is not None}
    findings = summary_of(columns()).findings
    row = row_of(ENCOUNTERS, findings)
    assert [*row] == [*columns_of(ENCOUNTERS)]
    assert (row["kappa"], row["kappa_events"], row["kappa_n"]) == (0.25, 2, 8)
    assert row["mu_ci_informative"] == 3
    assert findings["pedestrian_delay_human_s"].reason == "nobody arrived"
    assert findings_from(ENCOUNTERS, row) == findings
    failed = replace(columns().where(np.array([7])), failed=(np.array([True]), np.array([True])))
    findings = summary_of(failed).findings
    undefined = {name for name, finding in findings.items() if finding.value is None}
    assert {"mu", "cv", "time_ratio", "kappa_human", "stops"} <= undefined
    assert [name for name in undefined if not findings[name].reason] == []
    # What is undefined is neither reliable nor unreliable.
    assert {findings[name].reliable for name in undefined} == {None}


def test_pairs_that_met_nobody_tell_nothing() -> None:
    # Of 1,000 pairs at a low flow three met someone; in the last bits no two sums are the same.
    last_bits = 1e-15 * rng().integers(-3, 4, 1_000)
    tau = np.where(np.arange(1_000) < 3, [0.8, 1.4, 0.9] + [1.0] * 997, 1.0) + last_bits
    assert bootstrap_mean(tau, rng()).informative == 3
    assert [found.informative for found in bootstrap_mean_and_cv(tau, rng())] == [3, 3]
    assert bootstrap_ratio(7.4 * tau, np.full(1_000, 7.4), rng()).informative == 3
    assert bootstrap_ratio(7.4 * tau + 1.0, np.full(1_000, 7.4), rng()).informative == 3
    assert bootstrap_mean(rng().normal(size=1_000), rng()).informative == 1_000
    assert bootstrap_mean(np.array([]), rng()).informative == 0
    # Two equal values are as much the most common one as 997.
    assert bootstrap_mean(np.array([1.0, 1.0, 2.0, 3.0]), rng()).informative == 2
    zero = bootstrap_mean(np.zeros(50), rng())
    assert (zero.low, zero.high, zero.informative) == (0.0, 0.0, 0)
    # Nobody ever waits in cctc, where all 50 pairs met someone.
    entry = RESAMPLED["pedestrian_delay_s"]
    assert entry.finding("pedestrian_delay_s", zero, 50).reliable
    # Two of 50 that met someone are too few to say that nobody ever does.
    assert not entry.finding("pedestrian_delay_s", zero, 2).reliable


def test_pairs_that_met_someone_and_timed_out_make_nothing_reliable() -> None:
    """30 pairs met nobody, so τ = 1; in 30 the AV met someone and never crossed."""
    first = columns().where(np.zeros(60, dtype=int))
    out, nan = np.arange(60) < 30, np.full(60, np.nan)
    time_s, delay_s = np.full(60, 7.4), np.zeros(60)
    out_of_time = replace(
        first,
        time_s=(np.where(out, nan, time_s), time_s),
        untouched_time_s=(np.where(out, nan, time_s), time_s),
        delay_s=(np.where(out, nan, delay_s), delay_s),
        timed_out=(out, np.zeros(60, dtype=bool)),
        met=(out.astype(float), out.astype(float)),
    )
    findings = summary_of(out_of_time).findings
    assert (findings["mu"].low, findings["mu"].high, findings["met_someone"].value) == (1, 1, 30)
    assert findings["mu"].reason == (
        "unreliable: all values are equal, and only 0 are of pairs that met someone and crossed "
        "(below 20)"
    )
    assert [findings[name].reliable for name in ("mu", "cv", "delay_s")] == [False] * 3
    assert findings_from(ENCOUNTERS, row_of(ENCOUNTERS, findings)) == findings
