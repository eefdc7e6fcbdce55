"""What the rows of a table may say, whoever wrote them: checked where a run folder is read.

The readers rely on it: an arm is one of two, a number is finite, a pair has a number.
"""

from enum import StrEnum

import pyarrow as pa
import pyarrow.compute as pc

from harness.encounter import Arm, Contact, Ending, Side
from harness.errors import InputError

LARGEST_NUMBER = 1e100
"""No measure of a run is larger; sums of squares would overflow."""

_WORDS: dict[str, type[StrEnum]] = {"arm": Arm, "ending": Ending, "contact": Contact, "side": Side}
_ALWAYS = {
    *("cell", "pair", "arm", "ending", "strategy", "fallback", "steps", "pedestrians"),
    *("index", "arrival_s", "side", "time_s", "object", "x_m", "y_m"),
}
"""Columns that no row leaves empty."""

_BY_ENDING = {
    Ending.CROSSED: ("pass_time_s",),
    Ending.CRASHED: ("contact", "contact_time_s", "contact_speed_mps"),
}
"""What an episode that ended so always has."""

_COUNTS = ("cell", "pair", "index", "contact_index", "steps", "pedestrians", "stops")


def check_rows(table: pa.Table, where: str) -> None:
    """Refuse rows that no run writes.

    Args:
        table: with the types of its schema.
        where: the file, for messages.

    Raises:
        InputError: a word that does not exist, a number that is not finite or is out of all
            proportion, a value missing where there always is one.
    """
    for name in table.column_names:
        column = table[name]
        if name in _ALWAYS and column.null_count:
            raise InputError(f"{where}: {name}", "a value is missing", "a value in every row")
        if name in _WORDS:
            known = [word.value for word in _WORDS[name]]
            for word in set(pc.unique(column).to_pylist()) - {*known, None}:
                raise InputError(f"{where}: {name}", f"{word!r}", ", ".join(known))
        _check_numbers(column, f"{where}: {name}", at_least=0 if name in _COUNTS else None)
    for ending, names in _BY_ENDING.items():
        _check_ending(table, ending, names, where)
    _check_walks(table, where)
    if "pass_time_s" in table.column_names and _any(pc.less_equal(table["pass_time_s"], 0)):
        raise InputError(f"{where}: pass_time_s", "a time of 0 or less", "above 0")


def _check_numbers(column: pa.ChunkedArray, where: str, at_least: int | None) -> None:
    if pa.types.is_list(column.type):
        for values in pc.list_flatten(column).combine_chunks().flatten():
            _check_numbers(values, where, None)
        return
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        return
    # NaN is on neither side of a limit.
    inside = pc.less_equal(pc.abs_checked(column), LARGEST_NUMBER)
    if not pc.all(inside, min_count=0).as_py():
        raise InputError(where, "a number that no run gives", f"up to {LARGEST_NUMBER:g}")
    if at_least is not None and _any(pc.less(column, at_least)):
        raise InputError(where, "a negative number", f"{at_least} or more")


def _check_ending(table: pa.Table, ending: Ending, names: tuple[str, ...], where: str) -> None:
    if "ending" not in table.column_names:
        return
    ended = pc.equal(table["ending"], ending.value)
    for name in names:
        if name in table.column_names and _any(pc.and_(ended, pc.is_null(table[name]))):
            raise InputError(f"{where}: {name}", f"missing where an episode {ending.value}")


def _check_walks(table: pa.Table, where: str) -> None:
    """Who has stepped off without legs of his own walks at a speed above 0."""
    if not {"start_s", "legs", "speed_mps"} <= {*table.column_names}:
        return
    straight = pc.and_(pc.is_valid(table["start_s"]), pc.is_null(table["legs"]))
    walking = pc.fill_null(pc.greater(table["speed_mps"], 0), False)
    if _any(pc.and_(straight, pc.invert(walking))):
        raise InputError(f"{where}: speed_mps", "missing or not above 0 where somebody walks")


def _any(mask: pa.ChunkedArray) -> bool:
    return bool(pc.any(mask, min_count=0).as_py())
