"""Figures of a fitted interaction model, after the paper's section on the model.

They show BIC over the number of components, recorded rows and the model for pairs of variables,
and densities of walking and driving speed.  Each function draws into the given axes and neither
saves nor shows the figure.  Lines differ in dash and colour, so greyscale is readable.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.ticker import MaxNLocator

from harness.core.encounter import FloatArray
from harness.model.interaction import PEDESTRIAN_SPEED, VEHICLE_SPEED, InteractionModel
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.old.report.drawing.style import BLUE, MUTED, SERIES, VERMILLION, finish

AXIS_LABELS = ("1/R (1/m)", "vehicle speed v (m/s)", "walking speed v_p (m/s)", "1/T_adv (1/s)")
PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
Pair = tuple[int, int]
Conditions = Sequence[Mapping[str, float]]

_CELLS = 48
_SYMBOLS = {
    "range_m": ("1/R", "per m"),
    "vehicle_speed_mps": ("v", "m/s"),
    "pedestrian_speed_mps": ("v_p", "m/s"),
    "inverse_time_advantage_per_s": ("1/T_adv", "per s"),
}


def draw_bic(axes: Axes, bic: Mapping[int, float], chosen: int) -> None:
    """Draw BIC by K, with a mark at the chosen K."""
    _over_components(axes, bic, "BIC", "BIC (lower is better)", chosen)
    axes.annotate(
        f"K = {chosen}", (chosen, bic[chosen]), (8, 10), textcoords="offset points",
        color=VERMILLION,
    )  # fmt: skip


def draw_bic_gain(axes: Axes, gain: Mapping[int, float], limit: float) -> None:
    """Draw the gain (BIC_{K−1} − BIC_K) / (BIC_1 − BIC_2) by K, and the rule's limit."""
    shares = {k: 100 * share for k, share in gain.items()}
    _over_components(axes, shares, "Gain of the K-th component", "share of the second's gain (%)")
    axes.axhline(0, color=MUTED, lw=0.8)
    axes.axhline(100 * limit, color=VERMILLION, lw=1.2, ls="--")
    right = axes.get_yaxis_transform()
    axes.text(1, 100 * limit, f"{limit:.0%}: the rule ", transform=right, ha="right", va="bottom")


def draw_held_out(
    axes: Axes, scores: Mapping[int, tuple[float, float | None]], chosen: int
) -> None:
    """Draw the held-out log score of walking speeds by K, with standard errors if defined."""
    means = {k: mean for k, (mean, _) in scores.items()}
    errors = [error or 0.0 for _, error in scores.values()]
    axes.errorbar([*means], [*means.values()], errors, fmt="none", ecolor=MUTED)
    label = "mean log f(v_p | 1/R, v) (nats)"
    _over_components(axes, means, "Held-out score (higher is better)", label, chosen)


def draw_rows(
    axes: Axes, data: FloatArray, weights: FloatArray, pair: Pair, view: FloatArray, norm: Normalize
) -> QuadMesh:
    """Draw the density of recorded rows in two variables as a weighted histogram.

    Args:
        data: (n, 4) the variables in the model's order; weights: (n,).
        pair: the variables of the x axis and of the y axis.
        view: (4, 2) the shown range of each variable.
        norm: colour scale, shared with the model's panel.
    """
    edges = _edges(pair, view)
    x, y = data[:, pair].T
    counts = np.histogram2d(x, y, bins=edges, weights=weights)[0]
    density = counts / (weights.sum() * np.prod([edge[1] - edge[0] for edge in edges]))
    return _draw_density(axes, density, pair, view, norm, f"rows, n = {len(data):,}")


def draw_pair(
    axes: Axes, density: FloatArray, pair: Pair, view: FloatArray, norm: Normalize
) -> QuadMesh:
    """Draw the density of ``pair_density`` in the form of ``draw_rows``."""
    return _draw_density(axes, density, pair, view, norm, "model")


def pair_density(mixture: TruncatedGaussianMixture, pair: Pair, view: FloatArray) -> FloatArray:
    """Return the model's joint density of two variables at the cells' centres, shape (c, c)."""
    across, up = pair
    x, y = (0.5 * (edges[1:] + edges[:-1]) for edges in _edges(pair, view))
    marginal = mixture.conditional(across, ()).pdf(x, np.empty((1, 0)))
    given = mixture.conditional(up, (across,))
    rows = given.pdf(np.tile(y, x.size), np.repeat(x, y.size)[:, None])
    return marginal[:, None] * rows.reshape(x.size, y.size)


