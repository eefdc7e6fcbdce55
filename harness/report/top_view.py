"""A moment of an episode from above, as pixels; who draws none does not import Matplotlib."""

import io
import math
from collections.abc import Iterable

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from harness.core.vocabulary import Crossing, Vehicle
from harness.report.style import BLUE, MUTED, ORANGE


def top_view(
    vehicle: Vehicle, crossing: Crossing, x_m: float, people_y_m: Iterable[float]
) -> NDArray[np.uint8]:
    """Draw a moment from above: the road, the ego, which drives to the right, and the pedestrians.

    Args:
        vehicle: the ego.
        crossing: the crosswalk.
        x_m: x of the ego's front bumper.
        people_y_m: y of each pedestrian.

    Returns:
        RGB, shape (height, width, 3), at 10 pixels per metre.  Height and width are even, because
        video formats need that.
    """
    left, right = -vehicle.trigger_range_m - vehicle.length_m, crossing.width_m / 2 + 7.0
    size = [2 * math.ceil(5 * extent_m) for extent_m in (right - left, crossing.length_m + 4.0)]
    figure = Figure(figsize=(size[0] / 10, size[1] / 10), dpi=10)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set(xlim=(left, left + size[0] / 10), ylim=(-2.0, size[1] / 10 - 2.0))

    def block(x: float, y: float, width: float, height: float, colour: str) -> None:
        axes.add_patch(Rectangle((x, y), width, height, color=colour, lw=0, antialiased=False))

    block(left, 0.0, size[0] / 10, crossing.length_m, MUTED)
    for y in np.arange(0.0, crossing.length_m, 1.0).tolist():
        block(-crossing.width_m / 2, y, crossing.width_m, 0.5, "white")
    beside_m = crossing.lane_centre_m - vehicle.width_m / 2
    block(x_m - vehicle.length_m, beside_m, vehicle.length_m, vehicle.width_m, BLUE)
    for y in people_y_m:
        axes.add_patch(Circle((0.0, y), 0.3, color=ORANGE, lw=0, antialiased=False))
    pixels = io.BytesIO()
    figure.savefig(pixels, format="raw", dpi=10)
    return np.frombuffer(pixels.getvalue(), np.uint8).reshape(size[1], size[0], 4)[..., :3]
