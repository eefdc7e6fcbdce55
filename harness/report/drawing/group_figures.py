"""Figures that compare several groups in both arms."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from harness.core.encounter import Arm
from harness.report.drawing import style
from harness.report.screens.tables import ARM_NAMES
from harness.statistics import Interval

_APART = 0.16
"""Vertical distance between an arm's dot and its group's centre; groups are 1 apart."""


def draw_groups(
    axes: Axes, names: Sequence[str], values: Mapping[Arm, Sequence[Interval]], across: str
) -> None:
    """Draw a dot with its interval for each group and arm; an undefined value has no dot.

    Args:
        axes: the axes to draw into.
        names: names of the groups, from top to bottom.
        values: values of each arm, one for each group.
        across: label of the values with their unit.
    """
    places = np.arange(len(names), dtype=float)
    for arm, away in ((Arm.AV, -_APART), (Arm.HUMAN, _APART)):
        look = style.ARM_LOOKS[arm]
        rows = []
        for place, each in zip(places, values[arm], strict=True):
            if each.value is not None:
                ends = (each.value if end is None else end for end in (each.low, each.high))
                rows.append((place + away, each.value, *ends))
        up, value, low, high = np.array(rows, dtype=float).reshape(-1, 4).T
        reach = np.vstack((value - low, high - value)).clip(min=0)
        axes.errorbar(
            value, up, xerr=reach, color=look.colour, ls="none", marker=look.marker, ms=5.5,
            elinewidth=1.2, capsize=2.5, label=ARM_NAMES[arm],
        )  # fmt: skip
    axes.set_yticks(places, [style.figure_text(name) for name in names])
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
    style.finish(axes, across, "")
