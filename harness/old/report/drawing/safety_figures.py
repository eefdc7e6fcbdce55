"""Figures over all episodes of a cell: safety measures, walking speeds and their model.

Each function draws into the given axes and neither saves nor shows the figure.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from harness.core.encounter import FloatArray
from harness.old.report.drawing.style import AV, HUMAN, finish

_MOST_STEPS = 400
_BINS = 24


def draw_shares(
    axes: Axes,
    values: Mapping[str, FloatArray],
    across: str,
    up_to: float,
    up: str = "share of episodes at most x",
    count: str | None = None,
) -> None:
    """Draw the share of episodes whose measure is at most x.

    Args:
        values: by arm, AV first, one value for each episode that did not fail.  NaN means
            undefined; such an episode counts in the total, so the share ends below 1.
        across: label of the measure with its unit.
        up_to: end of the axis.
        up: label of the share.
        count: text above the figure; default: the number of episodes.
    """
    highest = 0.0
    for (name, column), look in zip(values.items(), (AV, HUMAN), strict=False):
        inside = np.sort(column[column <= up_to])
        label = f"{name}, defined in {(~np.isnan(column)).sum():,} of {len(column):,}"
        # A long line is thinned; its last step is drawn at the end of the axis.
        ranks = np.linspace(1, len(inside), min(len(inside), _MOST_STEPS)).astype(int)
        x = np.concatenate(([0.0], inside[ranks - 1], [up_to]))
        share = np.concatenate(([0], ranks, [len(inside)])) / max(len(column), 1)
        highest = max(highest, float(share.max()))
        axes.step(x, share, where="post", color=look.colour, ls=look.dash, lw=1.7, label=label)
    axes.set_xlim(0, up_to)
    axes.set_ylim(0, 1.02 if highest > 0.5 else max(0.05, 1.25 * highest))
    total = max((len(column) for column in values.values()), default=0)
    finish(axes, across, up, f"n = {total:,} per arm" if count is None else count)
