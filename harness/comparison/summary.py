"""μ, c_v and κ of a cell, each with its interval.  Columns in, numbers out."""

from dataclasses import dataclass

import numpy as np

from harness.comparison.bootstrap import (
    Resampled,
    bootstrap_mean,
    bootstrap_mean_and_cv,
    bootstrap_ratio,
)
from harness.comparison.intervals import CONFIDENCE, Proportion, proportion
from harness.comparison.pair_columns import BothArms, PairColumns
from harness.encounter import FloatArray


@dataclass(frozen=True, slots=True)
class Summary:
    """What is reported of a cell; the columns of ``summary.csv`` (docs/files.md).

    Delays are means over the episodes that crossed, stops and stopped times over those that did
    not fail.  ``confidence`` is that of every interval.
    """

    pairs: int
    defined_pairs: int
    timed_out: int
    failed: int
    fallbacks: int
    met_nobody: int
    mu: Resampled
    cv: Resampled
    kappa: Proportion
    kappa_front: Proportion
    kappa_human: Proportion
    mu_without_fallback: float | None
    delay_s: Resampled
    delay_human_s: Resampled
    stops: float | None
    stops_human: float | None
    stopped_s: float | None
    stopped_human_s: float | None
    kappa_avoidable: Proportion
    kappa_avoidable_human: Proportion
    mu_all: Resampled
    delay_difference_human_s: Resampled
    pairs_all: int
    kappa_worst: Proportion
    mu_worst: Resampled
    timed_out_av: int
    timed_out_human: int
    failed_av: int
    failed_human: int
    failed_strategy: int
    failed_engine: int
    met_someone: int
    fallback_share: float | None
    defined_pairs_met_someone: int
    mu_met_someone: Resampled
    kappa_met_someone: Proportion
    kappa_human_met_someone: Proportion
    delay_met_someone_s: Resampled
    delay_human_met_someone_s: Resampled
    pedestrian_delay_s: Resampled
    pedestrian_delay_human_s: Resampled
    confidence: float
    clamped_share: float | None
    clamped_share_human: float | None
    clamped_speed_excess_mps: float | None
    clamped_range_excess_m: float | None
    time_ratio: Resampled
    time_ratio_pairs: int
    time_ratio_worst: Resampled
    kappa_all: Proportion
    delay_worst_s: Resampled
    delay_human_worst_s: Resampled
    max_speed_mps: float | None
    max_speed_human_mps: float | None


