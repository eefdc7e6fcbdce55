"""The texts of numbers with their intervals, on the first screen of a run."""

from collections.abc import Sequence
from typing import Any

from harness.old.report.screens.tables import (
    DASH,
    counted,
    entry_limits,
    entry_value,
    level,
    per_cent,
)
from harness.old.statistics import CONFIDENCE, Interval, zero_bound
from harness.old.statistics.entries import Entry, Finding, Form
from harness.old.statistics.findings import CellFindings, Rank
from harness.old.studies.runs.notes import short_name


def no_spread(entry: Entry[Any], both: Finding, cell: CellFindings) -> str:
    """Return why a difference has no interval: all pairs are equal, or only one defines it."""
    if entry.interval is not Interval or entry.of_arm is None or both.number is None:
        return ""
    several = cell.pairs - cell.findings["failed"].count > 1
    return " (no spread)" if several and both.low is None else ""


def with_limits(entry: Entry[Any], both: Finding) -> str:
    """Return a number of both arms with its interval."""
    value, limits = entry_value(entry, both), entry_limits(entry, both)
    return f"{value} ({limits})" if limits else value


def both_arms(
    entry: Entry[Any], av: Finding | None, reference: Finding | None, cell: CellFindings
) -> str:
    """Return both arms' intervals of a share, or the one-sided bound if neither has an event."""
    if av is None or reference is None or entry.form not in (Form.EVENTS, Form.SHARE):
        return ""
    if not tested(cell):
        return ""
    limits = [entry_limits(entry, finding) or DASH for finding in (av, reference)]
    if limits == [DASH, DASH]:
        return ""
    if entry.may_be_absent and None in (av.value, reference.value):
        return f"{next(text for text in limits if text != DASH)} %"
    if av.events == reference.events == 0 and DASH not in limits:
        high = max(av.high or 0.0, reference.high or 0.0)
        confidence = cell.findings["confidence"].number or CONFIDENCE
        bound = zero_bound(high, confidence)
        # Trials of one pair are correlated.  If this raises the bound, the text names the pairs.
        alone = 1.0 - (1.0 - confidence) ** (1.0 / max(av.n or 1, 1))
        pairs = f" ({counted(cell.pairs, 'pair')})" if bound > 1.5 * alone else ""
        return f"each below {per_cent(bound, 1)} %{pairs}"
    return f"{limits[0]} / {limits[1]} %"


def tested(cell: CellFindings) -> bool:
    return all(note.rank is not Rank.NOTHING_TESTED for note in cell.notes)


def zero_lines(entry: Entry[Any], found: Sequence[tuple[Finding, float]]) -> list[str]:
    """Return a sentence about the rate that 0 events of several trials leave open.

    Args:
        entry: the entry of the events.
        found: each tested cell's finding of one arm, with the confidence of its interval.
    """
    bounds = [
        zero_bound(each.high, confidence)
        for each, confidence in found
        if each.events == 0 and each.high and each.n != 1
    ]
    if not bounds:
        return []
    return [
        f"0 {short_name(entry)} in a tested cell: the rate is below {per_cent(max(bounds), 1)} % "
        f"({level(CONFIDENCE)} confidence)."
    ]
