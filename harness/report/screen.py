"""First screen: a few rows, what has to be read with them, and where everything else is.

A ``Screen`` is what every kind of result shows first; ``screen_lines`` makes text of it.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from harness.comparison.findings import Note, Rank

WIDEST = 100
"""Columns of a line, however wide the terminal is."""

MOST_LINES = 16
"""Lines of the screen of one result; notes that do not fit are named together."""

_GAP = "  "
_NEVER_MERGED = Rank.UNDEFINED
_NAMES = {
    Rank.SATURATION: "saturation",
    Rank.FALLBACK: "the fallback",
    Rank.SPEEDING: "speeding",
    Rank.OUTSIDE_MODEL: "the model's range",
    Rank.REFERENCE: "the reference",
    Rank.FEW_PAIRS: "few pairs",
}


@dataclass(frozen=True, slots=True)
class Screen:
    """The first screen of a result, as text in rows.

    Attributes:
        title: what was compared with what.
        scope: how much was simulated; it stands at the right of the title.
        headings: of the columns, the first of which names the rows.
        rows: as many texts as there are columns; the last text of a shorter row may run on.
        notes: in the order of their ranks.
        footer: where everything else is.
        aside: whether the last column goes below the rows where the terminal is narrow.
            Otherwise as many of the last columns are left out as do not fit.
        most_lines: None for a result whose rows have no limit.
    """

    title: str
    scope: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[Note, ...]
    footer: str
    aside: bool = False
    most_lines: int | None = MOST_LINES


def screen_lines(screen: Screen, width: int = WIDEST) -> list[str]:
    """The lines of a screen, none of which is longer than ``width``.

    >>> screen = Screen(
    ...     "a against b", "2 pairs", ("", "AV"), (("delay, s", "1.5"),),
    ...     (Note(Rank.FAILURES, "1 of 2 pairs failed."),), "All measures: --full.",
    ... )
    >>> print("\\n".join(screen_lines(screen, 40)))
    a against b                      2 pairs
              AV
    delay, s  1.5
    ! 1 of 2 pairs failed.
    All measures: --full.
    """
    width = min(width, WIDEST)
    head = _head(screen, width) + _rows(screen, width)
    footer = textwrap.wrap(screen.footer, width, break_long_words=False, break_on_hyphens=False)
    room = None if screen.most_lines is None else screen.most_lines - len(head) - len(footer)
    return [*head, *_note_lines(screen.notes, width, room), *footer]


def _head(screen: Screen, width: int) -> list[str]:
    gap = width - len(screen.title) - len(screen.scope)
    if gap >= len(_GAP):
        return [f"{screen.title}{' ' * gap}{screen.scope}".rstrip()]
    parts = (screen.title, screen.scope)
    return [line for part in parts for line in textwrap.wrap(part, width)]


def _rows(screen: Screen, width: int) -> list[str]:
    """The headings and rows, cut to the columns that fit; the last column below if it is aside."""
    table = [screen.headings, *screen.rows]
    whole = [row for row in table if len(row) == len(screen.headings)]
    widths = [max(map(len, column)) for column in zip(*whole, strict=True)]
    shown = len(widths)
    while shown > 1 and sum(widths[:shown]) + len(_GAP) * (shown - 1) > width:
        shown -= 1
    if screen.aside and not any(row[-1] for row in whole[1:]):
        shown = min(shown, len(widths) - 1)
    lines = []
    for row in table:
        cells = [text.ljust(size) for text, size in zip(row[:shown], widths, strict=False)]
        indent = " " * (widths[0] + len(_GAP)) if len(row) < len(widths) else "  "
        lines += textwrap.wrap(
            _GAP.join(cells),
            width,
            subsequent_indent=indent,
            replace_whitespace=False,
            drop_whitespace=True,
        )
    if screen.aside and shown < len(widths):
        asides = [f"{row[0].split(',')[0]} {row[-1]}" for row in whole[1:] if row[-1]]
        if asides:
            lines.append(f"{screen.headings[-1]}: {', '.join(asides)}")
    return [line.rstrip() for line in lines]


def _note_lines(notes: Sequence[Note], width: int, room: int | None) -> list[str]:
    """A line or more for each note; the last notes share one where they do not fit."""
    wrapped = [textwrap.wrap(f"! {note.text}", width, subsequent_indent="  ") for note in notes]
    shown = len(notes)
    if room is not None and sum(map(len, wrapped)) > room:
        while shown and notes[shown - 1].rank > _NEVER_MERGED:
            shown -= 1
            if sum(map(len, wrapped[:shown])) < room:
                break
    lines = [line for note in wrapped[:shown] for line in note]
    if shown < len(notes):
        names = dict.fromkeys(_NAMES[note.rank] for note in notes[shown:])
        lines.append(f"! More to know, shown by --full: {', '.join(names)}.")
    return lines
