"""The figures of runs: functions that draw numbers into axes.

>>> from matplotlib.figure import Figure
>>> axes = Figure().subplots()
>>> draw_running_mean(axes, [0.7, 0.8, 0.9], paper=0.7044)
>>> axes.get_xlabel()
'number of pairs n'
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation
from numpy.typing import ArrayLike
from scipy import special

from harness.core.vocabulary import Arm, FloatArray, IntArray
from harness.report import style
from harness.report.style import ARM_LOOKS, AV, SERIES, figure_text, finish
from harness.report.words import counted_noun, level_text
from harness.results.estimators import CONFIDENCE
from harness.results.finding import Finding

Points = Sequence[tuple[float, Finding]]
"""Places on the x axis with the findings there."""

_MOST_MEANS = 400
"""Points of the curve of means, evenly among the pairs."""
_MOST_DOTS = 1_000
"""Up to so many pairs have a dot each; of more, the band alone sets the height of the axes."""
_FIRST_BAND, _SETTLED = 5, 30
"""Pairs from which on the band is drawn, and from which on it sets the height of the axes."""
_MOST_NAMED = 12
"""Crosswalks of a map that have their names."""
_WIDE = 12.0
"""An axis is logarithmic if its values differ by more than this factor."""
_APART_INCH, _APART = 0.05, 0.16
"""Distance of two lines' points, in inch; half the distance of two arms' dots, in rows."""
_LEAST_SPAN = 1e-3
"""Least height of axes, relative to the values: rounding errors must not look like effects."""


def draw_running_mean(
    axes: Axes, tau: ArrayLike, paper: float | None = None, driver: str = "reference"
) -> None:
    """Draw τ of each pair, and the mean of the first n over n with its Student's t band.

    Args:
        axes: where to draw.
        tau: shape (n,), in the order of the pairs; NaN (undefined) is left out.
        paper: the paper's mean, drawn as a line.
        driver: the name of the reference.
    """
    values = _defined(tau)
    total = len(values)
    ns = np.arange(1, total + 1)
    if 0 < total <= _MOST_DOTS:
        axes.plot(
            ns, values, ".", color=style.MUTED, ms=3.5, alpha=0.6, label="τ of one pair", zorder=1
        )
    mean, half = running_mean(values)
    low, high = mean - half, mean + half
    kept = np.unique(np.linspace(0, total - 1, min(total, _MOST_MEANS)).astype(int))
    axes.plot(ns[kept], mean[kept], color=AV.colour, lw=1.8, label="mean of the first n")
    band = kept[kept >= _FIRST_BAND - 1]
    if len(band):
        axes.fill_between(
            ns[band], low[band], high[band], color=AV.colour, alpha=0.18, lw=0,
            label=f"its {level_text(CONFIDENCE)} band",
        )  # fmt: skip
    if paper is not None:
        axes.axhline(paper, color=style.VERMILLION, ls="--", lw=1.2, label=f"paper: {paper:g}")
    axes.set_xlim(0, max(total, 1) * 1.01)
    if total > _MOST_DOTS:
        # Otherwise the first means, from few pairs, would determine the scale.
        ends = [low[_SETTLED:].min(), high[_SETTLED:].max(), paper or high[-1]]
        room = 0.08 * (max(ends) - min(ends))
        axes.set_ylim(min(ends) - room, max(ends) + room)
    finish(axes, "number of pairs n", f"τ = AV time / {driver} time", f"n = {total:,}")


def running_mean(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The mean of the first n values and its Student's t half-width, for every n.

    The half-width is NaN for n = 1.
    """
    n = np.arange(1, len(values) + 1)
    mean = np.cumsum(values) / n
    # The values are shifted, so that sum of squares and squared sum do not cancel.
    shifted = values - (values[0] if len(values) else 0.0)
    squares, sums = np.cumsum(shifted**2), np.cumsum(shifted)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.maximum(squares - sums**2 / n, 0.0) / (n - 1)
        t = special.stdtrit((n - 1).astype(float), (1 + CONFIDENCE) / 2)
        half = np.asarray(t * np.sqrt(variance / n), dtype=float)
    half[:1] = np.nan
    return mean, half


