"""Figures of a fitted interaction model, after the paper's section on the model.

BIC over the number of components, raw rows beside the model for pairs of variables, densities of
walking and driving speed under several conditions.  Each function draws into an axes that it is
given and neither saves nor shows anything.  Lines differ in dash and grey level as well as colour.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Normalize, PowerNorm
from scipy.stats import multivariate_normal

from harness.encounter import FloatArray
from harness.interaction import PEDESTRIAN_SPEED, VEHICLE_SPEED, InteractionModel
from harness.mixture import TruncatedGaussianMixture
from harness.mixture.boxes import box_probability
from harness.report.style import BLUE, MUTED, SERIES, VERMILLION, finish

AXIS_LABELS = (
    "1/R (1/m)",
    "vehicle speed v (m/s)",
    "walking speed v_p (m/s)",
    "1/T_adv (1/s)",
)
PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))

STYLES = tuple((look.colour, look.dash) for look in SERIES)
_MAIN, _MARK = BLUE, VERMILLION
_CELLS = 48
# Density is drawn by its square root: ridges and the thin surroundings show side by side.
_GAMMA = 0.5


def draw_bic(axes: Axes, bic: Mapping[int, float], chosen: int) -> None:
    """BIC over K with the chosen K marked.

    Args:
        axes: drawn into.
        bic: by K.
        chosen: a K of ``bic``.
    """
    ks = sorted(bic)
    axes.plot(ks, [bic[k] for k in ks], "o-", color=_MAIN, ms=4, lw=1.4)
    axes.plot(chosen, bic[chosen], "s", ms=10, mfc="none", mec=_MARK, mew=1.8)
    axes.annotate(
        f"K = {chosen}",
        (chosen, bic[chosen]),
        xytext=(8, 10),
        textcoords="offset points",
        color=_MARK,
    )
    _over_components(axes, ks, "BIC", "BIC (lower is better)")


def draw_bic_gain(axes: Axes, gain: Mapping[int, float], limit: float) -> None:
    """The change rate of BIC in its unit-free form: each component's gain over the second's.

    Args:
        axes: drawn into.
        gain: (BIC_{K−1} − BIC_K) / (BIC_1 − BIC_2) by K.
        limit: the rule's share.
    """
    ks = sorted(gain)
    axes.plot(ks, [100 * gain[k] for k in ks], "o-", color=_MAIN, ms=4, lw=1.4)
    axes.axhline(0, color=MUTED, lw=0.8)
    axes.axhline(100 * limit, color=_MARK, lw=1.2, ls="--")
    axes.annotate(
        f"{limit:.0%}: the rule",
        (1, 100 * limit),
        xycoords=("axes fraction", "data"),
        xytext=(-4, 4),
        textcoords="offset points",
        ha="right",
        color=_MARK,
    )
    _over_components(axes, ks, "Gain of the K-th component", "share of the second's gain (%)")


def draw_held_out(
    axes: Axes, scores: Mapping[int, tuple[float, float | None]], chosen: int
) -> None:
    """Held-out log score of walking speeds over K, with standard errors over vehicles.

    Args:
        axes: drawn into.
        scores: mean and standard error (None when undefined) by K.
        chosen: the K to mark.
    """
    ks = sorted(scores)
    means = [scores[k][0] for k in ks]
    errors = [scores[k][1] or 0.0 for k in ks]
    axes.errorbar(
        ks, means, yerr=errors, fmt="o-", color=_MAIN, ms=4, lw=1.4, ecolor=MUTED, capsize=2
    )
    if chosen in scores:
        axes.plot(chosen, scores[chosen][0], "s", ms=10, mfc="none", mec=_MARK, mew=1.8)
    title = "Held-out score (higher is better)"
    _over_components(axes, ks, title, "mean log f(v_p | 1/R, v) (nats)")


def draw_rows(
    axes: Axes,
    data: FloatArray,
    weights: FloatArray,
    pair: tuple[int, int],
    view: FloatArray,
    norm: Normalize,
) -> QuadMesh:
    """Density of raw rows in two variables: a weighted histogram.

    Args:
        axes: drawn into.
        data: (n, 4) in the model's order; weights: (n,).
        pair: the variables across and up.
        view: (4, 2) what to show of each variable.
        norm: colour scale, shared with the model's panel.
    """
    across, up = pair
    edges = _edges(pair, view)
    counts, _, _ = np.histogram2d(data[:, across], data[:, up], bins=edges, weights=weights)
    cell = float(np.prod([edge[1] - edge[0] for edge in edges]))
    density = counts / (weights.sum() * cell)
    mesh = axes.pcolormesh(*edges, density.T, cmap="Greys", norm=norm, rasterized=True)
    _of_pair(axes, pair, f"rows, n = {len(data):,}")
    return mesh


def draw_pair(
    axes: Axes, density: FloatArray, pair: tuple[int, int], view: FloatArray, norm: Normalize
) -> QuadMesh:
    """The model's density in two variables, the others integrated out over the box.

    Args:
        axes: drawn into.
        density: as ``pair_density`` gives it.
        pair, view, norm: as for ``draw_rows``.
    """
    edges = _edges(pair, view)
    mesh = axes.pcolormesh(*edges, density.T, cmap="Greys", norm=norm, rasterized=True)
    _of_pair(axes, pair, "model")
    return mesh


def pair_density(
    mixture: TruncatedGaussianMixture, pair: tuple[int, int], view: FloatArray
) -> FloatArray:
    """(c, c) density at the cells' centres, across × up, the other two variables integrated out.

    Each component is its untruncated density in the pair times the probability that the others
    lie in the box given the pair, over the component's mass.
    """
    centres = [(edges[1:] + edges[:-1]) / 2 for edges in _edges(pair, view)]
    points = np.stack(np.meshgrid(*centres, indexing="ij"), axis=-1).reshape(-1, 2)
    shown, rest = list(pair), [i for i in range(mixture.lower.size) if i not in pair]
    total = np.zeros(len(points))
    for k, scale in enumerate(mixture.scale_matrices):
        slope = np.linalg.solve(scale[np.ix_(shown, shown)], scale[np.ix_(shown, rest)]).T
        away = points - mixture.locations[k, shown]
        means = mixture.locations[k, rest] + away @ slope.T
        spread = scale[np.ix_(rest, rest)] - slope @ scale[np.ix_(shown, rest)]
        inside = box_probability(
            np.repeat(spread[None], len(points), axis=0),
            mixture.lower[rest] - means,
            mixture.upper[rest] - means,
        )
        share = mixture.weights[k] / mixture.masses[k]
        normal = multivariate_normal(np.zeros(2), scale[np.ix_(shown, shown)])
        total += share * normal.pdf(away) * inside
    return total.reshape(_CELLS, _CELLS)


def density_scale(*densities: FloatArray) -> Normalize:
    """One colour scale for panels to be compared; the top 0.2 % of cells is saturated."""
    top = max(float(np.quantile(density, 0.998)) for density in densities)
    return PowerNorm(_GAMMA, vmin=0, vmax=top if top > 0 else 1)


def usual_view(mixture: TruncatedGaussianMixture) -> FloatArray:
    """(4, 2) from each lower bound to about the 99.7 % quantile of the variable."""
    drawn = mixture.sample(20_000, np.random.default_rng(0))
    return np.column_stack((mixture.lower, np.quantile(drawn, 0.997, axis=0)))


def draw_walking_speed(
    axes: Axes, model: InteractionModel, conditions: Sequence[Mapping[str, float]], title: str
) -> None:
    """Densities of v_p under conditions.

    Args:
        axes: drawn into.
        model: the interaction model.
        conditions: with ``range_m``, ``vehicle_speed_mps`` and, unless it is integrated out,
            ``inverse_time_advantage_per_s``.
        title: what is shown; what the conditions have in common is added.
    """
    low, high = (bound[PEDESTRIAN_SPEED] for bound in (model.mixture.lower, model.mixture.upper))
    speeds = np.linspace(low, min(high, 2.5), 400)
    for condition, (colour, dash) in zip(conditions, STYLES, strict=False):
        time = condition.get("inverse_time_advantage_per_s")
        density = model.walking_speed_density(
            speeds,
            np.array([condition["range_m"]]),
            np.array([condition["vehicle_speed_mps"]]),
            inverse_time_advantage_per_s=None if time is None else np.array([time]),
        )
        label = _words(condition, _varied(conditions))
        axes.plot(speeds, density, color=colour, ls=dash, lw=1.8, label=label)
    _of_density(axes, AXIS_LABELS[PEDESTRIAN_SPEED], title, conditions)


def draw_driving_speed(
    axes: Axes, model: InteractionModel, conditions: Sequence[Mapping[str, float]], title: str
) -> None:
    """Densities of v under conditions; the dot is the mode, where the human driver goes.

    Args:
        axes: drawn into.
        model: the interaction model.
        conditions: with ``range_m``, ``pedestrian_speed_mps``, ``inverse_time_advantage_per_s``.
        title: what is shown; what the conditions have in common is added.
    """
    low, high = (bound[VEHICLE_SPEED] for bound in (model.mixture.lower, model.mixture.upper))
    speeds = np.linspace(low, high, 500)
    for condition, (colour, dash) in zip(conditions, STYLES, strict=False):
        keys = ("range_m", "pedestrian_speed_mps", "inverse_time_advantage_per_s")
        given = [condition[key] for key in keys]
        density = model.driver_speed_density(speeds, *(np.array([value]) for value in given))
        label = _words(condition, _varied(conditions))
        axes.plot(speeds, density, color=colour, ls=dash, lw=1.8, label=label)
        mode = model.driver_speed(*given)
        axes.plot(mode, np.interp(mode, speeds, density), "o", color=colour, ms=5)
    _of_density(axes, AXIS_LABELS[VEHICLE_SPEED], title, conditions)


_SYMBOLS = {
    "range_m": ("1/R", "per m"),
    "vehicle_speed_mps": ("v", "m/s"),
    "pedestrian_speed_mps": ("v_p", "m/s"),
    "inverse_time_advantage_per_s": ("1/T_adv", "per s"),
}


def _varied(conditions: Sequence[Mapping[str, float]]) -> set[str]:
    """The keys whose values differ between the conditions."""
    return {key for key in conditions[0] if len({of[key] for of in conditions}) > 1}


def _words(condition: Mapping[str, float], keys: set[str]) -> str:
    parts = []
    for key, (symbol, unit) in _SYMBOLS.items():
        if key in keys:
            value = 1 / condition[key] if key == "range_m" else condition[key]
            parts.append(f"{symbol} = {value:.3g} {unit}")
    return ", ".join(parts)


def _edges(pair: tuple[int, int], view: FloatArray) -> list[FloatArray]:
    return [np.linspace(float(view[i, 0]), float(view[i, 1]), _CELLS + 1) for i in pair]


def _over_components(axes: Axes, ks: Sequence[int], title: str, label: str) -> None:
    finish(axes, "number of components K", label)
    axes.set_title(title, fontsize=11, loc="left")
    if ks:
        axes.set_xticks(ks[:: 1 + len(ks) // 14])
        axes.set_xlim(min(ks) - 0.5, max(ks) + 0.5)


def _of_pair(axes: Axes, pair: tuple[int, int], title: str) -> None:
    axes.set_xlabel(AXIS_LABELS[pair[0]])
    axes.set_ylabel(AXIS_LABELS[pair[1]])
    axes.set_title(title, fontsize=10, loc="left")


def _of_density(
    axes: Axes, label: str, title: str, conditions: Sequence[Mapping[str, float]]
) -> None:
    finish(axes, label, "probability density (s/m)")
    common = _words(conditions[0], set(conditions[0]) - _varied(conditions))
    axes.set_title(f"{title} at {common}" if common else title, fontsize=11, loc="left")
    axes.set_ylim(bottom=0)
    axes.margins(x=0)
    axes.legend(frameon=False, fontsize=9, loc="upper right")
