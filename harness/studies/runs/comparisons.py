"""The findings of a comparison of strategies, as records."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from harness.statistics import (
    DIFFERENCES,
    MU_BOUND_FROM,
    AllowedInterval,
    CrashTest,
    Difference,
    Limits,
    Relation,
    Standing,
    Summary,
    Verdict,
    pareto_front,
    relation_of_crashes,
    relation_of_times,
)
from harness.studies.runs.notebook import intervals_html, table_html
from harness.studies.runs.strategy_groups import ParameterSweep, StrategyGroup


@dataclass(frozen=True)
class Comparison:
    """Cell ``a`` less cell ``b``, positions in their group, over the pairs they have in common.

    ``time_ratio_difference`` is that of the ratio of times over the ``counted_in_both`` pairs that
    count in both (``PairColumns.times_counted``); ``counted_in_one`` count in one cell alone.
    ``time_ratio_p_holm`` and ``misses_p_holm`` are the p of what decides on the front, of its
    sign-flip test and that of ``misses``, within the family of all of these of the run.
    ``mu_worst_difference`` and ``delay_worst_difference_s`` are over all pairs.  ``crashes`` tests
    κ, ``misses`` κ with time-outs and failures of the strategy; ``p_holm`` is the p of
    ``crashes`` within the family of all such tests of the run.
    """

    a: int
    b: int
    defined_in_both: int
    mu_difference: Difference
    mu_worst_difference: Difference
    pairs_in_both: int
    crossed_in_both: int
    delay_difference_s: Difference
    crashes: CrashTest
    p_holm: float
    time_ratio_difference: Difference
    time_ratio_p_holm: float
    counted_in_both: int
    counted_in_one: int
    delay_worst_difference_s: Difference
    misses: CrashTest
    misses_p_holm: float

    @property
    def indicative(self) -> list[str]:
        """Differences whose intervals rest on too few informative pairs to hold what they say.

        None where no pair differs: those cells are alike.
        """
        found = {entry: getattr(self, entry.key).informative for entry in DIFFERENCES}
        return [entry.key for entry, n in found.items() if 0 < n < (entry.reliable_from or 0)]


@dataclass(frozen=True)
class SweepResult:
    """Which values of a parameter are allowed."""

    sweep: ParameterSweep
    limits: Limits
    found: AllowedInterval

    @property
    def indicative(self) -> tuple[bool, ...]:
        """For each value, whether μ's bound rests on too few informative pairs."""
        return tuple(of.swept.mu.informative < MU_BOUND_FROM for of in self.found.judgements)


@dataclass(frozen=True)
class GroupResult:
    """One group of cells that differ in the AV's strategy alone.

    ``level`` is the chance of error at which a difference counts as told; ``summaries`` are those
    of the group's cells, in order.  ``judged`` is the judgement of all its cells together, where a
    parameter is swept under limits.
    """

    group: StrategyGroup
    level: float
    summaries: tuple[Summary, ...]
    comparisons: tuple[Comparison, ...]
    sweeps: tuple[SweepResult, ...]
    judged: AllowedInterval | None = None

    @property
    def allowed(self) -> list[int]:
        """Positions of the cells that are allowed by bounds of all of them together."""
        judgements = () if self.judged is None else self.judged.judgements
        return [at for at, of in enumerate(judgements) if of.verdict is Verdict.ALLOWED]

    @property
    def best_allowed(self) -> int | None:
        """Of these the one of the least ratio of times; None where none is allowed."""
        times = {at: self.summaries[at].time_ratio.value for at in self.allowed}
        known = [(value, at) for at, value in times.items() if value is not None]
        return min(known)[1] if known else None

    def untold_from(self, best: int) -> list[int]:
        """Positions of the other allowed cells whose times are not told apart from that cell's."""
        told = (Relation.BETTER, Relation.WORSE)
        return [
            item.a + item.b - best
            for item in self.comparisons
            if best in (item.a, item.b)
            and {item.a, item.b} <= {*self.allowed}
            and self._times(item) not in told
        ]

    def _times(self, item: Comparison) -> Relation:
        return relation_of_times(
            item.time_ratio_difference, item.counted_in_one, item.time_ratio_p_holm, self.level
        )

    def standings(self) -> list[Standing]:
        """The place of every cell on the front of (ratio of times, κ with time-outs)."""
        relations = {
            (item.a, item.b): (
                self._times(item),
                relation_of_crashes(item.misses, item.misses_p_holm, self.level),
            )
            for item in self.comparisons
        }
        return pareto_front(len(self.summaries), relations)


@dataclass(frozen=True)
class RunComparison:
    """The comparison of a run's cells, or of several runs'.

    ``name`` is the first run's; ``confidence`` is that of each interval.
    """

    folders: tuple[Path, ...]
    name: str
    confidence: float
    groups: tuple[GroupResult, ...]

    def __repr__(self) -> str:
        """What a debugger shows."""
        count = sum(len(group.comparisons) for group in self.groups)
        return f"<RunComparison of {', '.join(map(str, self.folders))}: {count} comparisons>"

    def _repr_html_(self) -> str:
        """Every difference with its interval, for a notebook."""
        differences = [
            (f"{group.group.cells[item.a].label} − {group.group.cells[item.b].label}", item)
            for group in self.groups
            for item in group.comparisons
        ]
        rows = [
            {
                "A − B": name,
                "pairs": item.counted_in_both,
                "ratio of times": item.time_ratio_difference.words(".4f"),
                "μ": item.mu_difference.words(".4f"),
                "delay s": item.delay_difference_s.words(".4f"),
                "crashed in A / B alone": f"{item.crashes.only_a} / {item.crashes.only_b}",
                "p (Holm)": f"{item.p_holm:.2g}",
            }
            for name, item in differences
        ]
        caption = f"{self.name}: intervals of {100 * self.confidence:.3g} %"
        drawn = [(name, item.time_ratio_difference) for name, item in differences]
        label = "difference of the ratio of times with its interval"
        return table_html(caption, pd.DataFrame(rows)) + intervals_html(drawn, label, 0.0)