def draw_tau(
    axes: Axes,
    tau: ArrayLike,
    mu: Finding | None = None,
    driver: str = "reference",
    fallback: ArrayLike | None = None,
) -> None:
    """Draw a histogram of τ.

    Args:
        axes: where to draw.
        tau: shape (n,); NaN (undefined) is left out.
        mu: the mean with its interval, drawn as a line and a band.
        driver: the name of the reference.
        fallback: shape (n,), whether the AV's strategy fell back on another one; these are hatched.
    """
    values = np.asarray(tau, dtype=float)
    fell = np.zeros(len(values), bool) if fallback is None else np.asarray(fallback, dtype=bool)
    fell, values = fell[~np.isnan(values)], _defined(values)
    if len(values):
        edges, beyond = _edges(values)
        inside = np.minimum(values, edges[-1])
        kept, hatched = (np.histogram(inside[chosen], edges)[0] for chosen in (~fell, fell))
        at, widths = edges[:-1], np.diff(edges)
        look: dict[str, Any] = {"align": "edge", "ec": style.INK, "lw": 0.5}
        label = "without fallback" if fell.any() else None
        axes.bar(at, kept, widths, color=AV.colour, alpha=0.55, label=label, **look)
        if fell.any():
            look |= {"fc": "none", "ec": style.VERMILLION, "hatch": "////"}
            some = hatched > 0
            axes.bar(
                at[some], hatched[some], widths[some], bottom=kept[some],
                label="the AV fell back", **look,
            )  # fmt: skip
        _cut_spike(axes, edges, kept + hatched)
        if beyond:
            axes.plot([], [], " ", label=f"last bar: {beyond:,} pairs up to τ = {values.max():.3g}")
    if mu is not None and mu.value is not None:
        star = "*" if mu.reliable is False else ""
        label = f"μ = {mu.value:.3f}{star}"
        axes.axvline(mu.value, color=style.GREEN, lw=1.8, ls="-.", label=label)
        if mu.low is not None and mu.high is not None:
            axes.axvspan(mu.low, mu.high, color=style.GREEN, alpha=0.2, lw=0, label="its interval")
    axes.axvline(1.0, color=style.MUTED, lw=1.0, ls=":", label=f"as fast as {driver}")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    finish(axes, f"τ = AV time / {driver} time", "pairs", f"n = {len(values):,}")


def draw_over(
    axes: Axes,
    lines: Mapping[str, Points],
    across: str,
    up: str,
    count: str = "",
    level: tuple[float, str] | None = None,
    scale: float = 1.0,
) -> None:
    """Draw findings over a key, with their intervals as bars; lines are a little apart.

    Args:
        axes: where to draw.
        lines: the points of each line by its label; at most as many lines as ``style.SERIES``.
        across, up: labels with units.
        count: the number of pairs.
        level: a value to compare with, and its name.
        scale: 100 for shares that are drawn in per cent.
    """
    for index, ((label, points), look) in enumerate(zip(lines.items(), SERIES, strict=False)):
        right = (index - (len(lines) - 1) / 2) * _APART_INCH
        away = ScaledTranslation(right, 0, axes.figure.dpi_scale_trans)
        x, value, reach = _reach(points, scale)
        bars = axes.errorbar(
            x, value, yerr=reach, color=look.colour, ls=look.dash, marker=look.marker, ms=5, lw=1.6,
            elinewidth=1.1, capsize=2.5, label=figure_text(label),
        )  # fmt: skip
        for artist in bars.get_children():
            # Lines are shifted after plotting, so that the axes' limits follow only the data.
            artist.set_transform(axes.transData + away)
        _star(axes, x, value, [one for _, one in points])
    low, high = axes.get_ylim()
    if high - low < _LEAST_SPAN * abs(high + low) / 2:
        axes.set_ylim(low - _LEAST_SPAN * abs(low), high + _LEAST_SPAN * abs(high))
    if level is not None:
        axes.axhline(level[0], color=style.MUTED, ls=":", lw=1.2, label=level[1])
    ticks = np.unique([x for points in lines.values() for x, _ in points])
    if ticks[0] > 0 and ticks[-1] > _WIDE * ticks[0]:
        axes.set_xscale("log")
    _tick(axes, ticks)
    finish(axes, across, up, count)


def draw_limit(
    axes: Axes, points: Points, across: str, up: str, limit: float, allowed: Sequence[bool]
) -> None:
    """Draw μ or κ over a strategy's parameter with its limit, as the paper's figure does.

    Args:
        axes: where to draw.
        points: the findings over the parameter, with their intervals as bars.
        across: label of the parameter with its unit.
        up: ``μ`` or ``κ``.
        limit: μ0 or κ0.
        allowed: whether the value of each point is allowed; these have a square around them.
    """
    x, value, reach = _reach(points, 1.0)
    axes.errorbar(
        x, value, reach, color=AV.colour, marker="o", ms=4.5, lw=1.7, elinewidth=1.1, capsize=2.5,
        label="bounds for all values together",
    )  # fmt: skip
    axes.axhline(limit, color=style.VERMILLION, ls="--", lw=1.3, label=f"{up}0 = {limit:g}")
    _star(axes, x, value, [one for _, one in points])
    if any(allowed):
        at = np.asarray(allowed, dtype=bool)
        axes.plot(x[at], value[at], "s", ms=10, mfc="none", mec=style.GREEN, label="allowed")
    _tick(axes, x)
    finish(axes, across, up)


