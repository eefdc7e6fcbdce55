"""Figures over the cells of a sweep: measures over a varied key, one line per strategy.

Each function draws into an axes that it is given and neither saves nor shows anything.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from harness.encounter import FloatArray
from harness.report.style import (
    AV,
    GREEN,
    MUTED,
    SERIES,
    VERMILLION,
    figure_text,
    finish,
    legend_below,
)

_WIDE = 12.0
"""Values that differ by more than this factor get a logarithmic axis."""
_APART = 0.012
_MOST_TICKS = 9


@dataclass(frozen=True)
class Line:
    """One line of a sweep: values with their intervals over a varied key; NaN where undefined."""

    label: str
    x: FloatArray
    value: FloatArray
    low: FloatArray
    high: FloatArray


def draw_over(
    axes: Axes,
    lines: Sequence[Line],
    across: str,
    up: str,
    count: str,
    level: tuple[float, str] | None = None,
) -> None:
    """A measure over a varied key, with intervals as bars; lines stand a little apart.

    Args:
        axes: drawn into.
        lines: at most as many as ``style.SERIES``.
        across, up: labels with units.
        count: how many pairs a point stands for.
        level: a value to compare with, and what it is.
    """
    ticks = np.unique(np.concatenate([line.x for line in lines]))
    wide = ticks[0] > 0 and ticks[-1] > _WIDE * ticks[0]
    for index, (line, look) in enumerate(zip(lines, SERIES, strict=False)):
        away = (index - (len(lines) - 1) / 2) * _APART
        x = _shifted(line.x, away, ticks, wide)
        reach = np.vstack((line.value - line.low, line.high - line.value)).clip(min=0)
        axes.errorbar(
            x, line.value, yerr=reach, color=look.colour, ls=look.dash, marker=look.marker, ms=5,
            lw=1.6, elinewidth=1.1, capsize=2.5, label=figure_text(line.label),
        )  # fmt: skip
    if level is not None:
        axes.axhline(level[0], color=MUTED, ls=":", lw=1.2, label=level[1])
    if wide:
        axes.set_xscale("log")
    if len(ticks) <= _MOST_TICKS:
        axes.xaxis.set_major_locator(FixedLocator([float(tick) for tick in ticks]))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    finish(axes, figure_text(across), up, count)
    legend_below(axes)


def _shifted(x: FloatArray, away: float, ticks: FloatArray, wide: bool) -> FloatArray:
    """x moved by a share of the axis' length."""
    first, last = float(ticks[0]), float(ticks[-1])
    return x * (last / first) ** away if wide else x + away * (last - first)


def draw_aggressiveness(
    axes: Axes,
    line: Line,
    across: str,
    up: str,
    count: str,
    limit: tuple[float, str] | None = None,
    allowed: Sequence[float] = (),
    band: str = "95 % interval",
) -> None:
    """A measure over a strategy's aggressiveness, with its limit and the allowed interval.

    After the paper's figure of the influence of aggressiveness.

    Args:
        axes: drawn into.
        line: values with intervals, drawn as a band.
        across, up: labels with units.
        count: how many pairs a point stands for.
        limit: μ0 or κ0, and its name.
        allowed: the values swept that are allowed, shaded, neighbours together.
        band: what the line's intervals are.
    """
    order = np.argsort(line.x)
    x, value = line.x[order], line.value[order]
    axes.fill_between(
        x, line.low[order], line.high[order], color=AV.colour, alpha=0.18, lw=0,
        label=band,
    )  # fmt: skip
    axes.plot(x, value, color=AV.colour, marker="o", ms=4.5, lw=1.7, label=figure_text(line.label))
    if limit is not None:
        axes.axhline(
            limit[0], color=VERMILLION, ls="--", lw=1.3, label=f"{limit[1]} = {limit[0]:g}"
        )
    label: str | None = "allowed"
    for begin, end in _stretches(x, allowed):
        axes.axvspan(begin, end, fc=GREEN, alpha=0.14, lw=0, label=label)
        # Apart: in SVG a pattern takes the opacity of its ground.
        axes.axvspan(begin, end, fc="none", ec=GREEN, hatch="//", lw=0)
        label = None
    if len(x) <= _MOST_TICKS:
        axes.xaxis.set_major_locator(FixedLocator([float(tick) for tick in x]))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda tick, _: f"{tick:g}"))
    finish(axes, figure_text(across), up, count)
    legend_below(axes)


def _stretches(x: FloatArray, allowed: Sequence[float]) -> list[tuple[float, float]]:
    """Runs of neighbouring allowed values; one alone is widened to be seen."""
    inside = np.isin(x, np.asarray(allowed, dtype=float))
    narrow = 0.01 * float(np.ptp(x)) if len(x) > 1 else 0.5
    found: list[tuple[float, float]] = []
    begin: int | None = None
    for index, here in enumerate([*inside.tolist(), False]):
        if here and begin is None:
            begin = index
        elif not here and begin is not None:
            first, last = float(x[begin]), float(x[index - 1])
            found.append((first, last) if last > first else (first - narrow, last + narrow))
            begin = None
    return found


def lines_of(
    columns: Mapping[str, Sequence[object]], x: Sequence[float], by: Sequence[str], measure: str
) -> list[Line]:
    """One line for every value of ``by``, in order of appearance.

    Args:
        columns: of the summary: ``measure``, ``measure_ci_low``, ``measure_ci_high``.
        x: the varied key's values, one for each row.
        by: what each row belongs to.
        measure: column with its interval.
    """
    value, low, high = (
        np.asarray(columns[f"{measure}{end}"], dtype=float) for end in ("", "_ci_low", "_ci_high")
    )
    places = np.asarray(x, dtype=float)
    names = np.asarray(by, dtype=object)
    lines = []
    for name in dict.fromkeys(by):
        own = np.flatnonzero(names == name)
        own = own[np.argsort(places[own], kind="stable")]
        lines.append(Line(name, places[own], value[own], low[own], high[own]))
    return lines
