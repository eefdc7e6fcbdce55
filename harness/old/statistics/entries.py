"""An entry of a catalogue defines a reported number once; a finding is its value."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Generic, TypeVar

from harness.old.statistics.intervals import Interval, Proportion

Source = TypeVar("Source", contravariant=True)
"""The aligned columns of one cell, from which the entries of a kind of run are computed."""

Plain = float | int | str | bool | None
"""A value of a table, of JSON, and of a scenario's key."""

Reported = Interval | Plain
"""The result of an entry's computation: a value with its interval, or a value alone."""


class Form(StrEnum):
    """How a value is written."""

    NUMBER = "number"
    SHARE = "share"
    EVENTS = "events"
    """A share written as events of trials, for example 0 of 50."""
    COUNT = "count"
    FLAG = "flag"
    WORD = "word"


_LIMITS = (("_ci_low", "low", float), ("_ci_high", "high", float))
_STORED: Mapping[type[Interval] | None, tuple[tuple[str, str, type], ...]] = {
    None: (),
    Interval: _LIMITS,
    Proportion: (*_LIMITS, ("_events", "events", int), ("_n", "n", int)),
}
"""Columns of ``summary.csv`` beside a value: suffix, field of the finding, type."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A reported value with its interval, and whether the interval is reliable.

    ``n`` is the number of informative pairs behind an interval, or the number of trials behind a
    share; ``events`` is the number of events among these trials.  ``reliable`` is None if the
    value is undefined or has no interval.  ``reason`` says why the value is undefined or why the
    interval is unreliable; it is None if neither is the case.
    """

    value: Plain
    low: float | None = None
    high: float | None = None
    n: int | None = None
    events: int | None = None
    reliable: bool | None = True
    reason: str | None = None

    @property
    def number(self) -> float | None:
        """The value as a number; None if it is undefined or a word."""
        return None if self.value is None or isinstance(self.value, str) else float(self.value)

    @property
    def count(self) -> int:
        """The value of a count."""
        return int(self.number or 0)

    @property
    def half_width(self) -> float | None:
        """Half of the distance between the limits; None if there is no interval."""
        return None if self.low is None or self.high is None else (self.high - self.low) / 2


Findings = Mapping[str, Finding]
"""The findings of one cell by name, in the catalogue's order."""


