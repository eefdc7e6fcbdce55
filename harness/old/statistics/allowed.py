"""Decides which values of a strategy's parameter keep μ below μ0 and κ below κ0, or are undecided.

The question is that of the paper's figure of the vehicle's aggressiveness.

μ is over all pairs in which the AV crossed; a human who crashed counts as if they had driven on.
κ counts time-outs and failures of the strategy as crashes, because an AV that does not arrive is
not allowed.

All bounds of a sweep hold simultaneously: m values have 2 m upper bounds, each one-sided at
1 − level / 2m (Bonferroni), and 2 m lower bounds.

An unreliable bound of μ allows nothing and denies nothing.  The bounds of κ are exact.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from harness.core.encounter import FloatArray
from harness.old.statistics.bootstrap import Resampled, bootstrap_mean
from harness.old.statistics.entries import Finding, with_reliability
from harness.old.statistics.intervals import Proportion, clopper_pearson, proportion

MOST_PAIRS = 10**9
"""Larger numbers of pairs are not reported."""


MU_BOUND_FROM = 2_000
"""From this number of informative pairs on, the bound of μ at a swept value is reliable."""


class Verdict(StrEnum):
    """The verdict on one value of the parameter."""

    ALLOWED = "allowed"
    """The upper bounds of μ and κ lie below μ0 and κ0, and the bound of μ is reliable."""
    DENIED = "denied"
    """The lower bound of κ, or a reliable one of μ, is not below its limit."""
    UNDECIDED = "undecided"


class SweepVerdict(StrEnum):
    """The verdict on the whole sweep."""

    SOME = "allowed"
    NONE = "none"
    TOO_FEW_PAIRS = "too few pairs"


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits below which μ and κ must be: μ0 > 0, 0 < κ0 ≤ 1."""

    mu0: float
    kappa0: float


@dataclass(frozen=True, slots=True)
class SweptValue:
    """μ and κ at one value; the limits of their intervals are one-sided bounds over the sweep.

    ``alike`` is the number of the ``pairs`` that met someone and have a τ.
    """

    mu: Resampled
    kappa: Proportion
    pairs: int
    alike: int

    @property
    def unreliable(self) -> bool:
        """Whether the bounds of μ are unreliable."""
        mu = self.mu
        found = Finding(mu.value, mu.low, mu.high, mu.informative)
        judged = with_reliability(found, MU_BOUND_FROM, self.alike)
        return mu.low is not None and judged.reliable is False


@dataclass(frozen=True, slots=True)
class Judgement:
    """The verdict on one value; ``pairs_needed`` pairs would decide it at these estimates."""

    swept: SweptValue
    verdict: Verdict
    pairs_needed: int | None

    @property
    def unreliable(self) -> bool:
        """Whether the value is undecided and the bounds of μ are unreliable."""
        return self.verdict is Verdict.UNDECIDED and self.swept.unreliable


@dataclass(frozen=True, slots=True)
class AllowedInterval:
    """The verdict on a sweep: some values are allowed, none is, or there are too few pairs.

    If there are too few pairs, ``expected`` is the verdict that the present estimates suggest, and
    ``pairs_needed`` is the number of pairs that would show it (one value allowed, or all denied);
    None if unknown.
    """

    verdict: SweepVerdict
    expected: SweepVerdict
    judgements: tuple[Judgement, ...]
    pairs_needed: int | None


def swept_value(
    tau: FloatArray,
    missed: np.ndarray,
    tried: np.ndarray,
    alike: int,
    rng: np.random.Generator,
    values: int,
    level: float,
    *,
    repeated: bool,
) -> SweptValue:
    """μ and κ of one cell with bounds that hold over all values of the sweep.

    Args:
        tau: ``tau_all`` of each pair, NaN where undefined.
        missed: whether the AV crashed, timed out, or failed because of its strategy.
        tried: whether the AV's episode ran, or failed because of its strategy.
        alike: number of pairs that met someone and have a τ.
        rng: draws the resamples.
        values: m, the number of swept values.
        level: probability that any upper (or any lower) bound is wrong.
        repeated: whether all episodes of the AV repeat the same one; κ then has no bounds.
    """
    confidence = 1 - 2 * _tail(values, level)
    return SweptValue(
        bootstrap_mean(tau[~np.isnan(tau)], rng, confidence),
        proportion(int((missed & tried).sum()), int(tried.sum()), confidence, repeated=repeated),
        len(tau),
        alike,
    )


