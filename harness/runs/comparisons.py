"""What a comparison of strategies found, as records."""

from dataclasses import dataclass
from pathlib import Path

from harness.comparison import (
    INDICATIVE_COMPARED_BELOW,
    AllowedInterval,
    CrashTest,
    Interval,
    Limits,
    Standing,
    Summary,
    pareto_front,
    relation_of_crashes,
    relation_of_means,
)
from harness.runs.strategy_groups import ParameterSweep, StrategyGroup
from harness.sketch import html_table, intervals_sketch


@dataclass(frozen=True)
class Comparison:
    """Cell ``a`` less cell ``b``, positions in their group, over the pairs they have in common.

    ``mu_worst_difference`` is that of ``mu_worst`` over all pairs; ``p_holm``
    is the McNemar test's p within the family of all such tests of the run.
    """

    a: int
    b: int
    defined_in_both: int
    mu_difference: Interval
    mu_worst_difference: Interval
    pairs_in_both: int
    crossed_in_both: int
    delay_difference_s: Interval
    crashes: CrashTest
    p_holm: float

    @property
    def indicative(self) -> list[str]:
        """Differences of which N is too small for their intervals to hold what they say."""
        counts = {
            "mu_difference": self.defined_in_both,
            "mu_worst_difference": self.pairs_in_both,
            "delay_difference_s": self.crossed_in_both,
        }
        return [name for name, count in counts.items() if count < INDICATIVE_COMPARED_BELOW[name]]


@dataclass(frozen=True)
class SweepResult:
    """Which values of a parameter are allowed."""

    sweep: ParameterSweep
    limits: Limits
    found: AllowedInterval

    @property
    def indicative(self) -> tuple[bool, ...]:
        """Of every value, whether N is too small for μ's bound to hold what it says."""
        least = INDICATIVE_COMPARED_BELOW["mu_bound"]
        return tuple(judgement.swept.defined_pairs < least for judgement in self.found.judgements)


@dataclass(frozen=True)
class GroupResult:
    """One group of cells that differ in the AV's strategy alone.

    ``level`` is the chance of error at which a difference counts as told; ``summaries`` are those
    of the group's cells, in order.
    """

    group: StrategyGroup
    level: float
    summaries: tuple[Summary, ...]
    comparisons: tuple[Comparison, ...]
    sweeps: tuple[SweepResult, ...]

    def standings(self) -> list[Standing]:
        """The place of every cell on the Pareto front of (μ, κ)."""
        relations = {
            (item.a, item.b): (
                relation_of_means(item.mu_difference),
                relation_of_crashes(item.crashes, item.p_holm, self.level),
            )
            for item in self.comparisons
        }
        return pareto_front(len(self.summaries), relations)


@dataclass(frozen=True)
class RunComparison:
    """All of a run, or of several; ``confidence`` is that of each interval.

    ``name`` is the first one's.
    """

    folders: tuple[Path, ...]
    name: str
    confidence: float
    groups: tuple[GroupResult, ...]

    def _repr_html_(self) -> str:
        """What a notebook shows: every difference with its interval."""
        named = [(group.group.cells, item) for group in self.groups for item in group.comparisons]
        pairs = [(f"{cells[of.a].label} − {cells[of.b].label}", of) for cells, of in named]
        rows = [
            [
                words,
                str(item.defined_in_both),
                _in_words(item.mu_difference),
                _in_words(item.delay_difference_s),
                f"{item.crashes.only_a} / {item.crashes.only_b}",
                f"{item.p_holm:.2g}",
            ]
            for words, item in pairs
        ]
        headings = ("A − B", "pairs", "μ", "delay s", "crashed in A / B alone", "p (Holm)")
        caption = f"{self.name}: intervals of {100 * self.confidence:.3g} %"
        drawn = [(words, *_limits_of(item.mu_difference)) for words, item in pairs[:_DRAWN]]
        title = "differences of μ with their intervals; the line is 0"
        return html_table(caption, headings, rows) + intervals_sketch(drawn, title, 0.0)


_DRAWN = 12


def _limits_of(interval: Interval) -> tuple[float | None, float | None, float | None]:
    return interval.value, interval.low, interval.high


def _in_words(interval: Interval) -> str:
    if interval.value is None:
        return "undefined"
    known = interval.low is not None and interval.high is not None
    return f"{interval.value:.4f}" + (
        f" ({interval.low:.4f} … {interval.high:.4f})" if known else ""
    )
