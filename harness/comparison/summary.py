"""μ, c_v and κ of a cell, each with its interval.  Columns in, numbers out."""

from dataclasses import dataclass

import numpy as np

from harness.comparison.intervals import (
    CONFIDENCE,
    Interval,
    Proportion,
    bootstrap_mean,
    bootstrap_mean_and_cv,
    proportion,
)
from harness.encounter import FloatArray

BothArms = tuple[np.ndarray, np.ndarray]
"""Aligned columns of the AV's and the human's arm, one entry for each pair."""


@dataclass(frozen=True, slots=True)
class PairColumns:
    """Aligned columns of a cell, one entry for each pair.

    ``time_s`` and ``delay_s`` are NaN where the arm did not cross, ``stops`` and ``stopped_s``
    where it failed; ``front`` marks contacts with the front, ``avoidable`` crashes that full
    braking would have prevented; ``met`` is the number of pedestrians on the crossing over both
    arms.
    """

    time_s: BothArms
    delay_s: BothArms
    stops: BothArms
    stopped_s: BothArms
    crashed: BothArms
    front: BothArms
    avoidable: BothArms
    timed_out: BothArms
    failed: BothArms
    av_fallback: np.ndarray
    met: np.ndarray

    @property
    def tau(self) -> FloatArray:
        """AV time / human time of each pair, NaN where either arm did not cross."""
        av, human = self.time_s
        ratio: FloatArray = av / human
        return ratio

    def tau_with_timeouts(self, timeout_s: float) -> FloatArray:
        """τ with timed-out arms counted at ``timeout_s``; NaN after a crash or a failure."""
        av, human = (
            np.where(out, timeout_s, time)
            for out, time in zip(self.timed_out, self.time_s, strict=True)
        )
        ratio: FloatArray = av / human
        return ratio

    @property
    def any_timed_out(self) -> np.ndarray:
        """Whether either arm of the pair timed out."""
        return self.timed_out[0] | self.timed_out[1]


@dataclass(frozen=True, slots=True)
class Summary:
    """What is reported of a cell; the columns of ``summary.csv``.

    Delays are means over the episodes that crossed, stops and stopped times over those that did
    not fail.
    """

    pairs: int
    defined_pairs: int
    timed_out: int
    failed: int
    fallbacks: int
    met_nobody: int
    mu: Interval
    mu_timeout: float | None
    cv: Interval
    kappa: Proportion
    kappa_front: float | None
    kappa_human: Proportion
    mu_without_fallback: float | None
    delay_s: Interval
    delay_human_s: Interval
    stops: float | None
    stops_human: float | None
    stopped_s: float | None
    stopped_human_s: float | None
    kappa_avoidable: Proportion
    kappa_avoidable_human: Proportion


def summarise(
    pairs: PairColumns,
    timeout_s: float,
    rng: np.random.Generator,
    confidence: float = CONFIDENCE,
) -> Summary:
    """μ, c_v, κ, delays, and the counts that say how far to trust them.

    τ = AV time / human time of each pair in which both crossed; μ its mean, c_v its population
    standard deviation over μ (paper, section III-E).  ``mu_timeout`` counts timed-out arms at
    ``timeout_s``, because dropping them would flatter a timid strategy.

    Args:
        pairs: the columns.
        timeout_s: the experiment's time-out.
        rng: for the bootstrap.
        confidence: of the intervals, two-sided.
    """
    av_ran, human_ran = ~pairs.failed[0], ~pairs.failed[1]
    tau = pairs.tau
    defined = ~np.isnan(tau)
    mu, cv = bootstrap_mean_and_cv(tau[defined], rng, confidence)
    delays = [bootstrap_mean(delay[~np.isnan(delay)], rng, confidence) for delay in pairs.delay_s]
    with_timeouts = pairs.tau_with_timeouts(timeout_s)
    kappa = proportion(int(pairs.crashed[0].sum()), int(av_ran.sum()), confidence)
    return Summary(
        pairs=len(tau),
        defined_pairs=int(defined.sum()),
        timed_out=int(pairs.any_timed_out.sum()),
        failed=int((~av_ran | ~human_ran).sum()),
        fallbacks=int(pairs.av_fallback.sum()),
        met_nobody=int((pairs.met == 0).sum()),
        mu=mu,
        mu_timeout=_mean(with_timeouts[~np.isnan(with_timeouts)]),
        cv=cv,
        kappa=kappa,
        kappa_front=int(pairs.front[0].sum()) / kappa.trials if kappa.trials else None,
        kappa_human=proportion(int(pairs.crashed[1].sum()), int(human_ran.sum()), confidence),
        mu_without_fallback=_mean(tau[defined & ~pairs.av_fallback]),
        delay_s=delays[0],
        delay_human_s=delays[1],
        stops=_mean(pairs.stops[0][av_ran]),
        stops_human=_mean(pairs.stops[1][human_ran]),
        stopped_s=_mean(pairs.stopped_s[0][av_ran]),
        stopped_human_s=_mean(pairs.stopped_s[1][human_ran]),
        kappa_avoidable=proportion(int(pairs.avoidable[0].sum()), int(av_ran.sum()), confidence),
        kappa_avoidable_human=proportion(
            int(pairs.avoidable[1].sum()), int(human_ran.sum()), confidence
        ),
    )


def _mean(values: FloatArray) -> float | None:
    return float(np.mean(values)) if len(values) else None
