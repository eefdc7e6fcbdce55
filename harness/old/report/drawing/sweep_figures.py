"""Figures over the cells of a sweep: measures over a varied key, one line per strategy.

Each function draws into the given axes and neither saves nor shows the figure.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.transforms import ScaledTranslation

from harness.core.encounter import FloatArray
from harness.old.report.drawing import style
from harness.old.report.drawing.style import MUTED, figure_text, finish

_WIDE = 12.0
"""The axis is logarithmic if values differ by more than this factor."""
_APART_INCH = 0.05
_LEAST_SPAN = 1e-3
"""Least height of the axes, relative to the values: rounding errors do not look like effects."""


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
    count: str | None = None,
    level: tuple[float, str] | None = None,
) -> None:
    """Draw a measure over a varied key, with intervals as bars.  Lines are shifted slightly.

    Args:
        lines: the lines, at most as many as ``style.SERIES``.
        across, up: labels with units.
        count: the number of pairs per point.
        level: a reference value, and its label.
    """
    ticks = np.unique(np.concatenate([line.x for line in lines]))
    for index, (line, look) in enumerate(zip(lines, style.SERIES, strict=False)):
        right = (index - (len(lines) - 1) / 2) * _APART_INCH
        away = ScaledTranslation(right, 0, axes.figure.dpi_scale_trans)
        reach = np.vstack((line.value - line.low, line.high - line.value)).clip(min=0)
        bars = axes.errorbar(
            line.x, line.value, yerr=reach, color=look.colour, ls=look.dash, marker=look.marker,
            ms=5, lw=1.6, elinewidth=1.1, capsize=2.5, label=figure_text(line.label),
        )  # fmt: skip
        for artist in bars.get_children():
            # The lines are shifted after plotting, so that the axes' limits follow only the data.
            artist.set_transform(axes.transData + away)
    low, high = axes.get_ylim()
    if high - low < _LEAST_SPAN * abs(high + low) / 2:
        axes.set_ylim(low - _LEAST_SPAN * abs(low), high + _LEAST_SPAN * abs(high))
    if level is not None:
        axes.axhline(level[0], color=MUTED, ls=":", lw=1.2, label=level[1])
    if ticks[0] > 0 and ticks[-1] > _WIDE * ticks[0]:
        axes.set_xscale("log")
    _tick(axes, ticks)
    finish(axes, figure_text(across), up, count)


def _tick(axes: Axes, values: FloatArray) -> None:
    """Set a tick at each value if there are only a few."""
    if len(values) <= 9:
        axes.set_xticks(values, [f"{value:g}" for value in values])
        axes.set_xticks([], minor=True)


def lines_of(rows: pd.DataFrame, x: Sequence[float], by: Sequence[str], measure: str) -> list[Line]:
    """Return one line for every value of ``by``, in order of appearance.

    Args:
        rows: rows of the summary, with ``measure``, ``measure_ci_low``, ``measure_ci_high``.
        x: the varied key's values, one for each row.
        by: the label of each row's line.
        measure: the measure's column.
    """
    columns = [f"{measure}{end}" for end in ("", "_ci_low", "_ci_high")]
    points = rows[columns].astype(float).assign(x=np.asarray(x, dtype=float))
    return [
        Line(str(label), *group.sort_values("x", kind="stable")[["x", *columns]].to_numpy().T)
        for label, group in points.groupby(np.asarray(by, dtype=object), sort=False)
    ]
