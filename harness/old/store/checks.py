"""Checks the values of every column in a table of unknown origin.

All code that reads a run relies on these checks.
"""

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.encounter import Arm, Contact, Ending, Side
from harness.core.errors import InputError
from harness.encounter.traffic.lanes import Direction
from harness.old.store.schemas import ROWS_BY_PAIR

_LARGEST, _SMALLEST = 1e18, 1e-18
"""Upper limit of times, positions and decelerations, and lower limit of divisors."""

_WORDS: Mapping[str, type[Arm | Ending | Side | Contact | Direction]] = {
    "arm": Arm,
    "ending": Ending,
    "side": Side,
    "contact": Contact,
    "direction": Direction,
}

_PLACE = ("direction", "lane")
_WHO = ("cell", "pair", "arm")
_ALWAYS: Mapping[str, tuple[str, ...]] = {
    "hours": _WHO,
    "passages": (*_WHO, "vehicle", *_PLACE, "strategy", "scheduled_s"),
    "queues": (*_WHO, "minute", *_PLACE, "mean", "longest", "let_through"),
    "episodes": (*_WHO, "strategy", "ending", "fallback", "steps", "pedestrians"),
    "pedestrians": (*_WHO, "index", "arrival_s", "side"),
    "walks": (*_WHO, "index", "arrival_s", "side"),
    "pairs": ("cell", "pair"),
    "traces": (*_WHO, "time_s", "object", "x_m", "y_m", "speed_mps"),
    "simulations": _WHO,
    "passages_over": (*_WHO, "crosswalk", "vehicle", "type", "automated", "strategy", "trigger_s"),
    "scenes_over": (*_WHO, "passage", "crosswalk", "vehicle", "begin_s", "step_s"),
    "crosswalks": (*_WHO, "crosswalk", "passages"),
}
"""Columns of each table that are never null."""

_POSITIVE = ("pass_time_s", "pass_time_ignoring_contact_s", "av_time_s", "human_time_s", "tau")
"""Columns that are divisors."""


def check_values(table: pa.Table, name: str, where: str) -> None:
    """Refuse values that a table of that name never holds.

    Args:
        table: a table with the types of its schema.
        name: the table's name.
        where: the file, for messages.

    Raises:
        InputError: a required value is null, a number is not finite, a count is negative, a word is
            unknown, or the rows are in another order than they are written in.
    """
    for column in table.column_names:
        values, at = table[column], f"{where}: {column}"
        if column in _ALWAYS[name] and values.null_count:
            raise InputError(at, "is empty in a row", "a value in each row")
        if column in _WORDS:
            known = [word.value for word in _WORDS[column]]
            for word in values.drop_null().unique().to_pylist():
                if word not in known:
                    raise InputError(at, f"{word[:40]!r}", ", ".join(known))
        if pa.types.is_floating(values.type):
            _check_range(values, _SMALLEST if column in _POSITIVE else -_LARGEST, _LARGEST, at)
        elif pa.types.is_integer(values.type):
            _check_range(values, 0, _LARGEST, at)
    _check_order(table, name, where)


def _check_range(values: pa.ChunkedArray, least: float, most: float, at: str) -> None:
    inside = pc.and_(pc.greater_equal(values, least), pc.less_equal(values, most))
    if not pc.all(inside, min_count=0).as_py():
        wrong = next(v for v in values.drop_null().to_pylist() if not least <= v <= most)
        raise InputError(at, f"{wrong!r}", f"{least:g} to {most:g}")


def _check_order(table: pa.Table, name: str, where: str) -> None:
    """Check that rows are sorted by cell and pair, and in a pair the AV's arm comes first."""
    if not table.num_rows:
        return
    cells, pairs = (table[key].to_numpy() for key in ("cell", "pair"))
    steps = np.diff(cells)
    ordered = (steps > 0) | ((steps == 0) & (np.diff(pairs) >= 0))
    if not ordered.all():
        raise InputError(f"{where}: pair", "rows are not in order", "rows sorted by cell and pair")
    if name in ROWS_BY_PAIR:
        arms = table["arm"].to_pylist()
        whole = arms == [arm.value for arm in Arm] * (len(arms) // 2)
        same = cells[::2].tolist() == cells[1::2].tolist()
        same = same and pairs[::2].tolist() == pairs[1::2].tolist()
        each = (np.diff(cells[::2]) > 0) | (np.diff(pairs[::2]) > 0)
        if not (whole and same and each.all()):
            raise InputError(
                f"{where}: arm", "does not have both arms of each pair", "av, then human"
            )
