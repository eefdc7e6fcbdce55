"""One reported number: its value, its interval, and whether the interval can be trusted."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import NamedTuple

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


class Style(NamedTuple):
    """How a number is written; the unit stands in its row's or column's heading."""

    form: Form = Form.NUMBER
    digits: int = 2


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
        """Make a number that is not finite undefined."""
        numbers = (self.value, self.low, self.high, self.p)
        if not all(number is None or math.isfinite(number) for number in numbers):
            for name in ("value", "low", "high", "reliable", "p"):
                object.__setattr__(self, name, None)
            object.__setattr__(self, "reason", "it is no finite number")

    def reliable_above(self, least: int, of: str) -> "Finding":
        """The finding, unreliable and with that reason if its interval has fewer than ``least``.

        >>> Finding(1.0, 0.9, 1.1, 40, reliable=True).reliable_above(200, "pairs").reason
        'unreliable below 200 pairs (has 40)'
        """
        if self.low is None or self.n is None or self.n >= least:
            return self
        few = f"unreliable below {least:,} {of} (has {self.n:,})"
        return replace(self, reliable=False, reason=few)

    @property
    def count(self) -> int:
        """A count, or the events of a share.

        Raises:
            ValueError: it is undefined.
        """
        count = self.value if self.events is None else self.events
        if count is None:
            raise ValueError("a number that is undefined has no count")
        return int(count)


Findings = Mapping[str, Finding]
"""The findings of one cell by key, in the catalogue's order."""


def finding_to_dict(finding: Finding) -> dict[str, Plain]:
    """A finding for JSON; fields that are None are left out, except ``value``."""
    named = {field.name: getattr(finding, field.name) for field in fields(finding)}
    return {name: value for name, value in named.items() if name == "value" or value is not None}