def draw_cells(
    axes: Axes,
    names: Sequence[str],
    arms: Mapping[Arm, Sequence[Finding]],
    across: str,
    scale: float = 1.0,
) -> None:
    """Draw each cell's number of one or both arms with its interval; undefined ones have no dot.

    Args:
        axes: where to draw.
        names: the names of the cells, from top to bottom.
        arms: the findings of each arm, one for each cell.
        across: label of the number with its unit.
        scale: 100 for shares that are drawn in per cent.
    """
    for index, (arm, findings) in enumerate(arms.items()):
        look, away = ARM_LOOKS[arm], (index - (len(arms) - 1) / 2) * 2 * _APART
        up, value, reach = _reach([(at + away, one) for at, one in enumerate(findings)], scale)
        axes.errorbar(
            value, up, xerr=reach, color=look.colour, ls="none", marker=look.marker, ms=5.5,
            elinewidth=1.2, capsize=2.5, label="AV" if arm is Arm.AV else "reference",
        )  # fmt: skip
        _star(axes, value, up, findings)
    axes.set_yticks(range(len(names)), [figure_text(name) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    finish(axes, across, "")


def draw_map(
    axes: Axes,
    roads: Sequence[ArrayLike],
    places: Mapping[str, tuple[float, float]],
    sizes: Mapping[str, float | None],
    slower: Mapping[str, Finding],
) -> None:
    """Draw a network with its crosswalks.

    Args:
        axes: where to draw.
        roads: the shape (n, 2) of each road.
        places: x and y of each crosswalk.
        sizes: a number ≥ 0 of each, which the area of its mark stands for; undefined ones are
            hollow.
        slower: a difference of each, whose interval's sign its colour and marker stand for.
    """
    for road in roads:
        axes.plot(*np.asarray(road, dtype=float)[:, :2].T, color=style.GRID, lw=1.2, zorder=1)
    largest = max((size for size in sizes.values() if size is not None), default=0.0)
    looks = {"longer delay": style.HUMAN, "shorter delay": SERIES[2], "no clear difference": AV}
    for words, look in looks.items():
        if not (names := [name for name in places if _sign(slower[name]) == words]):
            continue
        known, at = [sizes[name] for name in names], np.array([places[name] for name in names])
        axes.scatter(
            at[:, 0], at[:, 1],
            [30.0 + (300.0 * size / largest if size else 0.0) for size in known],
            facecolors=["none" if size is None else look.colour for size in known],
            edgecolors=look.colour, marker=look.marker, alpha=0.75, label=words, zorder=2,
        )  # fmt: skip
    for name, (x_m, y_m) in [*places.items()][:_MOST_NAMED]:
        axes.annotate(figure_text(name), (x_m, y_m), (6, 4), textcoords="offset points", fontsize=8)
    axes.set_aspect("equal", adjustable="datalim")
    finish(axes, "x (m)", "y (m)", counted_noun(len(places), "crosswalk"))


def _sign(difference: Finding) -> str:
    if difference.low is None or difference.high is None or difference.low <= 0 <= difference.high:
        return "no clear difference"
    return "longer delay" if difference.low > 0 else "shorter delay"


def draw_speed_over_place(
    axes: Axes, traces: Mapping[str, pd.DataFrame], crosswalk_width_m: float
) -> None:
    """Draw both arms' speed over the distance to the crosswalk.

    Args:
        axes: where to draw.
        traces: by label, the rows of ``traces`` of both arms of a pair.
        crosswalk_width_m: width of the shaded crosswalk.
    """
    half = crosswalk_width_m / 2
    axes.axvspan(-half, half, color=style.GRID, lw=0, label="crosswalk", zorder=0)
    axes.invert_xaxis()
    _motion(axes, traces, lambda ego: (-ego["x_m"], ego["speed_mps"]))
    axes.set(xlabel="R, front bumper to centre line (m)", ylabel="speed v (m/s)", ylim=(0, None))


def draw_speed_over_time(axes: Axes, traces: Mapping[str, pd.DataFrame]) -> None:
    """Draw both arms' speed over the time since the trigger; see ``draw_speed_over_place``."""
    _motion(axes, traces, lambda ego: (ego["time_s"], ego["speed_mps"]))
    axes.set(ylabel="speed v (m/s)", ylim=(0, None))


def draw_place_over_time(
    axes: Axes, traces: Mapping[str, pd.DataFrame], crosswalk_width_m: float
) -> None:
    """Draw both arms' place over the time since the trigger; see ``draw_speed_over_place``."""
    half = crosswalk_width_m / 2
    axes.axhspan(-half, half, color=style.GRID, lw=0, label="crosswalk", zorder=0)
    _motion(axes, traces, lambda ego: (ego["time_s"], ego["x_m"]))
    axes.set(ylabel="place x of the front (m)")


def _motion(
    axes: Axes,
    traces: Mapping[str, pd.DataFrame],
    of: Callable[[pd.DataFrame], tuple[pd.Series, pd.Series]],
) -> None:
    """Draw a line for every pair (colour) and arm (dash)."""
    for (label, rows), series in zip(traces.items(), SERIES, strict=False):
        ego = rows[rows["object"] == "ego"]
        for arm, look in ARM_LOOKS.items():
            own = ego[ego["arm"] == arm]
            name = figure_text(f"{label}, {'AV' if arm is Arm.AV else 'reference'}")
            axes.plot(*of(own), color=series.colour, ls=look.dash, lw=1.6, label=name)
    axes.margins(x=0)
    finish(axes, "time since the trigger (s)", "", f"n = {counted_noun(len(traces), 'pair')}")


def _defined(values: ArrayLike) -> FloatArray:
    floats: FloatArray = np.asarray(values, dtype=float)
    return floats[~np.isnan(floats)]


def _reach(points: Points, scale: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places, values, and how far intervals reach below and above; NaN where undefined."""
    rows = [
        (x, *(np.nan if end is None else scale * end for end in (one.value, one.low, one.high)))
        for x, one in points
    ]
    x, value, low, high = np.asarray(rows, dtype=np.float64).reshape(-1, 4).T
    reach: FloatArray = np.vstack((value - low, high - value)).clip(min=0)
    return x, value, reach


def _star(axes: Axes, x: FloatArray, y: FloatArray, findings: Sequence[Finding]) -> None:
    """Mark unreliable intervals as tables do."""
    for at, up, one in zip(x, y, findings, strict=True):
        if one.reliable is False and one.value is not None:
            axes.annotate("*", (at, up), (5, 1), textcoords="offset points", fontsize=11)


def _tick(axes: Axes, values: FloatArray) -> None:
    """Set a tick at each of at most nine values if 7 % of the axis lie between any two of them."""
    places = axes.transData.transform([(value, 0.0) for value in values])[:, 0]
    if len(values) <= 9 and (np.diff(places) > 0.07 * axes.bbox.width).all():
        axes.set_xticks(values, [f"{value:g}".replace("-", "−") for value in values])
        axes.set_xticks([], minor=True)


def _edges(values: FloatArray) -> tuple[FloatArray, int]:
    """The edges of the bars, and the number of larger values, which count in the last bar.

    There are √n bars, but at least 20 and at most 40.  If the largest τ is over 1.5 times as far
    from the smallest as the 99.5 % quantile is, the axis ends at that quantile.  Otherwise a few
    large τ would squeeze all others into one bar.
    """
    bins = min(max(math.ceil(math.sqrt(len(values))), 20), 40)
    low, high = float(values.min()), float(np.quantile(values, 0.995))
    if values.max() - low <= 1.5 * (high - low) or high == low:
        high = float(values.max())
    edges = np.histogram_bin_edges(values, bins, (low, high) if high > low else None)
    return edges, int(np.count_nonzero(values > edges[-1]))


def _cut_spike(axes: Axes, edges: FloatArray, counts: IntArray) -> None:
    """Cut and label a bar that is over four times the next one, such as τ = 1 if nobody was met.

    The axis then ends at 1.6 times the next one, which leaves room for the label.
    """
    highest, second = np.sort(counts)[::-1][:2]
    if second == 0 or highest <= 4 * second:
        return
    top, place = 1.6 * float(second), int(np.argmax(counts))
    axes.set_ylim(0, top)
    axes.annotate(
        f"↑ {int(highest):,} pairs", (edges[place : place + 2].mean(), top), (6, -4),
        textcoords="offset points", va="top", fontsize=9,
    )  # fmt: skip