def allowed_interval(sweep: Sequence[SweptValue], limits: Limits, level: float) -> AllowedInterval:
    """The verdicts on a sweep and on each of its values.

    Args:
        sweep: see ``swept_value``.
        limits: μ0 and κ0.
        level: the level given to ``swept_value``.
    """
    tail = _tail(len(sweep), level)
    judgements = tuple(_judge(swept, limits, tail) for swept in sweep)
    verdicts = {judgement.verdict for judgement in judgements}
    if Verdict.ALLOWED in verdicts:
        return AllowedInterval(SweepVerdict.SOME, SweepVerdict.SOME, judgements, None)
    if verdicts == {Verdict.DENIED}:
        return AllowedInterval(SweepVerdict.NONE, SweepVerdict.NONE, judgements, None)
    undecided = [judgement for judgement in judgements if judgement.verdict is Verdict.UNDECIDED]
    within = [judgement for judgement in undecided if _within(judgement.swept, limits)]
    known = [item.pairs_needed for item in within or undecided if item.pairs_needed is not None]
    if within:
        expected, pairs = SweepVerdict.SOME, min(known, default=None)
    else:
        expected, pairs = SweepVerdict.NONE, max(known) if len(known) == len(undecided) else None
    return AllowedInterval(SweepVerdict.TOO_FEW_PAIRS, expected, judgements, pairs)


def _tail(values: int, level: float) -> float:
    return level / (2 * values)


def _judge(swept: SweptValue, limits: Limits, tail: float) -> Judgement:
    mu, kappa, known = swept.mu, swept.kappa, not swept.unreliable
    below = (_is(mu.high, limits.mu0, below=True), _is(kappa.high, limits.kappa0, below=True))
    if known and all(below):
        return Judgement(swept, Verdict.ALLOWED, None)
    too_slow = known and _is(mu.low, limits.mu0, below=False)
    if too_slow or _is(kappa.low, limits.kappa0, below=False):
        return Judgement(swept, Verdict.DENIED, None)
    return Judgement(swept, Verdict.UNDECIDED, _pairs_needed(swept, limits, tail))


def _pairs_needed(swept: SweptValue, limits: Limits, tail: float) -> int | None:
    """Pairs that would show that both estimates are below their limits, or that one is not."""
    sides = [
        (swept.mu.value, limits.mu0, _pairs_for_mu(swept, limits.mu0)),
        (swept.kappa.value, limits.kappa0, _pairs_for_kappa(swept, limits.kappa0, tail)),
    ]
    if _within(swept, limits):
        known = [pairs for *_, pairs in sides if pairs is not None]
        return max(known) if len(known) == len(sides) else None
    beyond = [
        pairs
        for estimate, limit, pairs in sides
        if pairs is not None and estimate is not None and estimate > limit
    ]
    return min(beyond, default=None)


def _is(bound: float | None, limit: float, *, below: bool) -> bool:
    return bound is not None and (bound < limit) == below


def _within(swept: SweptValue, limits: Limits) -> bool:
    """Whether both estimates lie below their limits."""
    return _is(swept.mu.value, limits.mu0, below=True) and _is(
        swept.kappa.value, limits.kappa0, below=True
    )


def _pairs_for_mu(swept: SweptValue, limit: float) -> int | None:
    """Pairs at which the bound would be reliable and reach the limit.

    Its distance from μ falls with 1/√N; the share of informative pairs stays the same.
    """
    mu = swept.mu
    if mu.value is None or mu.low is None or mu.high is None or mu.value == limit:
        return None
    distance = mu.high - mu.value if mu.value < limit else mu.value - mu.low
    pairs = swept.pairs * (distance / (limit - mu.value)) ** 2
    if swept.unreliable:
        if not mu.informative:
            return None
        pairs = max(pairs, swept.pairs * MU_BOUND_FROM / mu.informative)
    return _reported(pairs)


def _pairs_for_kappa(swept: SweptValue, limit: float, tail: float) -> int | None:
    """Pairs at which the Clopper–Pearson bound would pass the limit if the share stays the same."""
    rate, trials = swept.kappa.value, swept.kappa.trials
    if rate is None or swept.kappa.high is None or rate == limit:
        return None
    if rate < limit:
        passes: Callable[[int], bool] = lambda n: _bounds(rate, n, tail)[1] < limit  # noqa: E731
    else:
        passes = lambda n: _bounds(rate, n, tail)[0] >= limit  # noqa: E731
    if not passes(MOST_PAIRS):
        return None
    few, enough = 0, 1
    while not passes(enough):
        few, enough = enough, 2 * enough
    while enough - few > 1:
        middle = (few + enough) // 2
        few, enough = (few, middle) if passes(middle) else (middle, enough)
    return _reported(enough * swept.pairs / trials)


def _bounds(rate: float, n: int, tail: float) -> tuple[float, float]:
    return clopper_pearson(rate * n, n, 1 - 2 * tail)


def _reported(pairs: float) -> int | None:
    whole = math.ceil(pairs)
    return whole if whole <= MOST_PAIRS else None
