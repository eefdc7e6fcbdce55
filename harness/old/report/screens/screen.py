"""The first screen of every kind of result: a few rows, their notes, and a footer.

``screen_lines`` turns a ``Screen`` into text.
"""

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from harness.old.statistics.findings import Note, Rank

WIDEST = 100
"""Maximum number of columns of a line, even on a wider terminal."""

MOST_LINES = 16
"""Maximum number of lines for one result; notes that do not fit share a line."""

KEPT = "\N{NO-BREAK SPACE}"
"""Stands for a space at which a line is not broken."""

_WITHIN = re.compile(r"(?<=\S) (?=[…%])|(?<=…) ")
_GAP = "  "
_LEAST = 8
"""Columns keep at least this width; on a narrow terminal one is left out instead."""

_LEAST_OF_NAMES = 12
"""Columns of names shrink to this width before an interval is wrapped."""

_BREAKS = re.compile(r" |(?<=_)")
_NEVER_MERGED = Rank.VERY_FEW_PAIRS
_KEPT_NAMES = {
    Rank.NOTHING_TESTED: "nothing was tested",
    Rank.OVER_MODEL: "the model's fit",
    Rank.FAILURES: "failures",
    Rank.TIME_OUTS: "time-outs",
    Rank.VERY_FEW_PAIRS: "few pairs",
}
_NAMES = {
    Rank.LEFT_OUT: "what is left out",
    Rank.UNENDED: "trips that did not end",
    Rank.NEARNESS: "the reference",
    Rank.UNDEFINED: "undefined numbers",
    Rank.SATURATION: "saturation",
    Rank.FALLBACK: "the fallback",
    Rank.SPEEDING: "speeding",
    Rank.OUTSIDE_MODEL: "the model's range",
    Rank.REFERENCE: "the reference",
    Rank.FEW_PAIRS: "unreliable intervals (few pairs)",
}


@dataclass(frozen=True, slots=True)
class Screen:
    """The first screen of a result, as text in rows.

    Attributes:
        title: the compared strategies.
        scope: the amount of simulation, shown to the right of the title.
        headings: headings of the columns.  The first column names the rows.
        rows: one text for each column; the last text of a shorter row may fill the line.
        notes: notes in the order of their ranks.
        footer: where the other numbers are.
        site: site and traffic, in a line below the title.
        conclusions: sentences between the rows and the notes.
        aside: whether the last column moves below the rows on a narrow terminal.  Otherwise the
            last columns that do not fit are left out.
        always: number of first columns that are never left out; if even these do not fit, their
            texts are wrapped.
        most_lines: maximum number of lines; None for no limit.
    """

    title: str
    scope: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[Note, ...]
    footer: str
    site: str = ""
    conclusions: tuple[str, ...] = ()
    aside: bool = False
    always: int = 1
    most_lines: int | None = MOST_LINES


