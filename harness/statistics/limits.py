"""Limits on reported numbers: parsed, judged by one-sided bounds, and the one that binds."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from harness.core.errors import InputError, nearest_names
from harness.statistics.entries import Catalogue, Finding, Findings, Form

ONE_SIDED = 0.90
"""Confidence of two-sided intervals whose ends are one-sided 95 % bounds."""

COUNTING_FAILURES = {
    "time_ratio_worst",
    "mu_worst",
    "delay_worst_s",
    "kappa_worst",
    "kappa_all",
}
"""The numbers that count a failure of the AV's strategy at its worst; others leave it out."""

_NEAREST = 6
"""Number of names that the refusal of an unknown one has; a catalogue has over 100."""


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


@dataclass(frozen=True, slots=True)
class JudgedLimit:
    """A limit with the number that it limits, and the verdict on it.

    ``finding`` has an interval whose ends are one-sided 95 % bounds; ``reason`` says why nothing is
    shown.
    """

    limit: Limit
    finding: Finding
    shown: Shown
    reason: str

    @property
    def bound(self) -> float | None:
        """The bound that must keep the limit; None if the number has no interval."""
        return self.finding.low if self.limit.above else self.finding.high

    @property
    def margin(self) -> float | None:
        """Distance from the bound to the limit / |limit|; below 0 if the bound misses the limit.

        None if there is no bound, or the limit is 0.

        >>> round(JudgedLimit(Limit("kappa", 0.02, above=False), Finding(0.0, 0.0, 0.015),
        ...     Shown.SATISFIED, "").margin, 6)
        0.25
        """
        if self.bound is None or not self.limit.limit:
            return None
        return -self.limit.excess(self.bound) / abs(self.limit.limit)


def judged(limit: Limit, finding: Finding) -> JudgedLimit:
    """The limit with its verdict; see ``Limit.judged``."""
    return JudgedLimit(limit, finding, *limit.judged(finding))


def all_judged(limits: Sequence[Limit], findings: Findings) -> tuple[JudgedLimit, ...]:
    """Every limit with its verdict, in order."""
    return tuple(judged(limit, findings[limit.name]) for limit in limits)


def unless_failed(limits: Sequence[JudgedLimit], failed: int) -> tuple[JudgedLimit, ...]:
    """The verdicts on limits if vehicles failed in so many pairs: then none is satisfied.

    A vehicle may fail exactly where it would crash.  The numbers of ``COUNTING_FAILURES`` stay.
    """
    if not failed:
        return tuple(limits)
    reason = f"failures in {failed:,} pair{'s' * (failed > 1)}"
    return tuple(
        replace(each, shown=Shown.NOT_SHOWN, reason=reason)
        if each.shown is Shown.SATISFIED and each.limit.name not in COUNTING_FAILURES
        else each
        for each in limits
    )


def binding(limits: Sequence[JudgedLimit]) -> JudgedLimit | None:
    """The limit that binds: of the worst verdict the one with the least margin.

    Violated is worse than not shown, which is worse than satisfied.  A limit without a margin comes
    after those with one.  Of equals the first binds.  None if there is no limit.
    """
    verdicts = [Shown.VIOLATED, Shown.NOT_SHOWN, Shown.SATISFIED]

    def order(each: JudgedLimit) -> tuple[int, bool, float]:
        return verdicts.index(each.shown), each.margin is None, each.margin or 0.0

    return min(limits, key=order, default=None)


def one_sided(confidence: float) -> float:
    """Confidence of intervals whose ends are one-sided bounds with ``confidence``.

    >>> one_sided(0.95) == ONE_SIDED
    True
    """
    return round(1 - 2 * (1 - confidence), 12)


def numbers_of(catalogue: Catalogue) -> set[str]:
    """The names of a catalogue's numbers that can be limited."""
    return {
        name
        for entry in catalogue
        if entry.form is not Form.WORD and entry.key != "confidence"
        for name in filter(None, entry.names)
    }


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
        InputError: there is no such number; the message has the nearest ones.
    """
    if name not in (known := sorted(names)):
        nearest = nearest_names(name, known, _NEAREST)
        like = f", such as {', '.join(nearest[1:])}" if nearest[1:] else ""
        raise InputError(
            where,
            f"unknown number {name!r}",
            f"a number of summary.csv{like} (list: the documentation, Reference, Columns)",
            next(iter(nearest), None),
        )
    return name
