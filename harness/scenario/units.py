"""Units by the ending of a key; one that ends in ``_mps`` accepts "50 km/h" or a number in m/s."""

import math
import re
from collections.abc import Mapping
from typing import Any

from harness.core.documents import shortened
from harness.core.errors import InputError

UNITS = {
    "m/s": (1.0, 1.0),
    "km/h": (1000.0, 3600.0),
    "mph": (1609.344, 3600.0),
    "ft/s": (0.3048, 1.0),
}
"""Units of speed as (metres, seconds); they are exact by definition."""

_ENDINGS = {"_mps3": "m/s³", "_mps2": "m/s²", "_mps": "m/s", "_m": "m", "_s": "s", "_deg": "°"}

_FORM = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S+)\s*")


def unit_of(name: str) -> tuple[str, str] | None:
    """The ending of a key that says its unit, and the unit; None if the name says none.

    >>> unit_of("max_deceleration_mps2"), unit_of("friction")
    (('_mps2', 'm/s²'), None)
    """
    return next((each for each in _ENDINGS.items() if name.endswith(each[0])), None)


def in_metres_per_second(text: str) -> float | None:
    """A speed that is written with its unit, in m/s; None if the text is not such a speed.

    >>> in_metres_per_second("50 km/h")
    13.88888888888889
    >>> in_metres_per_second("12 knots") is None
    True
    """
    written = _FORM.fullmatch(text)
    if written is None or written[2] not in UNITS:
        return None
    metres, seconds = UNITS[written[2]]
    speed = float(written[1]) * metres / seconds
    return speed if math.isfinite(speed) else None


def in_si(value: Any, source: str, key_sources: Mapping[str, str], key: str = "") -> Any:
    """A tree of keys and values in which every speed with a unit is a number in m/s.

    Args:
        value: the tree, or a value in it.
        source: name of the file in messages.
        key_sources: name of the source of every key that is not from the file (``--set``).
        key: the dotted key of ``value``.

    Raises:
        InputError: the text of a key that ends in ``_mps`` is not a speed.
    """
    if isinstance(value, dict):
        before = f"{key}." if key else ""
        return {
            name: in_si(part, source, key_sources, f"{before}{name}")
            for name, part in value.items()
        }
    if isinstance(value, list):
        return [in_si(part, source, key_sources, f"{key}.{i}") for i, part in enumerate(value)]
    if not (isinstance(value, str) and key.endswith("_mps")):
        return value
    speed = in_metres_per_second(value)
    if speed is None:
        where = f"{key_sources[key]} {key}" if key in key_sources else f"{source}: {key}"
        allowed = f"a number in m/s, or text with a unit: {', '.join(UNITS)}"
        raise InputError(where, f"{shortened(value)} is not accepted", allowed)
    return speed
