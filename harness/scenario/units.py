"""Speeds with units: a key that ends in ``_mps`` accepts "50 km/h" or a number in m/s."""

import math
import re
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

_FORM = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S+)\s*")


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


def in_si(value: Any, key: str = "") -> Any:
    """A tree of keys and values in which every speed with a unit is a number in m/s.

    Args:
        value: the tree, or a value in it.
        key: the dotted key of ``value``.

    Raises:
        InputError: the text of a key that ends in ``_mps`` is not a speed.
    """
    if isinstance(value, dict | list):
        named = value.items() if isinstance(value, dict) else enumerate(value)
        parts = {name: in_si(part, f"{key}.{name}".lstrip(".")) for name, part in named}
        return parts if isinstance(value, dict) else [*parts.values()]
    if not (isinstance(value, str) and key.endswith("_mps")):
        return value
    speed = in_metres_per_second(value)
    if speed is None:
        allowed = f"a number in m/s, or text with a unit: {', '.join(UNITS)}"
        raise InputError(key, f"{shortened(value)} is not accepted", allowed)
    return speed
