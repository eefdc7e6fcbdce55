"""The results of hours of traffic by type of vehicle, for runs with a vehicle mix."""

import math
from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from harness.core.encounter import Arm
from harness.statistics import Interval, Plain, student_mean
from harness.store.tables import Row

_ENDS = {Arm.AV: "", Arm.HUMAN: "_human"}


def type_rows(hours: pa.Table, names: Sequence[str], confidence: float) -> list[dict[str, Plain]]:
    """The rows of a cell in ``types.csv``, without its keys: one for each type.

    Args:
        hours: the cell's rows of ``hours`` by pair, AV first.
        names: names of the types.
        confidence: confidence of the intervals.

    Returns:
        Counts are sums over the hours in which neither arm failed.  ``vehicle_delay_s`` is the mean
        of the hours' mean delays with Student's t interval, and ``difference_s`` is the mean of
        their paired differences, AV − reference.  They are None if no such vehicle counts.
    """
    found = zip(hours["reason"].to_pylist(), hours["types"].to_pylist(), strict=True)
    arms = [None if reason else {row["type"]: row for row in rows or ()} for reason, rows in found]
    pairs = [(av, human) for av, human in zip(arms[::2], arms[1::2], strict=True) if av and human]
    table = []
    for name in names:
        both = [(av[name], human[name]) for av, human in pairs]
        delays = np.array(
            [[_number(row["vehicle_delay_s"]) for row in each] for each in both]
        ).reshape(-1, 2)
        row: dict[str, Plain] = {
            "type": name,
            "vehicles": sum(av["vehicles"] for av, _ in both),
            "automated": sum(av["automated"] for av, _ in both),
        }
        for place, end in enumerate(_ENDS.values()):
            row |= _mean(f"vehicle_delay_s{end}", delays[:, place], confidence, least=0.0)
            row[f"not_through{end}"] = sum(each[place]["not_through"] for each in both)
        row |= _mean("difference_s", delays[:, 0] - delays[:, 1], confidence)
        table.append(row | {"confidence": confidence})
    return table


def type_numbers(
    names: Sequence[str],
    kinds: Sequence[int],
    automated: Sequence[bool],
    through: Sequence[bool],
    delays: Sequence[float] | None,
) -> list[Row]:
    """The column ``types`` of an arm in ``hours``.

    Args:
        names: names of the types.
        kinds: number of the type of each vehicle that counts.
        automated: whether ``arms.av`` drives each of these vehicles in the AV's arm.
        through: whether each of them passed.
        delays: delay of each of them in s; None with a permanent queue.
    """
    rows = []
    for number, name in enumerate(names):
        own = [place for place, kind in enumerate(kinds) if kind == number]
        known = [] if delays is None else [delays[place] for place in own]
        rows.append(
            {
                "type": name,
                "vehicles": len(own),
                "automated": sum(automated[place] for place in own),
                "not_through": sum(not through[place] for place in own),
                "vehicle_delay_s": float(np.mean(known)) if known else None,
            }
        )
    return rows


def _mean(
    name: str, values: np.ndarray, confidence: float, least: float = -math.inf
) -> dict[str, Plain]:
    defined = values[~np.isnan(values)]
    mean: Interval = student_mean(defined, confidence).within(least=least)
    return {name: mean.value, f"{name}_ci_low": mean.low, f"{name}_ci_high": mean.high}


def _number(value: float | None) -> float:
    return math.nan if value is None else value
