"""What a run reports: a catalogue of entries, and their values, the findings.

An entry defines a reported number once.  Tables of a run, terminal, page, JSON, CSV and the
reference in the documentation are views of findings, and compute nothing.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Generic, TypeVar

from harness.comparison.bootstrap import Resampled
from harness.comparison.intervals import Interval, Proportion

Source = TypeVar("Source")
"""What the entries of a kind of run are computed from: the aligned columns of one cell."""

Plain = float | int | str | bool | None
"""A value of a table, of JSON, and of a scenario's key."""

Reported = Interval | Plain
"""What an entry's computation returns: a value with its interval, or a value alone."""

ALIKE_FROM = 20
"""Pairs that met someone from which on values that are all the same are taken to be so always."""


class Form(StrEnum):
    """How a value is written."""

    NUMBER = "number"
    SHARE = "share"
    COUNT = "count"
    WORD = "word"


@dataclass(frozen=True, slots=True)
class Finding:
    """A reported value with its interval, and how far to trust it.

    ``n`` is the number of informative pairs behind an interval, or that of the trials behind a
    share, of which ``events`` were counted.  ``reason`` says why the value is undefined or why
    the interval is unreliable; it is None where neither is so.
    """

    value: Plain
    low: float | None = None
    high: float | None = None
    n: int | None = None
    events: int | None = None
    reliable: bool = True
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class Entry(Generic[Source]):
    """A reported number of a cell: of each arm, of both arms together, or of all three.

    Attributes:
        key: its name in ``summary.csv`` and in JSON, with its unit.
        heading: its name on screens and pages, without its unit.
        meaning: one sentence for the reference in the documentation.
        form: how it is written.
        unit: empty for pure numbers; a share is written in per cent.
        digits: decimals on a screen.
        of_arm: computes the number of one arm, 0 for the AV's and 1 for the reference's.
        paired: computes the number of both arms together, a ratio or the difference AV − reference.
        keys: the names of the three numbers in ``summary.csv``.  By default the AV's is ``key``,
            the reference's ``key_human`` and the paired one ``key_difference``, or ``key`` where
            there is no number of one arm.
        reliable_from: informative pairs from which on the interval covers what it says; None where
            the interval is exact.
        undefined: why it is undefined where it is.
        first_screen: whether the first screen shows it; ``--full`` shows every entry.
        paper: the value in Chen, Zhao, Peng (2017), section III-E, as it is printed there.
    """

    key: str
    heading: str
    meaning: str
    form: Form = Form.NUMBER
    unit: str = ""
    digits: int = 2
    of_arm: Callable[[Source, int], Reported] | None = None
    paired: Callable[[Source], Reported] | None = None
    keys: tuple[str, str, str] | None = None
    reliable_from: int | None = None
    undefined: str = ""
    first_screen: bool = False
    paper: str = ""

    @property
    def names(self) -> tuple[str | None, str | None, str | None]:
        """The names of the AV's, the reference's and the paired number; None where there is none.

        >>> Entry("delay_s", "delay", "", of_arm=lambda c, arm: 1.0, paired=lambda c: 0.0).names
        ('delay_s', 'delay_s_human', 'delay_s_difference')
        >>> Entry("mu", "μ", "", paired=lambda c: 0.7).names
        (None, None, 'mu')
        """
        alone = self.key if self.of_arm is None else f"{self.key}_difference"
        av, human, paired = self.keys or (self.key, f"{self.key}_human", alone)
        return (
            av if self.of_arm else None,
            human if self.of_arm else None,
            paired if self.paired else None,
        )

    def findings(self, source: Source, met_someone: int) -> dict[str, Finding]:
        """The entry's findings by name.

        Args:
            source: the columns of one cell.
            met_someone: the number of its pairs that met someone.
        """
        av, human, paired = self.names
        reported: dict[str, Reported] = {}
        if self.of_arm is not None and av is not None and human is not None:
            reported |= {av: self.of_arm(source, 0), human: self.of_arm(source, 1)}
        if self.paired is not None and paired is not None:
            reported[paired] = self.paired(source)
        return {name: self.finding(value, met_someone) for name, value in reported.items()}

    def finding(self, reported: Reported, met_someone: int) -> Finding:
        """A computed value as a finding."""
        if not isinstance(reported, Interval):
            return Finding(reported, reason=self.undefined if reported is None else None)
        n = events = None
        if isinstance(reported, Proportion):
            n, events = reported.trials, reported.successes
        elif isinstance(reported, Resampled):
            n = reported.informative
        reason = self.undefined if reported.value is None else None
        few = self._too_few(reported, met_someone)
        if few:
            reason = f"unreliable below {self.reliable_from:,} informative pairs (has {n:,})"
        return Finding(reported.value, reported.low, reported.high, n, events, not few, reason)

    def _too_few(self, interval: Interval, met_someone: int) -> bool:
        """Whether an interval rests on too few informative pairs to cover what it says.

        Where all values are the same there is nothing that the width could be too small for,
        unless hardly anybody was met.
        """
        if self.reliable_from is None or not isinstance(interval, Resampled):
            return False
        if interval.low is None:
            return False
        if interval.informative == 0:
            return met_someone < ALIKE_FROM
        return interval.informative < self.reliable_from


class Rank(IntEnum):
    """What a note is about; notes stand in this order."""

    NOTHING_TESTED = 0
    FAILURES = 1
    TIME_OUTS = 2
    LEFT_OUT = 3
    SATURATION = 4
    FALLBACK = 5
    SPEEDING = 6
    OUTSIDE_MODEL = 7
    REFERENCE = 8
    FEW_PAIRS = 9


@dataclass(frozen=True, slots=True, order=True)
class Note:
    """A sentence that has to be read with the numbers."""

    rank: Rank
    text: str


@dataclass(frozen=True, slots=True)
class CellFindings:
    """What a run reports of one cell.

    ``varied`` are the keys that a sweep varies, with the cell's values.  ``av`` and ``reference``
    are the drivers' names as screens show them.  ``findings`` are by name, in the catalogue's
    order; ``notes`` are in the order of their ranks.
    """

    cell: int
    varied: Mapping[str, Plain]
    av: str
    reference: str
    pairs: int
    findings: Mapping[str, Finding]
    notes: tuple[Note, ...]


@dataclass(frozen=True, slots=True)
class RunFindings:
    """What a run reports: its cells, and the notes about the run as a whole.

    ``scope`` says what the run consists of beside its pairs, such as its seed and its audit.
    ``paper`` says whether its only cell is the paper's experiment.
    """

    name: str
    folder: str
    scope: str
    confidence: float
    paper: bool
    cells: tuple[CellFindings, ...]
    notes: tuple[Note, ...] = ()