def screen_lines(screen: Screen, width: int = WIDEST) -> list[str]:
    """Return the lines of a screen.  Only the footer may be longer than ``width``.

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
    head += [line for text in screen.conclusions for line in wrapped(text, width)]
    room = None if screen.most_lines is None else screen.most_lines - len(head) - 1
    # A folder's path stays whole, so that it can be copied.
    return [*head, *_note_lines(screen.notes, width, room), screen.footer]


def wrapped(text: str, width: int, indent: str = "", *, break_long_words: bool = True) -> list[str]:
    """Wrap a text, but not within an interval, before its sign % or at ``KEPT``.

    >>> wrapped("below 1.5 s 0 … 33 %", 16)
    ['below 1.5 s', '0 … 33 %']
    """
    lines = textwrap.wrap(
        _WITHIN.sub(KEPT, text),
        width,
        subsequent_indent=indent,
        break_long_words=break_long_words,
        break_on_hyphens=False,
    )
    return [line.replace(KEPT, " ") for line in lines]


def _head(screen: Screen, width: int) -> list[str]:
    gap = width - len(screen.title) - len(screen.scope)
    if gap >= len(_GAP):
        parts = [f"{screen.title}{' ' * gap}{screen.scope}".rstrip()]
    else:
        parts = [screen.title, screen.scope]
    return [line for part in (*parts, screen.site) for line in wrapped(part, width)]


def _rows(screen: Screen, width: int) -> list[str]:
    """Return headings and rows; columns that do not fit are shown or only named below them."""
    whole = [row for row in screen.rows if len(row) == len(screen.headings)]
    sizes = [max(map(len, column)) for column in zip(*whole, strict=True)] if whole else []
    sizes = sizes or [0] * len(screen.headings)
    widths = [max(size, len(text)) for size, text in zip(sizes, screen.headings, strict=True)]
    if _width(widths) > width and not screen.aside:
        words = (max(map(len, _BREAKS.split(text))) for text in screen.headings)
        widths = [max(size, word) for size, word in zip(sizes, words, strict=True)]
    shown = len(widths)
    while shown > screen.always and _width(widths[:shown]) > width:
        shown -= 1
    intervals = {place for row in whole for place, text in enumerate(row) if "…" in text}
    while _width(widths[:shown]) > width and max(widths[:shown]) > _LEAST:
        wide = [at for at in range(shown) if at not in intervals and widths[at] > _LEAST_OF_NAMES]
        widths[max(wide or [*range(shown)], key=widths.__getitem__)] -= 1
    last = [(row[0], row[-1]) for row in whole if row[-1]]
    if screen.aside and not last:
        shown = min(shown, len(widths) - 1)
    lines = _side_by_side(screen.headings[:shown], widths, bottom=True)
    for row in screen.rows:
        if len(row) == len(widths):
            lines += _side_by_side(row[:shown], widths)
            continue
        indent = " " * (widths[0] + len(_GAP))
        cells = [text.ljust(size) for text, size in zip(row, widths, strict=False)]
        lines += wrapped(_GAP.join(cells), width, indent)
    if shown < len(widths) and screen.aside:
        values = ", ".join(f"{name.split(', ')[0]} {value}" for name, value in last)
        lines += wrapped(f"{screen.headings[-1]}: {values}", width) if last else []
    elif shown < len(widths):
        names = "; ".join(screen.headings[shown:])
        lines += wrapped(f"Not shown here: {names}.", width)
    return [line.rstrip() for line in lines]


def _width(widths: Sequence[int]) -> int:
    return sum(widths) + len(_GAP) * (len(widths) - 1)


def _side_by_side(
    texts: Sequence[str], widths: Sequence[int], *, bottom: bool = False
) -> list[str]:
    """Return texts in columns, wrapped to their widths; ``bottom`` aligns the last lines."""
    columns = [
        [text]
        if len(text) <= size
        # A key may be wrapped after its underscores.
        else [
            line.replace("_ ", "_")
            for line in textwrap.wrap(text.replace("_", "_ "), size, break_on_hyphens=False)
        ]
        for text, size in zip(texts, widths, strict=False)
    ]
    height = max(1, *map(len, columns))
    for place, column in enumerate(columns):
        rest = [""] * (height - len(column))
        columns[place] = [*rest, *column] if bottom else [*column, *rest]
    return [
        _GAP.join(text.ljust(size) for text, size in zip(line, widths, strict=False))
        for line in zip(*columns, strict=True)
    ]


def _note_lines(notes: Sequence[Note], width: int, room: int | None) -> list[str]:
    """Return the lines of the notes; the last notes share a line if they do not fit."""

    def lines_of(notes: Sequence[Note]) -> list[str]:
        return [line for note in notes for line in wrapped(f"! {note.text}", width, "  ")]

    lines = lines_of(notes)
    if room is None or len(lines) <= room:
        return lines
    kept = [note for note in notes if note.rank <= _NEVER_MERGED]
    for shown in range(len(notes) - 1, len(kept) - 1, -1):
        names = dict.fromkeys(_NAMES[note.rank] for note in notes[shown:])
        rest = Note(Rank.FEW_PAIRS, f"More to know (--full): {', '.join(names)}.")
        lines = lines_of([*notes[:shown], rest])
        if len(lines) <= room:
            return lines
    more = [rest] if kept != [*notes] else []
    return lines_of([*_by_rank(kept), *more])


def _by_rank(notes: Sequence[Note]) -> list[Note]:
    """Return each rank's first note, and a note that names the cells of its other notes."""
    short = []
    for rank in dict.fromkeys(note.rank for note in notes):
        first, *others = (note for note in notes if note.rank is rank)
        short.append(first)
        if cells := [
            name for note in others for name in re.findall(r"^Cells? ([^:]*):", note.text)
        ]:
            text = f"Cells {', '.join(cells)}: {_KEPT_NAMES.get(rank, 'likewise')} (--full)."
            others = [Note(rank, text)]
        short += others
    return short
