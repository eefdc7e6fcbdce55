"""Counts how often intervals hold a known truth, and on which side they miss it."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from scipy import stats

from benchmarks.coverage import Named, holds
from harness.statistics import Interval, Proportion, proportion

BAND = "band of the running mean, n = "
"""Begins the names of intervals that are for μ at a point of the running mean."""


class Coverage(NamedTuple):
    """Shares of experiments whose interval holds the truth, lies above it, lies below it."""

    holds: float
    too_high: float
    too_low: float


class Tally:
    """Intervals and claims of many experiments.

    Args:
        truth: by the names of the intervals.
    """

    def __init__(self, truth: Mapping[str, float]) -> None:
        self.truth = truth
        self.found: dict[str, list[Interval]] = defaultdict(list)
        self.wrong: Counter[str] = Counter()
        self.experiments = 0

    def add(self, intervals: Iterable[Named], claims: Iterable[tuple[str, bool]]) -> None:
        """One experiment: its intervals, and whether each of its claims is wrong."""
        self.experiments += 1
        for key, interval in intervals:
            self.found[key].append(interval)
        self.wrong.update({key: int(wrong) for key, wrong in claims})

    def truth_of(self, key: str) -> float:
        """Of an interval."""
        cell, name = key.split(": ")
        return self.truth[f"{cell}: mu" if name.startswith(BAND) else key]

    def coverage(self, key: str) -> Coverage:
        """Of an interval; one without limits counts as too low."""
        truth, found = self.truth_of(key), self.found[key]
        held = np.array([holds(interval, truth) for interval in found])
        above = np.array([interval.low is not None and interval.low > truth for interval in found])
        return Coverage(held.mean(), (above & ~held).mean(), (~above & ~held).mean())

    def exact(self, key: str) -> float | None:
        """Coverage of a share's interval summed over the binomial distribution; else None."""
        first = self.found[key][0]
        if not isinstance(first, Proportion):
            return None
        truth, trials = self.truth_of(key), first.trials
        chances = stats.binom.pmf(np.arange(trials + 1), trials, truth)
        return float(
            sum(
                chance
                for successes, chance in enumerate(chances)
                if holds(proportion(successes, trials), truth)
            )
        )

    def bias(self, key: str) -> tuple[float, float]:
        """Mean of the estimates less the truth, and its standard error."""
        values = np.array([interval.value for interval in self.found[key]], dtype=float)
        values = values[~np.isnan(values)] - self.truth_of(key)
        return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))

    def table(self) -> Iterator[str]:
        """In Markdown; standard errors in brackets."""
        yield "| interval of | truth | bias | holds % | exact % | too high % | too low % |"
        yield "|---|---|---|---|---|---|---|"
        for key in self.found:
            share, exact, (mean, error) = self.coverage(key), self.exact(key), self.bias(key)
            wanted = "" if exact is None else f"{100 * exact:.1f}"
            yield (
                f"| {key} | {self.truth_of(key):.5g} | {mean:+.2g} ({error:.2g}) | "
                f"{self.percent(share.holds)} | {wanted} | "
                f"{100 * share.too_high:.1f} | {100 * share.too_low:.1f} |"
            )
        yield ""
        for key, count in self.wrong.items():
            yield f"- wrong in {self.percent(count / self.experiments)} %: {key}"

    def percent(self, share: float) -> str:
        """A share of the experiments in %, with its standard error."""
        error = np.sqrt(share * (1 - share) / self.experiments)
        return f"{100 * share:.1f} ({100 * error:.1f})"
