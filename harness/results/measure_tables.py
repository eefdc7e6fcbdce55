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
    """Share of an arm's episodes with a conflict, with its interval and that one's confidence.

    ``rate_met_someone`` is that over the pairs in which either arm met somebody.
    """

    arm: Arm
    conflict: str
    threshold: float
    rate: Proportion
    rate_met_someone: Proportion
    confidence: float


def measure_rows(episodes: pa.Table) -> list[dict[str, Any]]:
    """Statistics of every measure, for each arm, over the episodes in which it is defined.

    Args:
        episodes: of one cell.

    Returns:
        ``arm, measure, defined, mean, p05, p50, p95``; failed episodes do not count, quantiles are
        interpolated linearly, truth counts as 1.  None where the measure is defined nowhere.  The
        same with ``_met_someone``, over the pairs in which either arm met somebody.  No row for a
        measure that the episodes have no column for (a run of an earlier version).
    """
    rows = []
    for arm in Arm:
        own = _that_ran(episodes, arm)
        for measure in MEASURES:
            if measure.column not in episodes.column_names:
                continue
            values, met = _numbers(own, measure.column), _met_someone(own, episodes)
            of_met = _statistics(values[met])
            rows.append(
                {"arm": arm.value, "measure": measure.column}
                | _statistics(values)
                | {f"{name}_met_someone": value for name, value in of_met.items()}
            )
    return rows


def _statistics(values: FloatArray) -> dict[str, Any]:
    defined = values[~np.isnan(values)]
    found: dict[str, Any] = {"defined": len(defined), "mean": None} | dict.fromkeys(QUANTILES)
    if len(defined):
        quantiles = np.quantile(defined, list(QUANTILES.values())).tolist()
        found |= {"mean": float(np.mean(defined)), **dict(zip(QUANTILES, quantiles, strict=True))}
    return found


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
            every = beyond | crashed
            rate, rate_met = (
                proportion(int(counted.sum()), len(counted), confidence)
                for counted in (every, every[_met_someone(own, episodes)])
            )
            rates.append(ConflictRate(arm, conflict.name, threshold, rate, rate_met, confidence))
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
        "episodes_met_someone": rate.rate_met_someone.trials,
        "conflicts_met_someone": rate.rate_met_someone.successes,
        "rate_met_someone": rate.rate_met_someone.value,
        "rate_met_someone_ci_low": rate.rate_met_someone.low,
        "rate_met_someone_ci_high": rate.rate_met_someone.high,
    }


def _that_ran(episodes: pa.Table, arm: Arm) -> pa.Table:
    of_arm = pc.equal(episodes["arm"], arm.value)
    ran = pc.not_equal(episodes["ending"], Ending.ENGINE_FAILED.value)
    return episodes.filter(pc.and_(of_arm, ran))


def _met_someone(own: pa.Table, episodes: pa.Table) -> np.ndarray:
    """Which episodes of an arm are of pairs in which either arm met somebody."""
    met = episodes.filter(pc.greater(episodes["pedestrians"], 0))["pair"]
    return np.isin(own["pair"].to_numpy(), met.to_numpy())


def _numbers(episodes: pa.Table, column: str) -> FloatArray:
    """A measure as floats, NaN where undefined."""
    numbers: FloatArray = episodes[column].cast(pa.float64()).to_numpy()
    return numbers
