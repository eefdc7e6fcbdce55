"""Limits on reported numbers: parsed, and judged by one-sided bounds."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from harness.core.errors import InputError, unknown_name
from harness.statistics.entries import Finding

ONE_SIDED = 0.90
"""Confidence of two-sided intervals whose ends are one-sided 95 % bounds."""


class Shown(StrEnum):
    """What fresh pairs show of a limit."""

    SATISFIED = "satisfied"
    VIOLATED = "violated"
    NOT_SHOWN = "not shown"


@dataclass(frozen=True, slots=True)
class Limit:
    """A number of the catalogue must be below ``limit``, or above it if ``above``."""

    name: str
    limit: float
    above: bool

    def __str__(self) -> str:
        """The limit as a user writes it."""
        return f"{self.name}{'>' if self.above else '<'}{self.limit:g}"

    def excess(self, value: float) -> float:
        """By how much a value misses the limit; at most 0 if it keeps it."""
        beyond = self.limit - value if self.above else value - self.limit
        return beyond or math.ulp(0.0)

    def judged(self, finding: Finding) -> tuple[Shown, str]:
        """The verdict by the ends of an interval with confidence ``ONE_SIDED``, and its reason.

        >>> Limit("kappa", 1e-3, above=False).judged(Finding(0.0, 0.0, 9.98e-4))
        (<Shown.SATISFIED: 'satisfied'>, '')
        """
        if finding.value is None:
            return (
                Shown.NOT_SHOWN,
                f"undefined: {finding.reason}" if finding.reason else "undefined",
            )
        if finding.low is None or finding.high is None:
            return Shown.NOT_SHOWN, "there is no interval"
        if finding.reliable is False:
            return Shown.NOT_SHOWN, finding.reason or ""
        ends = (self.excess(finding.low), self.excess(finding.high))
        if max(ends) <= 0:
            return Shown.SATISFIED, ""
        return (Shown.VIOLATED, "") if min(ends) > 0 else (Shown.NOT_SHOWN, "too few pairs")


def parse_limit(text: str, names: Iterable[str], where: str) -> Limit:
    """Parse ``NAME<NUMBER`` or ``NAME>NUMBER``.

    Raises:
        InputError: the text has another form, or the name is not one of ``names``.
    """
    sign = ">" if ">" in text else "<"
    name, _, number = text.partition(sign)
    try:
        limit = float(number)
    except ValueError:
        limit = math.nan
    if not math.isfinite(limit):
        raise InputError(f"{where} {text}", "is not accepted", "NAME<NUMBER or NAME>NUMBER")
    return Limit(named(name.strip(), names, where), limit, sign == ">")


def named(name: str, names: Iterable[str], where: str) -> str:
    """A name of the catalogue.

    Raises:
        InputError: there is no such number; the message has the nearest one.
    """
    if name not in (known := sorted(names)):
        raise unknown_name(where, "number", name, known)
    return name