def density_scale(density: FloatArray) -> Normalize:
    """Return a square-root colour scale in which the top 0.2 % of the cells is saturated."""
    return PowerNorm(0.5, vmin=0, vmax=float(np.quantile(density, 0.998)) or 1.0)


def usual_view(mixture: TruncatedGaussianMixture) -> FloatArray:
    """Return each variable's range from its lower bound to its 99.7 % quantile, (4, 2)."""
    nothing = np.empty((1, 0))
    high = [mixture.conditional(i, ()).ppf([0.997], nothing)[0] for i in range(4)]
    return np.column_stack((mixture.lower, high))


def draw_walking_speed(
    axes: Axes, model: InteractionModel, conditions: Conditions, title: str
) -> None:
    """Draw densities of v_p under conditions.

    Args:
        conditions: values of ``range_m``, ``vehicle_speed_mps`` and, unless it is integrated out,
            ``inverse_time_advantage_per_s``.
        title: the title, to which the conditions that all lines share are added.
    """
    _draw_speeds(axes, model, PEDESTRIAN_SPEED, model.walking_speed_density, conditions, title)
    axes.set_xlim(right=min(axes.get_xlim()[1], 2.5))


def draw_driving_speed(
    axes: Axes, model: InteractionModel, conditions: Conditions, title: str
) -> None:
    """Draw densities of v under conditions.  A dot marks the mode, the human driver's target speed.

    See ``draw_walking_speed`` for the arguments; ``pedestrian_speed_mps`` replaces the vehicle's
    speed.
    """
    _draw_speeds(axes, model, VEHICLE_SPEED, model.driver_speed_density, conditions, title)
    for condition, look in zip(conditions, SERIES, strict=False):
        mode = np.array([model.driver_speed(**condition)])
        height = model.driver_speed_density(mode, **_arrays(condition))
        axes.plot(mode, height, "o", color=look.colour, ms=5)


def _draw_speeds(
    axes: Axes,
    model: InteractionModel,
    variable: int,
    density: Callable[..., FloatArray],
    conditions: Conditions,
    title: str,
) -> None:
    """Draw a line for each condition; the legend names their differences, the title the rest."""
    speeds = np.linspace(model.mixture.lower[variable], model.mixture.upper[variable], 500)
    varied = {key for key in conditions[0] if len({each[key] for each in conditions}) > 1}
    for condition, look in zip(conditions, SERIES, strict=False):
        values = density(speeds, **_arrays(condition))
        label = _words(condition, varied)
        axes.plot(speeds, values, color=look.colour, ls=look.dash, lw=1.8, label=label)
    finish(axes, AXIS_LABELS[variable], "probability density (s/m)")
    common = _words(conditions[0], set(conditions[0]) - varied)
    axes.set_title(f"{title} at {common}" if common else title, loc="left")
    axes.set_ylim(bottom=0)
    axes.margins(x=0)


def _arrays(condition: Mapping[str, float]) -> dict[str, FloatArray]:
    return {key: np.array([value]) for key, value in condition.items()}


def _words(condition: Mapping[str, float], keys: set[str]) -> str:
    return ", ".join(
        f"{symbol} = {1 / condition[key] if key == 'range_m' else condition[key]:.3g} {unit}"
        for key, (symbol, unit) in _SYMBOLS.items()
        if key in keys
    )


def _edges(pair: Pair, view: FloatArray) -> list[FloatArray]:
    return [np.linspace(view[i, 0], view[i, 1], _CELLS + 1) for i in pair]


def _draw_density(
    axes: Axes, density: FloatArray, pair: Pair, view: FloatArray, norm: Normalize, title: str
) -> QuadMesh:
    axes.set(xlabel=AXIS_LABELS[pair[0]], ylabel=AXIS_LABELS[pair[1]])
    axes.set_title(title, fontsize=10, loc="left")
    edges = _edges(pair, view)
    return axes.pcolormesh(*edges, density.T, cmap="Greys", norm=norm, rasterized=True)


def _over_components(
    axes: Axes, values: Mapping[int, float], title: str, label: str, chosen: int | None = None
) -> None:
    """Draw values over K, joined by a line, with a square around the chosen K."""
    axes.plot(*zip(*sorted(values.items()), strict=True), "o-", color=BLUE, ms=4, lw=1.4)
    if chosen is not None and chosen in values:
        axes.plot(chosen, values[chosen], "s", ms=10, mfc="none", mec=VERMILLION, mew=1.8)
    finish(axes, "number of components K", label)
    axes.set_title(title, loc="left")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
