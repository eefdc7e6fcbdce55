"""The columns from which the reported numbers of encounters are computed."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from harness.core.encounter import FloatArray
from harness.old.statistics.bootstrap import (
    Resampled,
    bootstrap_mean,
    bootstrap_mean_and_cv,
    bootstrap_ratio,
)
from harness.old.statistics.intervals import CONFIDENCE, UNKNOWN_PROPORTION, Proportion, proportion
from harness.old.statistics.pair_columns import BothArms, PairColumns


@dataclass(frozen=True)
class EncounterColumns:
    """The aligned columns of a cell and the other inputs of their statistics.

    Attributes:
        pairs: the columns of at least one pair.
        timeout_s: the experiment's time-out.
        free_pass_s: the pass time at the initial speed.
        rng: draws the resamples; every interval begins with the same state.  None: numbers that
            would be resampled have no interval.
        confidence: two-sided confidence of each interval.
        conflicts: which episodes had a conflict of each kind, by the kind's name.
        repeated: whether all episodes of each arm repeat the same one: nothing in them is random.
    """

    pairs: PairColumns
    timeout_s: float
    free_pass_s: float
    rng: np.random.Generator | None
    confidence: float = CONFIDENCE
    conflicts: Mapping[str, BothArms] = field(default_factory=dict)
    repeated: tuple[bool, bool] = (False, False)

    @cached_property
    def met(self) -> "EncounterColumns":
        """The columns of the pairs that met someone."""
        met = self.pairs.met_someone
        conflicts = {name: (av[met], human[met]) for name, (av, human) in self.conflicts.items()}
        return replace(self, pairs=self.pairs.where(met), conflicts=conflicts)

    @cached_property
    def mu_and_cv(self) -> tuple[Resampled, Resampled]:
        """Mean and coefficient of variation of τ, from the same resamples."""
        return bootstrap_mean_and_cv(defined(self.pairs.tau), self.rng, self.confidence)

    @cached_property
    def times(self) -> BothArms:
        """Both arms' times of the pairs that the ratio of times counts."""
        av, human = self.pairs.times_counted(self.timeout_s)
        counted = ~np.isnan(av)
        return av[counted], human[counted]

    @cached_property
    def worst(self) -> BothArms:
        """Both arms' times of every pair; missing times count against the AV."""
        return self.pairs.times_worst(self.timeout_s, self.free_pass_s)

    def ran(self, arm: int) -> np.ndarray:
        """A mask of the episodes of an arm that did not fail."""
        return ~self.pairs.failed[arm]

    def mean(self, values: FloatArray) -> Resampled:
        """The mean of the defined values."""
        return bootstrap_mean(defined(values), self.rng, self.confidence)

    def ratio(self, numerators: FloatArray, denominators: FloatArray) -> Resampled:
        """The ratio of two sums."""
        return bootstrap_ratio(numerators, denominators, self.rng, self.confidence)

    def rate(self, marked: BothArms, arm: int) -> Proportion:
        """The share of marked episodes among the episodes of an arm that did not fail."""
        return self.share(marked[arm] & self.ran(arm), self.ran(arm), arm)

    def conflict_rate(self, name: str, arm: int) -> Proportion:
        """The share of an arm's episodes with a conflict of a kind; undefined if none is stored."""
        marked = self.conflicts.get(name)
        return UNKNOWN_PROPORTION if marked is None else self.rate(marked, arm)

    def worst_rate(self, arm: int) -> Proportion:
        """The share of all pairs in which an arm crashed, failed or timed out."""
        pairs = self.pairs
        missing = pairs.crashed[arm] | pairs.failed[arm] | pairs.timed_out[arm]
        return self.share(missing, np.ones_like(missing), arm)

    def share(self, marked: np.ndarray, trials: np.ndarray, arm: int) -> Proportion:
        """The share of an arm's marked episodes among those of the mask ``trials``."""
        return proportion(
            count(marked), count(trials), self.confidence, repeated=self.repeated[arm]
        )

    def walking_delay(self, arm: int) -> Resampled:
        """Sum of waits at the kerb / people who arrived, over the episodes that ran."""
        waited_s, arrivals = self.pairs.waited_s[arm], self.pairs.arrivals[arm]
        ran = self.ran(arm) & ~np.isnan(arrivals)
        return self.ratio(waited_s[ran], arrivals[ran])

    def clamped_share(self, arm: int) -> float | None:
        """The share of an arm's uses of the interaction model that were outside its box."""
        conditionings = np.nansum(self.pairs.conditionings[arm])
        return float(np.nansum(self.pairs.clamped[arm]) / conditionings) if conditionings else None

    def failures_of_engine(self) -> int:
        """Pairs in which the engine failed in either arm."""
        failed, strategy = self.pairs.failed, self.pairs.failed_strategy
        return count((failed[0] & ~strategy[0]) | (failed[1] & ~strategy[1]))


def count(marked: np.ndarray) -> int:
    """The number of marked entries."""
    return int(np.count_nonzero(marked))


def count_defined(values: FloatArray) -> int:
    """The number of defined values."""
    return count(~np.isnan(values))


def defined(values: FloatArray) -> FloatArray:
    """The defined values."""
    return values[~np.isnan(values)]


def mean_of(values: FloatArray) -> float | None:
    """The mean of the defined values, without an interval."""
    known = defined(values)
    return float(np.mean(known)) if len(known) else None


def largest(*columns: FloatArray) -> float | None:
    """The largest defined value of some columns."""
    known = defined(np.concatenate(columns))
    return float(known.max()) if len(known) else None
