"""The findings of a run: its cells' numbers, and the notes without which they mislead.

Terminal, page, JSON and CSV are views of findings; they compute nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from harness.old.statistics.entries import Catalogue, Findings, Plain


class Rank(IntEnum):
    """The subject of a note; notes are shown in this order."""

    NOTHING_TESTED = 0
    OVER_MODEL = 1
    FAILURES = 2
    TIME_OUTS = 3
    VERY_FEW_PAIRS = 4
    LEFT_OUT = 5
    UNENDED = 6
    NEARNESS = 7
    UNDEFINED = 8
    SATURATION = 9
    FALLBACK = 10
    SPEEDING = 11
    OUTSIDE_MODEL = 12
    REFERENCE = 13
    FEW_PAIRS = 14


@dataclass(frozen=True, slots=True, order=True)
class Note:
    """A sentence without which the numbers mislead."""

    rank: Rank
    text: str


@dataclass(frozen=True, slots=True)
class CellFindings:
    """The findings of one cell, with everything that screens show of it.

    ``varied`` maps the keys that a sweep varies to the cell's values.  ``av`` and ``reference``
    are the drivers' names as screens show them.  ``thresholds`` are the thresholds of conflicts,
    for ``Entry.title``.  ``notes`` are in the order of their ranks.
    """

    cell: int
    varied: Mapping[str, Plain]
    av: str
    reference: str
    pairs: int
    thresholds: Mapping[str, float]
    findings: Findings
    notes: tuple[Note, ...]


@dataclass(frozen=True, slots=True)
class RunFindings:
    """The findings of a run: its cells, and the notes about the run as a whole.

    ``catalogue`` is the catalogue of the run's kind.  ``scope`` describes the run apart from its
    pairs, for example its seed.  ``site`` describes the place, the
    flows and the share of AVs.
    ``between_avs`` is true of a comparison in which another AV takes the reference's place.
    """

    catalogue: Catalogue
    name: str
    folder: str
    scope: str
    confidence: float
    cells: tuple[CellFindings, ...]
    notes: tuple[Note, ...] = ()
    site: str = ""
    between_avs: bool = False
