"""Checks of a cell's rows."""

import numpy as np
import pyarrow as pa

from harness.core.encounter import Arm
from harness.core.errors import InputError


def check_pairs(rows: pa.Table, what: str) -> None:
    """Refuse rows of a cell unless each pair has two of them, the AV's first.

    Raises:
        InputError: an arm is missing, or rows of two runs are mixed.
    """
    arms, pairs = rows["arm"].to_pylist(), rows["pair"].to_pylist()
    count = len(arms) // 2
    whole = count > 0 and arms == [Arm.AV.value, Arm.HUMAN.value] * count
    if not whole or pairs[::2] != pairs[1::2] or len({*pairs}) != count:
        raise InputError(what, "do not have both arms of each pair of a cell", f"one run's {what}")


def known(value: float | None) -> float | None:
    """The number, or None if it is missing."""
    return None if value is None or np.isnan(value) else float(value)
