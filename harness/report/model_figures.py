"""Figures of a fitted interaction model, after the paper's section on the model.

They show BIC and its change over the number of components, recorded rows and the model in three
projections, and conditional densities of walking and driving speed.  Lines differ in dash and
colour, so greyscale is readable.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from harness.core.vocabulary import FloatArray
from harness.model.interaction import (
    DRIVING_GIVEN,
    INVERSE_RANGE,
    INVERSE_TIME_ADVANTAGE,
    PEDESTRIAN_SPEED,
    VEHICLE_SPEED,
    WALKING_GIVEN,
    InteractionModel,
)
from harness.model.mixture.conditional import Conditional
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.sample import Sample, make_sample, read_rows
from harness.report.page import write_result
from harness.report.style import BLUE, MUTED, SERIES, VERMILLION, finish, save, styled
from harness.results.result import Result
from harness.studies.models.fits import RULE_SHARE

AXIS_LABELS = ("1/R (1/m)", "vehicle speed v (m/s)", "walking speed v_p (m/s)", "1/T_adv (1/s)")
PAIRS = (
    (INVERSE_RANGE, VEHICLE_SPEED),
    (INVERSE_RANGE, PEDESTRIAN_SPEED),
    (INVERSE_TIME_ADVANTAGE, PEDESTRIAN_SPEED),
)
"""The projections: v over 1/R, v_p over 1/R, and v_p over 1/T_adv."""

_CELLS = 48
_SYMBOLS = (("1/R", "per m"), ("v", "m/s"), ("v_p", "m/s"), ("1/T_adv", "per s"))
_INVERSE_RANGES, _INVERSE_TIMES, _WALKING_MPS = (0.07, 0.10, 0.13), (0.05, 0.10), 1.2
"""The authors' public scripts draw these conditions."""

_VEHICLE_SPEEDS, _TRIGGER_M = (2.0, 3.5, 5.0), 30.0
"""Speeds up to that at the trigger in the paper's Table II, and the range there."""


def write_model_page(
    model: InteractionModel,
    result: Result,
    rows: Path | None,
    page: Path | None,
    folder: Path | None,
) -> list[Path]:
    """Draw the paper's figures of a model; write them into a page, and as PNG and PDF.

    Args:
        model: the model.
        result: what the page shows besides.
        rows: the file of the fitted rows, which are drawn beside the model.
        page: the file of the page.
        folder: the folder of the figures, made if it is missing.

    Returns:
        The written files.

    Raises:
        InputError: the rows are not usable.
        HarnessError: a file cannot be written.
    """
    sample, box = None, (model.mixture.lower, model.mixture.upper)
    if rows is not None:
        unit = str(model.provenance.get("weigh", "row")).partition(",")[0]
        sample = make_sample(read_rows(rows).rows, unit, *box)
    with styled():
        drawn = [("pairs", "Pairs of variables", *_pairs(model, sample))]
        drawn.append(("speeds", "Speeds under conditions", *_speeds(model)))
        if len(result.records) > 1:
            drawn.insert(0, ("components", "Number of components", *_components(result)))
        kept = [(figure, words, folder, name) for name, _, words, figure in drawn if folder]
        written = [path for each in kept for path in save(*each)]
    return [*written, *([write_result(result, page, drawn)] if page else [])]


def _components(result: Result) -> tuple[str, Figure]:
    """BIC, the gain of each component, and the held-out scores."""
    records: Any = result.records
    bic, gain, scores = (
        {
            each["components"]: np.array((of.value, of.low, of.high), dtype=float)
            for each in records
            if (of := each[key]) is not None
        }
        for key in ("bic", "bic_gain_share", "held_out")
    )
    figure, axes, chosen = *_panels(1, 3 if scores else 2, 4.0), result.facts["components"]
    _over_components(axes[0], bic, "BIC (lower is better)", chosen)
    _over_components(axes[1], gain, "gain in BIC, share of the second's")
    axes[1].axhline(RULE_SHARE, color=VERMILLION, lw=1.2, ls="--", label="the rule's limit")
    for k, ends in scores.items():
        axes[2].plot([k, k], ends[1:], color=MUTED)
    if scores:
        _over_components(axes[2], scores, "held-out log f(v_p | 1/R, v) (nats)", chosen)
    return f"{result.title}. Bars: 95 % over vehicles. Square: the chosen K.", figure


def _pairs(model: InteractionModel, sample: Sample | None) -> tuple[str, Figure]:
    """Rows and model in three projections; both have the same colour scale."""
    figure, axes = _panels(len(PAIRS), 1 if sample is None else 2, 3.4)
    view, panels = usual_view(model.mixture), iter(axes)
    for pair in PAIRS:
        density, edges = pair_density(model.mixture, pair, view), _edges(pair, view)
        # The top 0.2 % of the cells is saturated.
        norm = PowerNorm(0.5, vmin=0, vmax=float(np.quantile(density, 0.998)) or 1.0)
        if sample is not None:
            x, y = sample.data[:, pair].T
            counts = np.histogram2d(x, y, bins=edges, weights=sample.weights, density=True)[0]
            _draw_density(next(panels), counts, pair, edges, norm, f"rows, n = {len(x):,}")
        _draw_density(next(panels), density, pair, edges, norm, "model")
    rows = "" if sample is None else f"; rows are weighted by {sample.weigh}"
    words = f"{model.name}, K = {model.mixture.weights.size}: densities, dark is high"
    return f"{words}; one colour scale per row (square root){rows}.", figure


