"""One reported number: its value, its interval, and whether the interval can be trusted."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from pydantic import TypeAdapter

Plain = float | int | str | bool | None
"""A value of a table, of JSON, and of a scenario's key."""


class Form(StrEnum):
    """How a value is written."""

    NUMBER = "number"
    SHARE = "share"
    """A share, written in per cent."""
    EVENTS = "events"
    """A share, written as events of trials, for example 0 of 50."""
    COUNT = "count"
    LEVEL = "level"
    """People's mean delay in s, written as the level of service of the HCM."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A reported value with its interval.

    A number that is not finite is none: the finding is undefined then.

    Attributes:
        value: None if undefined.
        low, high: the ends of the interval; None without one.
        n: the number of informative pairs behind a bootstrap's interval, or of a share's trials.
        events: the events among a share's trials.
        reliable: whether the interval has its nominal coverage; None without an interval.
        reason: why the value is undefined, has no interval, or an unreliable one; otherwise None.
        p: two-sided p-value of the paired test, where one is asked for.
    """

    value: float | int | None
    low: float | None = None
    high: float | None = None
    n: int | None = None
    events: int | None = None
    reliable: bool | None = None
    reason: str | None = None
    p: float | None = None

    def __post_init__(self) -> None:
        numbers = (self.value, self.low, self.high, self.p)
        if not all(number is None or math.isfinite(number) for number in numbers):
            for name in ("value", "low", "high", "reliable", "p"):
                object.__setattr__(self, name, None)
            object.__setattr__(self, "reason", "it is no finite number")

    @property
    def count(self) -> int:
        """A count, or the events of a share; 0 if it is undefined."""
        if self.events is not None:
            return self.events
        return 0 if self.value is None else int(self.value)


Findings = Mapping[str, Finding]
"""The findings of one cell by key, in the catalogue's order."""


def finding_to_dict(finding: Finding) -> dict[str, Plain]:
    """A finding for JSON; fields that are None are left out, except ``value``."""
    fields = asdict(finding)
    return {name: value for name, value in fields.items() if name == "value" or value is not None}


def finding_from_dict(document: Mapping[str, Any]) -> Finding:
    """The inverse of ``finding_to_dict``.

    Raises:
        ValueError: a field is missing, unknown, or of another type.
    """
    return _STORED.validate_python(document)


_STORED = TypeAdapter(Finding)
