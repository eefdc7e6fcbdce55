"""Compares both arms of users' own simulations by crosswalk.

Rows of ``crosswalk_means.csv`` (docs/files.md).
"""

from collections.abc import Iterable

import numpy as np
import pyarrow as pa

from harness.core.encounter import Arm
from harness.old.statistics import Interval, Plain, student_mean
from harness.old.store.schemas import CROSSWALK_FIELDS
from harness.old.store.tables import Row

_Numbers = dict[tuple[str, str], dict[int, dict[str, float | None]]]
"""The numbers by pair, for each crosswalk and arm."""


def crosswalk_rows(rows: pa.Table, confidence: float) -> list[dict[str, Plain]]:
    """For each crosswalk and number, the mean over pairs in both arms and the mean difference.

    Args:
        rows: the table ``simulations`` of a cell, by pair.
        confidence: confidence of each interval (Student's t).

    Returns:
        ``crosswalk, number, pairs, av, av_ci_low, …, human, …, difference, …, confidence``.  A pair
        in which an arm failed does not count.  A value is None if the number is defined in no pair.
    """
    whole = [row for row in rows.to_pylist() if row["reason"] is None]
    both = {row["pair"] for row in whole if row["arm"] == Arm.AV.value} & {
        row["pair"] for row in whole if row["arm"] == Arm.HUMAN.value
    }
    numbers = _numbers([row for row in whole if row["pair"] in both])
    names = dict.fromkeys(name for name, _ in numbers)
    quantities = [field for field in CROSSWALK_FIELDS if field != "crosswalk"]
    return [
        {"crosswalk": name, "number": quantity, **_statistics(numbers, name, quantity, confidence)}
        for name in names
        for quantity in quantities
    ]


def _numbers(rows: Iterable[Row]) -> _Numbers:
    numbers: _Numbers = {}
    for row in rows:
        for struct in row["crosswalks"] or ():
            numbers.setdefault((struct["crosswalk"], row["arm"]), {})[row["pair"]] = struct
    return numbers


def _statistics(numbers: _Numbers, name: str, quantity: str, confidence: float) -> dict[str, Plain]:
    arms = [
        {
            pair: value
            for pair, struct in numbers.get((name, arm.value), {}).items()
            if (value := struct[quantity]) is not None
        }
        for arm in Arm
    ]
    pairs = sorted(arms[0].keys() & arms[1].keys())
    values = [np.array([arm[pair] for pair in pairs], dtype=float) for arm in arms]
    results: dict[str, Interval] = {
        "av": student_mean(values[0], confidence).within(least=0.0),
        "human": student_mean(values[1], confidence).within(least=0.0),
        "difference": student_mean(values[0] - values[1], confidence),
    }
    row: dict[str, Plain] = {"pairs": len(pairs)}
    for label, interval in results.items():
        ends = (interval.value, interval.low, interval.high)
        row |= dict(zip((label, f"{label}_ci_low", f"{label}_ci_high"), ends, strict=True))
    return row | {"confidence": confidence}
