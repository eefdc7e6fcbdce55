"""Figures of τ, the ratio of the AV's pass time to the reference's: running mean, distribution.

They follow the paper's figure "Mean value and distribution of τ".  Each function draws into the
given axes and neither saves nor shows the figure.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from scipy import special

from harness.core.encounter import FloatArray
from harness.old.report.drawing.style import AV, GREEN, INK, MUTED, VERMILLION, finish
from harness.old.report.screens.tables import level
from harness.old.statistics import CONFIDENCE

_MOST_POINTS = 400
_MOST_DOTS = 1_000
_FIRST_BAND = 5
_SETTLED = 30


def draw_running_mean(
    axes: Axes, tau: FloatArray, reference: float | None = None, driver: str = "reference"
) -> None:
    """Draw the mean of the first n values of τ over n, its band, and the values themselves.

    The band is Student's t interval of the first n values, mean ± t · s/√n, drawn from n = 5 on.

    Args:
        tau: (n,) values in order of the pairs; NaN (undefined) is left out.
        reference: the paper's μ, drawn as a line; None means no line.
        driver: the name of the reference driver.
    """
    tau = tau[~np.isnan(tau)]
    total = len(tau)
    if total and total <= _MOST_DOTS:
        axes.plot(
            np.arange(1, total + 1), tau, ".", color=MUTED, ms=3.5, alpha=0.6,
            label="τ of one pair", zorder=1,
        )  # fmt: skip
    ns = np.unique(np.linspace(1, total, min(total, _MOST_POINTS)).astype(int))
    mean, half = running_mean(tau)
    low, high = mean - half, mean + half
    axes.plot(ns, mean[ns - 1], color=AV.colour, ls=AV.dash, lw=1.8, label="mean of the first n")
    banded = ns[ns >= _FIRST_BAND]
    if len(banded):
        axes.fill_between(
            banded, low[banded - 1], high[banded - 1], color=AV.colour, alpha=0.18, lw=0,
            label=f"its {level(CONFIDENCE)} band",
        )  # fmt: skip
    if reference is not None:
        axes.axhline(reference, color=VERMILLION, ls="--", lw=1.2, label=f"paper: {reference:g}")
    axes.set_xlim(0, max(total, 1) * 1.01)
    if total > _MOST_DOTS:
        # Otherwise the first means, from few pairs, would determine the scale.
        ends = [low[_SETTLED:].min(), high[_SETTLED:].max(), reference or high[-1]]
        room = 0.08 * (max(ends) - min(ends))
        axes.set_ylim(min(ends) - room, max(ends) + room)
    finish(axes, "number of pairs n", f"τ = AV time / {driver} time", f"n = {total:,}")


def running_mean(tau: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean of the first n finite values and its Student's t half-width, for every n.

    The half-width is NaN for n = 1.
    """
    n = np.arange(1, len(tau) + 1)
    mean = np.cumsum(tau) / n
    # The values are shifted, so that sum of squares and squared sum do not cancel.
    shifted = tau - (tau[0] if len(tau) else 0.0)
    squares, sums = np.cumsum(shifted**2), np.cumsum(shifted)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.maximum(squares - sums**2 / n, 0.0) / (n - 1)
        t = special.stdtrit((n - 1).astype(float), (1 + CONFIDENCE) / 2)
        half = np.asarray(t * np.sqrt(variance / n), dtype=float)
    half[:1] = np.nan
    return mean, half


def draw_tau_distribution(
    axes: Axes,
    tau: FloatArray,
    fallback: "np.ndarray | None" = None,
    mu: tuple[float, float, float] | None = None,
    driver: str = "reference",
) -> None:
    """Draw a histogram of τ, in which pairs with a fallback of the AV are hatched.

    Args:
        tau: (n,) values; NaN (undefined) is left out.
        fallback: (n,) whether the AV fell back; None means no hatching.
        mu: mean with its interval, drawn as a line and a band; None means neither.
        driver: the name of the reference driver.
    """
    defined = ~np.isnan(tau)
    fell = np.zeros(len(tau), dtype=bool) if fallback is None else np.asarray(fallback, dtype=bool)
    values, fell = tau[defined], fell[defined]
    if len(values):
        edges, beyond = _edges(values)
        inside = np.minimum(values, edges[-1])
        kept, dropped = (np.histogram(inside[mask], edges)[0] for mask in (~fell, fell))
        widths, seen = np.diff(edges), dropped > 0
        axes.bar(
            edges[:-1], kept, widths, align="edge", color=AV.colour, alpha=0.55, ec=INK, lw=0.5,
            label="without fallback" if fell.any() else None,
        )  # fmt: skip
        if fell.any():
            axes.bar(
                edges[:-1][seen], dropped[seen], widths[seen], bottom=kept[seen], align="edge",
                fc="none", ec=VERMILLION, lw=0.8, hatch="////", label="the AV fell back",
            )  # fmt: skip
        _cut_spike(axes, edges, kept + dropped)
        if beyond:
            axes.plot([], [], " ", label=f"last bar: {beyond:,} pairs up to τ = {values.max():.3g}")
    if mu is not None:
        value, low, high = mu
        axes.axvline(value, color=GREEN, lw=1.8, ls="-.", label=f"μ = {value:.4f}")
        axes.axvspan(
            low, high, color=GREEN, alpha=0.2, lw=0, label=f"its {level(CONFIDENCE)} interval"
        )
    axes.axvline(1.0, color=MUTED, lw=1.0, ls=":", label=f"as fast as {driver}")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    finish(axes, f"τ = AV time / {driver} time", "pairs", f"n = {len(values):,}")


def _edges(values: FloatArray) -> tuple[FloatArray, int]:
    """Return the edges of the bars, and the number of larger values, which count in the last bar.

    If the largest τ is far above the 99.5 % quantile, the axis ends at that quantile.  Otherwise a
    few large τ would squeeze all others into one bar.
    """
    bins = min(max(math.ceil(math.sqrt(len(values))), 20), 40)
    low, high = float(values.min()), float(np.quantile(values, 0.995))
    if values.max() - low <= 1.5 * (high - low) or high == low:
        high = float(values.max())
    edges = np.histogram_bin_edges(values, bins, (low, high) if high > low else None)
    return edges, int(np.count_nonzero(values > edges[-1]))


def _cut_spike(axes: Axes, edges: FloatArray, counts: np.ndarray) -> None:
    """Cut and label a bar that is many times the next one, such as τ = 1 if nobody was met."""
    highest, second = np.sort(counts)[::-1][:2]
    if second == 0 or highest <= 4 * second:
        return
    top, place = 1.6 * float(second), int(np.argmax(counts))
    axes.set_ylim(0, top)
    axes.annotate(
        f"↑ {int(highest):,} pairs", (edges[place : place + 2].mean(), top), (6, -4),
        textcoords="offset points", va="top", fontsize=9,
    )  # fmt: skip
