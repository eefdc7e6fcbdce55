"""Notes that qualify the numbers of a cell, derived from its scenario and findings.

Each note is one sentence.  A note does not repeat a number from the rows of the first screen.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from harness.old.statistics.entries import Entry, Finding
from harness.old.statistics.findings import Note, Rank
from harness.scenario import Scenario
from harness.strategies.registry import fallback_of

Findings = Mapping[str, Finding]
Catalogue = Sequence[Entry[Any]]

MOSTLY = 0.5
"""If the share of fallbacks is at least this, the AV's label names the fallback strategy too."""

ENDS = ("", "_human")
"""The ends of the keys of both arms."""


def av_label(strategy: str, findings: Findings) -> str:
    """Return the AV's strategy, and the fallback strategy if it drove most passages.

    >>> av_label("soft_yield", {"fallback_share": Finding(1.0)})
    'soft_yield (hard_yield in 100 %)'
    """
    share = findings["fallback_share"].number
    if share is None or share < MOSTLY:
        return strategy
    return f"{strategy} ({fallback_of(strategy.split()[0])} in {100 * share:.0f} %)"


def sentence(words: str) -> str:
    """Return the words with a capital letter and a full stop."""
    return f"{words[0].upper()}{words[1:]}."


def undefined_notes(findings: Findings, catalogue: Catalogue, scenario: Scenario) -> list[Note]:
    """Return notes with the reasons for undefined numbers on the first screen."""
    reasons: dict[str, list[str]] = {}
    for entry in catalogue:
        if not entry.first_screen or entry.may_be_absent:
            continue
        for name in filter(None, entry.names):
            finding = findings[name]
            if finding.value is None and finding.reason:
                named = short_name(entry).format(**scenario.conflicts.model_dump())
                reasons.setdefault(finding.reason, []).append(named)
    parts = [f"{_listed(names)} ({reason})" for reason, names in reasons.items()]
    return [Note(Rank.UNDEFINED, f"Undefined: {', '.join(parts)}.")] if parts else []


def short_name(entry: Entry[Any]) -> str:
    """Return a heading up to its first comma."""
    return entry.heading.partition(", ")[0]


def counted(count: int, noun: str) -> str:
    """Return a number and its noun, in the plural unless the number is 1."""
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def _listed(names: Sequence[str]) -> str:
    """Join the distinct names as ``a, b and c``."""
    *first, last = dict.fromkeys(names)
    return f"{', '.join(first)} and {last}" if first else last
