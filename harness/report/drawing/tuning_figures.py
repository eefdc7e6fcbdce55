"""Figures of a search: the trials over each limited number, with the Pareto front."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from harness.core.encounter import FloatArray
from harness.report.drawing.style import AV, MUTED, VERMILLION, finish


@dataclass(frozen=True)
class Tried:
    """The trials of a search: a limited number, the objective, and whether each is on the front."""

    x: FloatArray
    y: FloatArray
    front: FloatArray
    best: int | None


def draw_trials(axes: Axes, tried: Tried, labels: Sequence[str], limit: float | None) -> None:
    """Draw all trials; those on the front are filled, and the best one has a ring.

    Args:
        axes: the axes.
        tried: the trials.
        labels: of the axis across and of the axis up.
        limit: the limit on the number across, if there is one.
    """
    on = tried.front > 0
    rest: Mapping[str, Any] = {"facecolor": "none", "edgecolor": MUTED, "s": 22}
    axes.scatter(tried.x[~on], tried.y[~on], label="other trials", **rest)
    axes.scatter(tried.x[on], tried.y[on], color=AV.colour, s=26, label="on the front")
    if tried.best is not None:
        place = [tried.x[tried.best]], [tried.y[tried.best]]
        ring: Mapping[str, Any] = {
            "facecolor": "none",
            "edgecolor": VERMILLION,
            "s": 110,
            "linewidth": 1.6,
        }
        axes.scatter(*place, label="best that keeps every limit", **ring)
    if limit is not None:
        axes.axvline(limit, color=VERMILLION, ls="--", lw=1.2, label="limit")
        if limit >= 0 and not np.any(tried.x):
            # Around numbers that are all 0 the axis would be far wider than the limit.
            axes.set_xlim(-0.25 * (limit or 1.0), 1.5 * (limit or 1.0))
    finish(axes, labels[0], labels[1], f"{len(tried.x)} trials, search data")
