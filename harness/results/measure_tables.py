"""Statistics of each measure over a cell's episodes, and how often each conflict arose.

Rows of ``measures.csv`` and ``conflicts.csv`` (docs/files.md).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.comparison import Proportion, proportion
from harness.encounter import Arm, Ending, FloatArray
from harness.measures import MEASURES
from harness.scenario import ConflictsSection

QUANTILES = {"p05": 0.05, "p50": 0.5, "p95": 0.95}


@dataclass(frozen=True, slots=True)
class Conflict:
    """A kind of conflict: a measure beyond a threshold.

    ``threshold`` is the key of ``[conflicts]``; ``above`` says on which side of it the conflict is.
    """

    name: str
    column: str
    threshold: str
    above: bool


CONFLICTS = (
    Conflict("ttc", "min_ttc_s", "ttc_s", above=False),
    Conflict("time_advantage", "min_time_advantage_s", "time_advantage_s", above=False),
    Conflict("pet", "pet_s", "pet_s", above=False),
    Conflict("drac", "max_drac_mps2", "drac_mps2", above=True),
)


@dataclass(frozen=True, slots=True)
class ConflictRate:
    """Share of an arm's episodes with a conflict, with its interval and that one's confidence."""

    arm: Arm
    conflict: str
    threshold: float
    rate: Proportion
    confidence: float


def measure_rows(episodes: pa.Table) -> list[dict[str, Any]]:
    """Statistics of every measure, for each arm, over the episodes in which it is defined.

    Args:
        episodes: of one cell.

    Returns:
        ``arm, measure, defined, mean, p05, p50, p95``; failed episodes do not count, quantiles are
        interpolated linearly, truth counts as 1.  None where the measure is defined nowhere.  No
        row for a measure that the episodes have no column for (a run of an earlier version).
    """
    rows = []
    for arm in Arm:
        own = _that_ran(episodes, arm)
        for measure in MEASURES:
            if measure.column not in episodes.column_names:
                continue
            values = _numbers(own, measure.column)
            values = values[~np.isnan(values)]
            row: dict[str, Any] = {"arm": arm.value, "measure": measure.column}
            row |= {"defined": len(values), "mean": None} | dict.fromkeys(QUANTILES)
            if len(values):
                quantiles = np.quantile(values, list(QUANTILES.values())).tolist()
                row |= {
                    "mean": float(np.mean(values)),
                    **dict(zip(QUANTILES, quantiles, strict=True)),
                }
            rows.append(row)
    return rows


def conflict_rates(
    episodes: pa.Table, thresholds: ConflictsSection, confidence: float
) -> tuple[ConflictRate, ...]:
    """How often each conflict arose in each arm, Clopper–Pearson.

    An episode has a conflict if its measure lies beyond the threshold, or if it crashed; where
    the measure is undefined without a crash there was none.  Of all that did not fail.  A conflict
    whose measure the episodes have no column for is left out (a run of an earlier version).

    Args:
        episodes: of one cell.
        thresholds: of its scenario.
        confidence: of the intervals, two-sided.
    """
    rates = []
    for arm in Arm:
        own = _that_ran(episodes, arm)
        crashed = pc.equal(own["ending"], Ending.CRASHED.value).to_numpy()
        for conflict in CONFLICTS:
            if conflict.column not in episodes.column_names:
                continue
            values = _numbers(own, conflict.column)
            threshold: float = getattr(thresholds, conflict.threshold)
            # An undefined measure is NaN, which is on neither side.
            beyond = values > threshold if conflict.above else values < threshold
            count = int(np.count_nonzero(beyond | crashed))
            rate = proportion(count, len(values), confidence)
            rates.append(ConflictRate(arm, conflict.name, threshold, rate, confidence))
    return tuple(rates)


def conflict_row(rate: ConflictRate) -> dict[str, Any]:
    """A rate as the columns of ``conflicts.csv``."""
    return {
        "arm": rate.arm.value,
        "conflict": rate.conflict,
        "threshold": rate.threshold,
        "episodes": rate.rate.trials,
        "conflicts": rate.rate.successes,
        "rate": rate.rate.value,
        "ci_low": rate.rate.low,
        "ci_high": rate.rate.high,
        "confidence": rate.confidence,
    }


def _that_ran(episodes: pa.Table, arm: Arm) -> pa.Table:
    of_arm = pc.equal(episodes["arm"], arm.value)
    ran = pc.not_equal(episodes["ending"], Ending.ENGINE_FAILED.value)
    return episodes.filter(pc.and_(of_arm, ran))


def _numbers(episodes: pa.Table, column: str) -> FloatArray:
    """A measure as floats, NaN where undefined."""
    numbers: FloatArray = episodes[column].cast(pa.float64()).to_numpy()
    return numbers