@dataclass(frozen=True, slots=True)
class Entry(Generic[Source]):
    """A reported number of a cell: one of each arm, one of both arms together, or all three.

    Attributes:
        key: its name in ``summary.csv`` and in JSON, with its unit.
        heading: its name on screens and pages, without its unit.  It may hold the name of a
            threshold of conflicts in braces, see ``title``.
        meaning: its meaning, for the reference in the documentation.
        form: the form in which it is written.
        unit: empty for pure numbers; a share is written in per cent.
        digits: decimals on a screen.
        of_arm: computes the number of one arm: 0 is the AV's arm, 1 the reference's.
        paired: computes the number of both arms together, a ratio or the difference AV − reference.
        interval: the kind of interval that the numbers have; None if they have no interval.
        keys: the names of the three numbers in ``summary.csv``; a number with an empty name is not
            reported.  By default the AV's is ``key``, the reference's ``key_human`` and the paired
            one ``key_difference``, or ``key`` if no single arm has a number.
        undefined: the reason if the number is undefined.
        first_screen: whether the first screen shows it; ``--full`` shows every entry.
        may_be_absent: whether it is undefined because nothing of the kind is there, so that the
            first screen needs neither a row nor a note of it.
        crashes: whether it reports crashes.  The first screen of every sweep has these columns,
            directly after its first one.
    """

    key: str
    heading: str
    meaning: str
    form: Form = Form.NUMBER
    unit: str = ""
    digits: int = 2
    of_arm: Callable[[Source, int], Reported] | None = None
    paired: Callable[[Source], Reported] | None = None
    interval: type[Interval] | None = None
    keys: tuple[str, str, str] | None = None
    undefined: str = ""
    first_screen: bool = False
    may_be_absent: bool = False
    crashes: bool = False

    @property
    def names(self) -> tuple[str | None, str | None, str | None]:
        """The names of the AV's, the reference's and the paired number; None if it is not reported.

        >>> Entry("delay_s", "delay", "", of_arm=lambda c, arm: 1.0, paired=lambda c: 0.0).names
        ('delay_s', 'delay_s_human', 'delay_s_difference')
        >>> Entry("mu", "μ", "", paired=lambda c: 0.7).names
        (None, None, 'mu')
        """
        alone = self.key if self.of_arm is None else f"{self.key}_difference"
        av, human, paired = self.keys or (self.key, f"{self.key}_human", alone)
        return (
            (av or None) if self.of_arm else None,
            (human or None) if self.of_arm else None,
            paired if self.paired else None,
        )

    def title(self, thresholds: Mapping[str, float]) -> str:
        """The heading, with the thresholds of conflicts of a scenario.

        >>> Entry("conflict_pet", "PET below {pet_s:g} s", "").title({"pet_s": 1.5})
        'PET below 1.5 s'
        """
        return self.heading.format(**thresholds)

    def title_of(self, name: str, thresholds: Mapping[str, float]) -> str:
        """The heading of the number of that name, with its unit.

        >>> delay = Entry("delay_s", "delay", "", unit="s", of_arm=lambda c, arm: 1.0)
        >>> delay.title_of("delay_s_human", {})
        'delay of the reference, s'
        """
        paired = self.of_arm is not None and name == self.names[2]
        arm = " of the AV" if name == self.names[0] else " of the reference"
        end = ", AV − reference" if paired else arm if self.of_arm else ""
        return f"{self.title(thresholds)}{end}{self.unit and ', ' + self.unit}"

    def interval_of(self, name: str) -> type[Interval] | None:
        """The kind of interval of that number; ``Interval`` for a difference of shares."""
        difference = self.of_arm is not None and name == self.names[2]
        return Interval if difference and self.interval is Proportion else self.interval

    def columns(self) -> dict[str, type]:
        """The columns of this entry in ``summary.csv``, each with its type."""
        kind = {Form.COUNT: int, Form.FLAG: bool, Form.WORD: str}.get(self.form, float)
        columns: dict[str, type] = {}
        for name in filter(None, self.names):
            columns |= {name: kind}
            columns |= {f"{name}{end}": kind for end, _, kind in _STORED[self.interval_of(name)]}
        return columns

    def findings(self, source: Source) -> dict[str, Finding]:
        """The entry's findings by name."""
        reported: dict[str, Reported] = {}
        for arm, name in enumerate(self.names[:2]):
            if self.of_arm is not None and name is not None:
                reported[name] = self.of_arm(source, arm)
        if self.paired is not None and self.names[2] is not None:
            reported[self.names[2]] = self.paired(source)
        return {name: self.finding(value) for name, value in reported.items()}

    def finding(self, reported: Reported) -> Finding:
        """A computed value as the finding of that name."""
        if not isinstance(reported, Interval):
            return self._judged(Finding(reported))
        n = events = None
        if isinstance(reported, Proportion):
            n, events = reported.trials, reported.successes
        finding = Finding(reported.value, reported.low, reported.high, n, events)
        return self._judged(finding)

    def row(self, findings: Findings) -> dict[str, Plain]:
        """The entry's findings as columns of ``summary.csv``."""
        row: dict[str, Plain] = {}
        for name in filter(None, self.names):
            finding = findings[name]
            stored = _STORED[self.interval_of(name)]
            row |= {name: finding.value}
            row |= {f"{name}{end}": getattr(finding, field) for end, field, _ in stored}
        return row

    def from_row(self, row: Mapping[str, Any]) -> dict[str, Finding]:
        """The entry's findings from columns of ``summary.csv``; the inverse of ``row``."""
        findings = {}
        for name in filter(None, self.names):
            stored = _STORED[self.interval_of(name)]
            ends = {field: row[f"{name}{end}"] for end, field, _ in stored}
            findings[name] = self._judged(Finding(row[name], **ends))
        return findings

    def _judged(self, finding: Finding) -> Finding:
        """The finding with the reason why it is undefined or its interval is unreliable."""
        if finding.value is None:
            return replace(finding, reliable=None, reason=self.undefined or None)
        if finding.low is None:
            return replace(finding, reliable=None)
        return finding


Catalogue = Sequence[Entry[Any]]
"""The entries of a kind of run, in the order in which they are shown."""


def findings_of(
    catalogue: Catalogue, source: object, names: Collection[str] | None = None
) -> dict[str, Finding]:
    """The findings of a cell, from its columns; with ``names`` those of their entries alone."""
    return {
        name: finding
        for entry in catalogue
        if names is None or {*names} & {*entry.names}
        for name, finding in entry.findings(source).items()
    }


def columns_of(catalogue: Catalogue) -> dict[str, type]:
    """The columns of ``summary.csv`` after the varied keys, each with its type."""
    return {name: kind for entry in catalogue for name, kind in entry.columns().items()}


def row_of(catalogue: Catalogue, findings: Findings) -> dict[str, Plain]:
    """The findings of a cell as columns of ``summary.csv``."""
    return {name: value for entry in catalogue for name, value in entry.row(findings).items()}


def findings_from(catalogue: Catalogue, row: Mapping[str, Any]) -> dict[str, Finding]:
    """The findings of a cell from columns of ``summary.csv``; the inverse of ``row_of``."""
    return {name: finding for entry in catalogue for name, finding in entry.from_row(row).items()}
