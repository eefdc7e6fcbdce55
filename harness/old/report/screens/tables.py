"""The tables of the terminal and the page: rows of cells, and the format of numbers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from harness.core.encounter import Arm
from harness.old.statistics import Interval
from harness.old.statistics.entries import Entry, Finding, Findings, Form, Plain
from harness.scenario import as_written


@dataclass(frozen=True)
class TableCell:
    """One cell of a table.

    ``small`` is shown under the text.  ``sort`` is the sort key of a number.  It is empty if the
    number is undefined, and None for text.
    """

    text: str
    small: str = ""
    sort: str | None = None

    @property
    def number(self) -> bool:
        """Whether the cell contains a number."""
        return self.sort is not None


@dataclass(frozen=True)
class Table:
    """A table with its identifier on the page.

    ``folded`` tables are shown on request.  The terminal shows all columns, or the columns whose
    positions ``terminal`` lists.  It prints a ``brief`` table without the small text.
    """

    name: str
    caption: str
    headings: tuple[str, ...]
    rows: tuple[tuple[TableCell, ...], ...]
    sortable: bool = False
    folded: bool = False
    terminal: tuple[int, ...] | None = None
    brief: bool = False


ARM_NAMES = {Arm.AV: "AV", Arm.HUMAN: "reference"}


def named_values(values: Mapping[str, Any]) -> str:
    """Return a scenario's keys with their values: ``ego.lane = 1, arms.av = gap_yield``."""
    return ", ".join(f"{key} = {as_written(value)}" for key, value in values.items())


def number(value: float | None, digits: int) -> str:
    """Format a number with this number of decimals."""
    return "undefined" if value is None else f"{value:z.{digits}f}"


def per_cent(share: float, decimals: int) -> str:
    """Format a share times 100 with ``decimals``, or with two digits if it is small.

    A bound of 0.0003 must not become 0.0, because no N shows that there is no risk.

    >>> per_cent(0.5, 1), per_cent(0.000003, 1), per_cent(1.6e-21, 1)
    ('50.0', '0.00030', '1.6e-19')
    """
    value = 100 * share
    if 0 < abs(value) < 1e-6:
        return f"{value:.1e}"
    if value != 0 and abs(value) < 10.0 ** (1 - decimals):
        decimals = max(decimals, 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{decimals}f}"


def level(confidence: float) -> str:
    """Format the confidence level of an interval.

    >>> level(0.95), level(1 - 0.05 / 3)
    ('95 %', '98.33 %')
    """
    return f"{100 * confidence:.4g} %"


def counted(count: int, noun: str) -> str:
    """Return a number with its noun.

    >>> counted(1, "episode"), counted(1_000, "pair")
    ('1 episode', '1,000 pairs')
    """
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def limits(interval: Interval, digits: int) -> str:
    """Format the limits of an interval; empty if there are none."""
    if interval.low is None or interval.high is None:
        return ""
    return f"{interval.low:z.{digits}f} … {interval.high:z.{digits}f}"


DASH = "–"
"""An undefined number.  A note, or the remark in its row, gives the reason."""


def entry_heading(entry: Entry[Any], thresholds: Mapping[str, float]) -> str:
    """Return the name of a reported number with its unit."""
    title = entry.title(thresholds)
    return f"{title}, {entry.unit}" if entry.unit else title


def entry_value(entry: Entry[Any], finding: Finding | None, digits: int | None = None) -> str:
    """Format a finding's value by its entry; empty if there is no finding.

    >>> crashes = Entry("kappa", "crashes", "", form=Form.EVENTS, digits=1)
    >>> entry_value(crashes, Finding(0.0, 0.0, 0.07, n=50, events=0)), entry_value(crashes, None)
    ('0 of 50', '')
    >>> entry_value(Entry("delay_s", "delay", "", unit="s"), Finding(-2.961))
    '−2.96'
    """
    if finding is None:
        return ""
    value, decimals = finding.value, entry.digits if digits is None else digits
    if value is None:
        return DASH
    if isinstance(value, str):
        return value
    if entry.form is Form.EVENTS:
        return f"{finding.events:,} of {finding.n:,}"
    if entry.form is Form.SHARE:
        return f"{_signed_per_cent(float(value), decimals)} %"
    if entry.form is Form.FLAG:
        return "yes" if value else "no"
    return _signed(value, 0 if entry.form is Form.COUNT else decimals)


def entry_limits(entry: Entry[Any], finding: Finding, digits: int | None = None) -> str:
    """Format the limits of a finding's interval (shares in per cent); empty if there are none."""
    if finding.low is None or finding.high is None:
        return ""
    decimals = entry.digits if digits is None else digits
    if entry.form not in (Form.EVENTS, Form.SHARE):
        return f"{_signed(finding.low, decimals)} … {_signed(finding.high, decimals)}"
    # A rate's lower limit far below the upper one is written as 0, which is wider.
    low = 0.0 if 0 < finding.low < 1e-3 * finding.high else finding.low
    return f"{_signed_per_cent(low, decimals)} … {_signed_per_cent(finding.high, decimals)}"


def entry_cell(entry: Entry[Any], findings: Findings, name: str | None) -> TableCell:
    """Return a finding above the limits of its interval; a star marks an unreliable interval."""
    if name is None:
        return TableCell("")
    finding, digits = findings[name], entry.digits
    digits += 1  # a table has more room than the first screen
    limits = entry_limits(entry, finding, digits)
    percent = " %" if limits and entry.form in (Form.EVENTS, Form.SHARE) else ""
    text = entry_value(entry, finding, digits) + (" *" if finding.reliable is False else "")
    sort = None if entry.form is Form.WORD else sort_key(finding.number)
    return TableCell(text, f"{limits}{percent}", sort)


def _signed(value: float, decimals: int) -> str:
    """Format a number with separators and a minus sign."""
    return f"{value:z,.{decimals}f}".replace("-", "−")


def _signed_per_cent(share: float, decimals: int) -> str:
    return per_cent(share, decimals).replace("-", "−")


def count_cell(value: int) -> TableCell:
    """Return the cell of a whole number."""
    return TableCell(f"{value:,}", sort=str(value))


def value_cell(value: Plain) -> TableCell:
    """Return the cell of a key's value; numbers, and text of numbers, are sorted as numbers."""
    text = as_written(value)
    try:
        return TableCell(text, sort=repr(float(text)))
    except ValueError:
        return TableCell(text)


def interval_cell(interval: Interval, digits: int, star: str = "") -> TableCell:
    """Return a value above the limits of its interval, with the star after the value."""
    text = number(interval.value, digits) + star
    return TableCell(text, limits(interval, digits), sort_key(interval.value))


def sort_key(value: float | None) -> str:
    """Return a number's sort key; empty if the number is undefined."""
    return "" if value is None or value != value else repr(float(value))
