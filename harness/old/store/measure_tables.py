"""Statistics of each measure over a cell's episodes, and the rate of each kind of conflict.

Rows of ``measures.csv`` and ``conflicts.csv`` (docs/files.md).
"""

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.encounter import Arm, Ending, FloatArray
from harness.measures import MEASURES
from harness.old.statistics import CONFLICTS, Findings, Plain
from harness.scenario import ConflictsSection

QUANTILES = {"p05": 0.05, "p50": 0.5, "p95": 0.95}


def measure_rows(episodes: pa.Table) -> list[dict[str, Plain]]:
    """Statistics of every measure, for each arm, over the episodes in which it is defined.

    Args:
        episodes: rows of one cell.

    Returns:
        ``arm, measure, defined, mean, p05, p50, p95``, and the same with ``_met_someone`` over the
        pairs in which either arm met someone.  Failed episodes do not count.  Quantiles are
        interpolated linearly.  True counts as 1.  A statistic is None if the measure is defined in
        no episode.
    """
    rows = []
    for arm in Arm:
        ran = _that_ran(episodes, arm)
        for measure in MEASURES:
            values, met = _numbers(ran, measure.column), _met_someone(ran, episodes)
            met_someone = _statistics(values[met])
            rows.append(
                {"arm": arm.value, "measure": measure.column}
                | _statistics(values)
                | {f"{name}_met_someone": value for name, value in met_someone.items()}
            )
    return rows


def _statistics(values: FloatArray) -> dict[str, Plain]:
    defined = values[~np.isnan(values)]
    statistics = dict[str, Plain](defined=len(defined), mean=None) | dict.fromkeys(QUANTILES)
    if len(defined):
        quantiles = np.quantile(defined, list(QUANTILES.values())).tolist()
        statistics |= {
            "mean": float(np.mean(defined)),
            **dict(zip(QUANTILES, quantiles, strict=True)),
        }
    return statistics


def conflict_rows(findings: Findings, thresholds: ConflictsSection) -> list[dict[str, Plain]]:
    """The rows of a cell in ``conflicts.csv``, without its keys, by arm and kind of conflict."""
    rows = []
    for arm, end in ((Arm.AV, ""), (Arm.HUMAN, "_human")):
        for conflict in CONFLICTS:
            rate = findings[f"conflict_{conflict.name}{end}"]
            met = findings[f"conflict_{conflict.name}_met_someone{end}"]
            row: dict[str, Plain] = {
                "arm": arm.value,
                "conflict": conflict.name,
                "threshold": getattr(thresholds, conflict.threshold),
                "episodes": rate.n,
                "conflicts": rate.events,
                "rate": rate.value,
                "ci_low": rate.low,
                "ci_high": rate.high,
                "confidence": findings["confidence"].value,
                "episodes_met_someone": met.n,
                "conflicts_met_someone": met.events,
                "rate_met_someone": met.value,
                "rate_met_someone_ci_low": met.low,
                "rate_met_someone_ci_high": met.high,
            }
            rows.append(row)
    return rows


def _that_ran(episodes: pa.Table, arm: Arm) -> pa.Table:
    in_arm = pc.equal(episodes["arm"], arm.value)
    ran = pc.not_equal(episodes["ending"], Ending.ENGINE_FAILED.value)
    return episodes.filter(pc.and_(in_arm, ran))


def _met_someone(ran: pa.Table, episodes: pa.Table) -> np.ndarray:
    """A mask of the episodes of an arm that belong to pairs in which either arm met someone."""
    met = episodes.filter(pc.greater(episodes["pedestrians"], 0))["pair"]
    return np.isin(ran["pair"].to_numpy(), met.to_numpy())


def _numbers(episodes: pa.Table, column: str) -> FloatArray:
    """A measure as floats, NaN where undefined."""
    numbers: FloatArray = episodes[column].cast(pa.float64()).to_numpy()
    return numbers
