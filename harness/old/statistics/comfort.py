"""The entries of comfort: how hard the vehicle brakes and jerks when it meets somebody."""

import math
from collections.abc import Callable

import numpy as np

from harness.core.encounter import FloatArray
from harness.old.statistics.bootstrap import Resampled
from harness.old.statistics.conflicts import MET, NOBODY
from harness.old.statistics.encounter_columns import EncounterColumns
from harness.old.statistics.entries import Entry
from harness.old.statistics.intervals import Interval, quantile
from harness.old.statistics.pair_columns import BothArms, PairColumns

_SHARE = 0.95

_Column = Callable[[PairColumns], BothArms]


def comfort_entries() -> tuple[Entry[EncounterColumns], ...]:
    """Root mean square and 95 % quantile of acceleration and of jerk."""
    return (
        _root_mean_square(
            "acceleration_rms_mps2",
            "acceleration, root mean square",
            "m/s²",
            lambda pairs: pairs.rms_acceleration_mps2,
        ),
        _quantile(
            "max_deceleration_p95_mps2",
            "hardest braking, 95 % quantile",
            "m/s²",
            lambda pairs: pairs.max_deceleration_mps2,
        ),
        _root_mean_square(
            "jerk_rms_mps3",
            "jerk, root mean square",
            "m/s³",
            lambda pairs: pairs.rms_jerk_mps3,
        ),
        _quantile(
            "max_jerk_p95_mps3",
            "largest jerk, 95 % quantile",
            "m/s³",
            lambda pairs: pairs.max_jerk_mps3,
        ),
    )


def _root_mean_square(
    key: str, heading: str, unit: str, column: _Column
) -> Entry[EncounterColumns]:
    def of_arm(columns: EncounterColumns, arm: int) -> Resampled:
        values, steps = _met(columns, column, arm)
        square = columns.ratio(steps * values**2, steps)
        value, low, high = (
            None if end is None else math.sqrt(end)
            for end in (square.value, square.low, square.high)
        )
        return Resampled(value, low, high, square.informative)

    return Entry(
        key,
        f"{heading}, pairs that met someone",
        f"Root mean square over all steps of the episodes that did not fail. {MET}",
        unit=unit,
        of_arm=of_arm,
        interval=Resampled,
        reliable_from=200,
        undefined=NOBODY,
    )


def _quantile(key: str, heading: str, unit: str, column: _Column) -> Entry[EncounterColumns]:
    def of_arm(columns: EncounterColumns, arm: int) -> Interval:
        values, _ = _met(columns, column, arm)
        return quantile(values, _SHARE, 0.0 if columns.rng is None else columns.confidence)

    return Entry(
        key,
        f"{heading}, pairs that met someone",
        "The value that 95 % of the episodes that did not fail do not exceed; each episode counts "
        f"with its largest value. {MET}",
        unit=unit,
        of_arm=of_arm,
        interval=Interval,
        undefined=NOBODY,
    )


def _met(columns: EncounterColumns, column: _Column, arm: int) -> tuple[FloatArray, FloatArray]:
    """The defined values of the episodes of an arm that met someone, and their steps."""
    met = columns.met
    values, steps = column(met.pairs)[arm], met.pairs.steps[arm]
    counted = met.ran(arm) & ~np.isnan(values)
    return values[counted], steps[counted]
