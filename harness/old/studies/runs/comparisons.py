"""The findings of a comparison of strategies, as records."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from harness.old.statistics import (
    CONFIDENCE,
    DIFFERENCES,
    AllowedInterval,
    CrashTest,
    Difference,
    Limits,
    OverModel,
    Summary,
)
from harness.old.studies.runs.strategy_groups import ParameterSweep, StrategyGroup

LEVEL = 1 - CONFIDENCE
"""Significance level of the tests."""


@dataclass(frozen=True)
class Comparison:
    """Cell ``a`` minus cell ``b``, over their common pairs.

    ``a`` and ``b`` are positions in the group.  ``time_ratio_difference`` is the difference between
    the ratios of times, over the ``counted_in_both`` pairs that count in both cells
    (``PairColumns.times_counted``).  ``counted_in_one`` pairs count in only one cell.
    ``mu_worst_difference`` and ``delay_worst_difference_s`` cover all pairs.  ``crashes`` tests κ;
    ``misses`` tests κ with time-outs and failures of the strategy.  ``p_holm`` is the p value of
    ``crashes``, adjusted over all such tests of the run.  ``time_ratio_p_holm`` (sign-flip test)
    and ``misses_p_holm`` are adjusted over both kinds of test.
    ``over_model`` has the first screen's differences with their intervals over pairs and refits, if
    pairs are spread over refits of the model.
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
    over_model: Mapping[str, OverModel] = field(default_factory=dict)

    @property
    def indicative(self) -> list[str]:
        """Keys of the differences whose intervals are unreliable, with too few informative pairs.

        A difference without any informative pair is not listed, because the cells are equal.
        """
        informative = {entry: getattr(self, entry.key).informative for entry in DIFFERENCES}
        return [entry.key for entry, n in informative.items() if 0 < n < (entry.reliable_from or 0)]


@dataclass(frozen=True)
class SweepResult:
    """The allowed values of a parameter."""

    sweep: ParameterSweep
    limits: Limits
    found: AllowedInterval


@dataclass(frozen=True)
class GroupResult:
    """A group of cells that differ only in the AV's strategy.

    ``summaries`` are the summaries of the
    group's cells, in order.
    """

    group: StrategyGroup
    summaries: tuple[Summary, ...]
    comparisons: tuple[Comparison, ...]
    sweeps: tuple[SweepResult, ...]

    def beaten_by(self, cell: int, by: int) -> list[int]:
        """Return the positions of the cells that ``cell`` beats, in times (``by`` 0) or κ (1).

        Times count if the interval of their difference excludes 0 and the adjusted test rejects.
        """
        beaten = []
        for item in self.comparisons:
            if cell not in (item.a, item.b):
                continue
            if by:
                sign = float(item.misses.only_a - item.misses.only_b)
                better = item.misses_p_holm < LEVEL
            else:
                sign = item.time_ratio_difference.low or 0.0
                excludes_0 = sign * (item.time_ratio_difference.high or 0.0) > 0
                better = excludes_0 and item.time_ratio_p_holm < LEVEL
            if better and (sign < 0) is (cell == item.a):
                beaten.append(item.a + item.b - cell)
        return sorted(beaten)


@dataclass(frozen=True)
class RunComparison:
    """The comparison of the cells of one run or of several.

    ``name`` is the name of the first run.
    """

    folders: tuple[Path, ...]
    name: str
    groups: tuple[GroupResult, ...]

    def __repr__(self) -> str:
        """Return the text that a debugger shows."""
        count = sum(len(group.comparisons) for group in self.groups)
        return f"<RunComparison of {', '.join(map(str, self.folders))}: {count} comparisons>"

    def _repr_html_(self) -> str:
        """Return every difference with its interval as HTML for a notebook."""
        rows = [
            {
                "A − B": f"{group.group.cells[item.a].label} − {group.group.cells[item.b].label}",
                "pairs": item.counted_in_both,
                "ratio of times": item.time_ratio_difference.words(".4f"),
                "μ": item.mu_difference.words(".4f"),
                "delay s": item.delay_difference_s.words(".4f"),
                "crashed in A / B alone": f"{item.crashes.only_a} / {item.crashes.only_b}",
                "p (Holm)": f"{item.p_holm:.2g}",
            }
            for group in self.groups
            for item in group.comparisons
        ]
        html: str = pd.DataFrame(rows).to_html(index=False)
        return html