def summarise(
    pairs: PairColumns,
    timeout_s: float,
    free_pass_s: float,
    rng: np.random.Generator,
    confidence: float = CONFIDENCE,
) -> Summary:
    """μ, c_v, κ, delays, and the counts that say how far to trust them.

    τ = AV time / human time of each pair in which both crossed; μ its mean, c_v its population
    standard deviation over μ (paper, section III-E).  What this leaves out stands beside it:
    ``mu_all``, ``mu_worst`` and ``kappa_worst`` (docs/method.md, What is left out).  ``time_ratio``
    is the ratio of the sums of ``times_counted``, over ``time_ratio_pairs``, ``time_ratio_worst``
    that of ``times_worst``, over all pairs.  ``kappa_all`` is κ with
    time-outs and failures of the AV's strategy as crashes.

    Args:
        pairs: the columns, of at least one pair.
        timeout_s: the experiment's time-out.
        free_pass_s: the pass time at the initial speed.
        rng: for the bootstrap.
        confidence: of the intervals, two-sided.
    """
    # In this order: an interval's resamples do not depend on what was added after it.
    mu, cv = bootstrap_mean_and_cv(_defined(pairs.tau), rng, confidence)
    delays = [_mean_of(delay, rng, confidence) for delay in pairs.delay_s]
    mu_all = _mean_of(pairs.tau_all, rng, confidence)
    delay_difference = _mean_of(pairs.delay_difference_s, rng, confidence)
    walking = [_pedestrian_delay(pairs, arm, rng, confidence) for arm in (0, 1)]
    met = pairs.where(pairs.met_someone)
    mu_met = _mean_of(met.tau, rng, confidence)
    delays_met = [_mean_of(delay, rng, confidence) for delay in met.delay_s]
    mu_worst = _mean_of(pairs.tau_worst(timeout_s, free_pass_s), rng, confidence)
    av_s, human_s = pairs.times_counted(timeout_s)
    counted = ~np.isnan(av_s)
    time_ratio = bootstrap_ratio(av_s[counted], human_s[counted], rng, confidence)
    worst = pairs.times_worst(timeout_s, free_pass_s)
    time_ratio_worst = bootstrap_ratio(*worst, rng, confidence)
    delays_worst = [_mean_of(time_s - free_pass_s, rng, confidence) for time_s in worst]
    av_missing = pairs.crashed[0] | pairs.failed[0] | pairs.timed_out[0]
    ran = [~failed for failed in pairs.failed]
    return Summary(
        pairs=len(pairs.tau),
        defined_pairs=_count(~np.isnan(pairs.tau)),
        timed_out=_count(pairs.any_timed_out),
        failed=_count(pairs.any_failed),
        fallbacks=_count(pairs.av_fallback),
        met_nobody=_count(~pairs.met_someone & ~pairs.any_failed),
        mu=mu,
        cv=cv,
        kappa=_rate(pairs.crashed, pairs, 0, confidence),
        kappa_front=_rate(pairs.front, pairs, 0, confidence),
        kappa_human=_rate(pairs.crashed, pairs, 1, confidence),
        mu_without_fallback=_mean(pairs.tau[~pairs.av_fallback]),
        delay_s=delays[0],
        delay_human_s=delays[1],
        stops=_mean(pairs.stops[0][ran[0]]),
        stops_human=_mean(pairs.stops[1][ran[1]]),
        stopped_s=_mean(pairs.stopped_s[0][ran[0]]),
        stopped_human_s=_mean(pairs.stopped_s[1][ran[1]]),
        kappa_avoidable=_rate(pairs.avoidable, pairs, 0, confidence),
        kappa_avoidable_human=_rate(pairs.avoidable, pairs, 1, confidence),
        mu_all=mu_all,
        delay_difference_human_s=delay_difference,
        pairs_all=_count(~np.isnan(pairs.tau_all)),
        kappa_worst=proportion(_count(av_missing), len(av_missing), confidence),
        mu_worst=mu_worst,
        timed_out_av=_count(pairs.timed_out[0]),
        timed_out_human=_count(pairs.timed_out[1]),
        failed_av=_count(pairs.failed[0]),
        failed_human=_count(pairs.failed[1]),
        failed_strategy=_count(pairs.failed_strategy[0] | pairs.failed_strategy[1]),
        failed_engine=_count(_failed_engine(pairs)),
        met_someone=_count(pairs.met_someone),
        fallback_share=_mean(pairs.av_fallback[pairs.met[0] > 0].astype(float)),
        defined_pairs_met_someone=_count(~np.isnan(met.tau)),
        mu_met_someone=mu_met,
        kappa_met_someone=_rate(met.crashed, met, 0, confidence),
        kappa_human_met_someone=_rate(met.crashed, met, 1, confidence),
        delay_met_someone_s=delays_met[0],
        delay_human_met_someone_s=delays_met[1],
        pedestrian_delay_s=walking[0],
        pedestrian_delay_human_s=walking[1],
        confidence=confidence,
        clamped_share=_clamped_share(pairs, 0),
        clamped_share_human=_clamped_share(pairs, 1),
        clamped_speed_excess_mps=_largest(*pairs.speed_excess_mps),
        clamped_range_excess_m=_largest(*pairs.range_excess_m),
        time_ratio=time_ratio,
        time_ratio_pairs=_count(counted),
        time_ratio_worst=time_ratio_worst,
        kappa_all=proportion(_count(pairs.av_missed), _count(pairs.av_tried), confidence),
        delay_worst_s=delays_worst[0],
        delay_human_worst_s=delays_worst[1],
        max_speed_mps=_largest(pairs.max_speed_mps[0]),
        max_speed_human_mps=_largest(pairs.max_speed_mps[1]),
    )


def _clamped_share(pairs: PairColumns, arm: int) -> float | None:
    """Clamped conditionings / conditionings of an arm; None where the model was never asked."""
    asked = np.nansum(pairs.conditionings[arm])
    return float(np.nansum(pairs.clamped[arm]) / asked) if asked else None


def _largest(*columns: FloatArray) -> float | None:
    defined = _defined(np.concatenate(columns))
    return float(defined.max()) if len(defined) else None


def _pedestrian_delay(
    pairs: PairColumns, arm: int, rng: np.random.Generator, confidence: float
) -> Resampled:
    """Sum of waits / persons over the episodes that ran."""
    ran = ~pairs.failed[arm] & ~np.isnan(pairs.arrivals[arm])
    return bootstrap_ratio(pairs.waited_s[arm][ran], pairs.arrivals[arm][ran], rng, confidence)


def _failed_engine(pairs: PairColumns) -> np.ndarray:
    """Whether the engine failed in either arm."""
    av, human = (
        failed & ~of_strategy
        for failed, of_strategy in zip(pairs.failed, pairs.failed_strategy, strict=True)
    )
    engine: np.ndarray = av | human
    return engine


def _rate(marked: BothArms, pairs: PairColumns, arm: int, confidence: float) -> Proportion:
    """Share of marked episodes among those of an arm that did not fail."""
    return proportion(_count(marked[arm]), _count(~pairs.failed[arm]), confidence)


def _mean_of(values: FloatArray, rng: np.random.Generator, confidence: float) -> Resampled:
    return bootstrap_mean(_defined(values), rng, confidence)


def _count(marked: np.ndarray) -> int:
    return int(np.count_nonzero(marked))


def _defined(values: FloatArray) -> FloatArray:
    return values[~np.isnan(values)]


def _mean(values: FloatArray) -> float | None:
    defined = _defined(values)
    return float(np.mean(defined)) if len(defined) else None