def _speeds(model: InteractionModel) -> tuple[str, Figure]:
    """v_p and v under the authors' conditions, and v_p as in a run."""
    figure, axes = _panels(2, 2, 4.0)
    given = (INVERSE_RANGE, VEHICLE_SPEED, INVERSE_TIME_ADVANTAGE)
    conditions = [(each, _VEHICLE_SPEEDS[1], _INVERSE_TIMES[1]) for each in _INVERSE_RANGES]
    _draw_speeds(axes[0], model, PEDESTRIAN_SPEED, given, conditions)
    at_trigger = [(1 / _TRIGGER_M, speed) for speed in _VEHICLE_SPEEDS]
    _draw_speeds(axes[1], model, PEDESTRIAN_SPEED, WALKING_GIVEN, at_trigger)
    for panel, inverse_time in zip(axes[2:], _INVERSE_TIMES, strict=True):
        conditions = [(inverse, _WALKING_MPS, inverse_time) for inverse in _INVERSE_RANGES]
        driving = _draw_speeds(panel, model, VEHICLE_SPEED, DRIVING_GIVEN, conditions)
        modes = driving.mode(conditions)
        for mode, height, look in zip(modes, driving.pdf(modes, conditions), SERIES, strict=False):
            panel.plot(mode, height, "o", color=look.colour, ms=5)
    words = f"{model.name}, K = {model.mixture.weights.size}. Dots are the modes, the speeds that "
    return f"{words}the human driver aims for. Without T_adv it is integrated out.", figure


def _panels(down: int, across: int, height_inch: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(5.0 * across, height_inch * down), layout="constrained")
    return figure, list(figure.subplots(down, across, squeeze=False).ravel())


def pair_density(
    mixture: TruncatedGaussianMixture, pair: tuple[int, int], view: FloatArray
) -> FloatArray:
    """The model's joint density of two variables at the cells' centres, shape (c, c)."""
    across, up = pair
    x, y = (0.5 * (edges[1:] + edges[:-1]) for edges in _edges(pair, view))
    marginal = Conditional(mixture, across, ()).pdf(x, np.empty((1, 0)))
    given = Conditional(mixture, up, (across,))
    rows = given.pdf(np.tile(y, x.size), np.repeat(x, y.size)[:, None])
    return marginal[:, None] * rows.reshape(x.size, y.size)


def usual_view(mixture: TruncatedGaussianMixture) -> FloatArray:
    """Each variable's range from its lower bound to its 99.7 % quantile, (4, 2)."""
    nothing = np.empty((1, 0))
    high = [Conditional(mixture, i, ()).ppf([0.997], nothing)[0] for i in range(len(AXIS_LABELS))]
    return np.column_stack((mixture.lower, high))


def _draw_speeds(
    axes: Axes,
    model: InteractionModel,
    variable: int,
    given: Sequence[int],
    conditions: Sequence[tuple[float, ...]],
) -> Conditional:
    """Draw a line for each condition; the legend names their differences, the title the rest."""
    conditional = Conditional(model.mixture, variable, given)
    speeds = np.linspace(conditional.lower, conditional.upper, 500)
    names = [_SYMBOLS[each] for each in given]
    texts = [[f"{name} = {of:.3g} {unit}" for (name, unit), of in zip(names, each, strict=True)]
             for each in conditions]  # fmt: skip
    alike = [text for text in texts[0] if all(text in each for each in texts)]
    for condition, words, look in zip(conditions, texts, SERIES, strict=False):
        label = ", ".join(text for text in words if text not in alike)
        values = conditional.pdf(speeds, [condition])
        axes.plot(speeds, values, color=look.colour, ls=look.dash, lw=1.8, label=label)
    finish(axes, AXIS_LABELS[variable], "probability density (s/m)", ", ".join(alike))
    axes.set_ylim(bottom=0)
    axes.margins(x=0)
    return conditional


def _edges(pair: tuple[int, int], view: FloatArray) -> list[FloatArray]:
    return [np.linspace(view[i, 0], view[i, 1], _CELLS + 1) for i in pair]


def _draw_density(
    axes: Axes,
    density: FloatArray,
    pair: tuple[int, int],
    edges: Sequence[FloatArray],
    norm: Normalize,
    title: str,
) -> None:
    axes.set(xlabel=AXIS_LABELS[pair[0]], ylabel=AXIS_LABELS[pair[1]])
    axes.set_title(title, fontsize=10, loc="left")
    axes.pcolormesh(*edges, density.T, cmap="Greys", norm=norm, rasterized=True)


def _over_components(
    axes: Axes, found: Mapping[int, FloatArray], label: str, chosen: object = None
) -> None:
    """Draw values over K, joined by a line, with a square around the chosen K."""
    axes.plot([*found], [of[0] for of in found.values()], "o-", color=BLUE, ms=4, lw=1.4)
    for k, of in found.items():
        if k == chosen:
            axes.plot(k, of[0], "s", ms=10, mfc="none", mec=VERMILLION, mew=1.8)
    finish(axes, "number of components K", label)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
