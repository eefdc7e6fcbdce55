"""A result as a notebook shows it at once: a table and a small picture, as HTML and SVG.

Pictures to look at closely are those of ``harness.figures``.
"""

from collections.abc import Sequence
from html import escape

WIDTH, HEIGHT, _EDGE = 420, 110, 8

Point = tuple[float, float]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Okabe and Ito's."""


def html_table(caption: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as HTML; whatever a file says in it is text, not markup."""
    head = "".join(f"<th>{escape(word)}</th>" for word in headings)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(word)}</td>' for word in row)}</tr>" for row in rows
    )
    return (
        f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead>"
        f"<tbody>{body}</tbody></table>"
    )


def lines_sketch(lines: Sequence[tuple[str, Sequence[Point]]], title: str) -> str:
    """Named lines over common axes, as SVG; y begins at 0.

    Args:
        lines: each a name and its points.
        title: what the picture shows, also for people who cannot see it.
    """
    points = [point for _, line in lines for point in line]
    if not points:
        return ""
    xs = [x for x, _ in points]
    place = _Place(min(xs), max(xs), 0.0, max(y for _, y in points))
    drawn = [
        f'<polyline fill="none" stroke="{colour}" stroke-width="1.5" points="'
        + " ".join(f"{place.x(x):.1f},{place.y(y):.1f}" for x, y in line)
        + '"/>'
        for (_, line), colour in zip(lines, _colours(len(lines)), strict=True)
    ]
    names = [name for name, _ in lines]
    return _svg(drawn + _legend(names), title)


def intervals_sketch(
    intervals: Sequence[tuple[str, float | None, float | None, float | None]],
    title: str,
    mark: float,
) -> str:
    """Values with their intervals beneath each other, and a line at ``mark``, as SVG.

    Args:
        intervals: name, value, low, high; without a value it is left out.
        title: what the picture shows, also for people who cannot see it.
        mark: where a thin line stands.
    """
    known = [
        (name, value, value if low is None else low, value if high is None else high)
        for name, value, low, high in intervals
        if value is not None
    ]
    if not known:
        return ""
    place = _Place(
        min(mark, *(low for *_, low, _ in known)), max(mark, *(of[-1] for of in known)), 0.0, 1.0
    )
    step = (HEIGHT - 2 * _EDGE) / len(known)
    drawn = [_stroke(place.x(mark), 0, place.x(mark), HEIGHT, "#888888")]
    for number, (name, value, low, high) in enumerate(known):
        y = _EDGE + (number + 0.5) * step
        colour = COLOURS[number % len(COLOURS)]
        drawn.append(_stroke(place.x(low), y, place.x(high), y, colour))
        drawn.append(f'<circle cx="{place.x(value):.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>')
        drawn.append(_text(_EDGE, y - 4, name, colour))
    return _svg(drawn, title)


class _Place:
    """Where a value stands in the picture."""

    def __init__(self, left: float, right: float, bottom: float, top: float) -> None:
        self._left, self._across = left, (right - left) or 1.0
        self._bottom, self._up = bottom, (top - bottom) or 1.0

    def x(self, value: float) -> float:
        """From the left, in the picture's units."""
        return _EDGE + (WIDTH - 2 * _EDGE) * (value - self._left) / self._across

    def y(self, value: float) -> float:
        """From the top, in the picture's units."""
        return HEIGHT - _EDGE - (HEIGHT - 2 * _EDGE) * (value - self._bottom) / self._up


def _colours(count: int) -> list[str]:
    return [COLOURS[number % len(COLOURS)] for number in range(count)]


def _stroke(x1: float, y1: float, x2: float, y2: float, colour: str) -> str:
    ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {ends} stroke="{colour}" stroke-width="1"/>'


def _legend(names: Sequence[str]) -> list[str]:
    return [
        _text(_EDGE, HEIGHT - _EDGE - 12 * (len(names) - 1 - number), name, colour)
        for number, (name, colour) in enumerate(zip(names, _colours(len(names)), strict=True))
    ]


def _text(x: float, y: float, words: str, colour: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="10" fill="{colour}">{escape(words)}</text>'


def _svg(elements: Sequence[str], title: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" role="img">'
        f"<title>{escape(title)}</title>{''.join(elements)}</svg>"
    )
