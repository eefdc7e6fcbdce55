"""Tables on a terminal: which columns have intervals, and which move below others."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress
from typing import Literal, NamedTuple

from rich.cells import cell_len
from rich.table import Table as RichTable
from rich.text import Text

from harness.report import words
from harness.report.words import numbers_of, text_and_ends
from harness.results.estimators import CONFIDENCE
from harness.results.result import Entered, Shown

_MOST_BOUNDS = 3
"""One-sided bounds at 0 events that the line below a table names."""
_BETWEEN = 2
"""Characters between two columns."""
_LEAST_OF_TEXTS = 20
"""Texts in a column are not wrapped to less than this width before columns move below others."""


_Wrapped = Literal["nothing", "headings", "long texts"]
"""What is wrapped: with long texts also headings."""


@dataclass(frozen=True)
class TextColumn:
    """A column of a table; ``confidence`` is that of its intervals; ``kept``: always shown."""

    heading: str
    cells: tuple[Entered, ...]
    confidence: float
    kept: bool = False

    @cached_property
    def parts(self) -> list[tuple[str, str]]:
        """The text of each cell, and that of its interval."""
        return [text_and_ends(cell, self.confidence) for cell in self.cells]

    @cached_property
    def numbers(self) -> list[Shown]:
        """The numbers of all its cells; none if it names rows."""
        return [number for cell in self.cells for number in numbers_of(cell)]

    def texts(self, gap: str) -> list[str]:
        """The text of each cell: its interval follows after the gap, if there is one."""
        return [f"{value}{gap}({ends})" if gap and ends else value for value, ends in self.parts]

    @cached_property
    def _widest(self) -> dict[str, int]:
        texts = {gap: "\n".join(self.texts(gap)) for gap in ("", " ", "\n")}
        return {gap: max(map(cell_len, text.split("\n"))) for gap, text in texts.items()}

    def width(self, gap: str, wrapped: _Wrapped) -> int:
        """The width that it needs in a layout."""
        if wrapped == "nothing":
            return max(self._widest[gap], cell_len(self.heading))
        parts = self.heading.replace("_", "_ ").split()
        width = max([self._widest[gap], *map(cell_len, parts)])
        long = wrapped == "long texts" and not self.numbers and width > _LEAST_OF_TEXTS
        return _LEAST_OF_TEXTS if long else width


class _Layout(NamedTuple):
    """How columns are drawn: what stands before their intervals (empty: none), and wrapping."""

    gaps: tuple[str, ...]
    wrapped: _Wrapped


Block = tuple[Sequence[TextColumn], _Layout]


def blocks_of(columns: Sequence[TextColumn], every: bool, room: int) -> Iterator[Block]:
    """Yield columns with their layout; if they are too wide, in several tables.

    Each of them begins with the columns that name the rows.  If a single number does not fit beside
    these, Rich folds them.
    """
    names = next((at for at, column in enumerate(columns) if column.numbers), len(columns))
    fewest = min(names + 1, len(columns))
    for cut in range(len(columns), fewest - 1, -1):
        part, rest = columns[:cut], columns[cut:]
        layouts = list(_layouts(part, every))
        fitting = (each for each in layouts if _width(part, each) <= room)
        layout = next(fitting, layouts[-1]._replace(wrapped="nothing") if cut == fewest else None)
        if layout is not None:
            yield part, layout
            if rest:
                told = [any(texts) for texts in zip(*(one.texts("") for one in rest), strict=True)]
                below = [
                    replace(column, cells=tuple(compress(column.cells, told)))
                    for column in (*columns[:names], *rest)
                ]
                yield from blocks_of(below, every, room)
            return


def _width(columns: Sequence[TextColumn], layout: _Layout) -> int:
    widths = (one.width(gap, layout.wrapped) for one, gap in zip(columns, layout.gaps, strict=True))
    return sum(widths) + _BETWEEN * (len(columns) - 1)


def _layouts(columns: Sequence[TextColumn], every: bool) -> Iterator[_Layout]:
    """Yield layouts, the richest first; ``every``: with all intervals."""
    order = _interval_columns(columns)

    def gaps(count: int, gap: str = " ") -> tuple[str, ...]:
        return tuple(gap if place in order[:count] else "" for place in range(len(columns)))

    whole: tuple[_Wrapped, ...] = ("nothing", "headings")
    last: tuple[_Wrapped, ...] = ("headings", "long texts")
    if every:
        yield from (_Layout(gaps(len(order)), wrapped) for wrapped in whole)
        yield from (_Layout(gaps(len(order), "\n"), wrapped) for wrapped in last)
        return
    least = sum(columns[place].kept for place in order)
    for count in range(len(order), least, -1):
        yield from (_Layout(gaps(count), wrapped) for wrapped in whole)
    yield from (_Layout(gaps(least), wrapped) for wrapped in ("nothing", *last))


def _interval_columns(columns: Sequence[TextColumn]) -> list[int]:
    """The columns with intervals: those that keep them, with one number, with both arms'."""
    places = [at for at, column in enumerate(columns) if any(ends for _, ends in column.parts)]
    both = {at: len(columns[at].numbers) > len(columns[at].cells) for at in places}
    return sorted(places, key=lambda at: (not columns[at].kept, both[at]))


def drawn(columns: Sequence[TextColumn], layout: _Layout) -> RichTable:
    """A table with the columns as a layout has them."""
    table = RichTable(box=None, padding=(0, _BETWEEN, 0, 0), pad_edge=False)
    for column, gap in zip(columns, layout.gaps, strict=True):
        heading, width, least = column.heading, None, None
        if layout.wrapped != "nothing":
            heading, width = heading.replace("_", "_\n"), column.width(gap, layout.wrapped)
            # Rich narrows the widest columns first, so only long texts may become narrower.
            if width < column.width(gap, "headings"):
                width, least = None, width
        table.add_column(
            Text(heading), overflow="fold", vertical="bottom", width=width, min_width=least
        )
    texts = (column.texts(gap) for column, gap in zip(columns, layout.gaps, strict=True))
    for row in zip(*texts, strict=True):
        table.add_row(*map(Text, row))
    return table


def bounds_of(blocks: Sequence[Block]) -> list[str]:
    """Return a line on what 0 events leave open, if no cell has room for it."""
    said: dict[bool, dict[str, float]] = {True: {}, False: {}}
    for columns, layout in blocks:
        for column, gap in zip(columns, layout.gaps, strict=True):
            for number in filter(words.is_bound, column.numbers):
                bound, high = words.interval_text(number, column.confidence), number.finding.high
                if bound and high is not None:
                    said[bool(gap)][f"{words.value_text(number)}: {bound}"] = high
    left = {text: high for text, high in said[False].items() if text not in said[True]}
    texts = sorted(left, key=left.__getitem__, reverse=True)
    if not texts:
        return []
    return [f"{'; '.join(texts[:_MOST_BOUNDS])} ({words.level_text(CONFIDENCE)}, one-sided)."]
