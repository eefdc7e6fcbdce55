"""A moment of an episode in; its picture from above out."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Crossing, Vehicle

PIXELS_PER_M = 10
BESIDE_M = 2.0
"""Ground shown next to the road, and road shown beyond the ego's last position."""

STRIPE_M = 0.5
GROUND, ROAD, PAINT = (225, 228, 220), (96, 98, 102), (245, 245, 245)
EGO, PERSON = (0, 114, 178), (230, 159, 0)
"""Okabe and Ito's blue and orange."""

Picture = NDArray[np.uint8]


def top_view(
    vehicle: Vehicle, crossing: Crossing, x_m: float, people: Iterable[tuple[float, float]]
) -> Picture:
    """The road with the ego, which drives to the right, and the pedestrians.

    Args:
        vehicle: the ego.
        crossing: the crosswalk.
        x_m: x of the ego's front bumper.
        people: (x, y) in m of each pedestrian.

    Returns:
        RGB, shape (height, width, 3), at 10 pixels per metre.  Height and width are even, because
        video formats need that.
    """
    left = -vehicle.trigger_range_m - vehicle.length_m
    right = crossing.width_m / 2 + vehicle.length_m + BESIDE_M
    low, high = -BESIDE_M, crossing.length_m + BESIDE_M
    x = np.arange(left, right, 2 / PIXELS_PER_M).repeat(2)[None, :]
    # The kerb on the ego's right, y = 0, is below.
    y = np.arange(high, low, -2 / PIXELS_PER_M).repeat(2)[:, None]
    x = x + np.arange(x.size)[None, :] % 2 / PIXELS_PER_M
    y = y - np.arange(y.size)[:, None] % 2 / PIXELS_PER_M
    picture = np.full((y.size, x.size, 3), GROUND, dtype=np.uint8)
    on_road = (y >= 0) & (y <= crossing.length_m)
    picture[np.broadcast_to(on_road, picture.shape[:2])] = ROAD
    edge_y = crossing.lane_centre_m + np.array([-0.5, 0.5]) * crossing.lane_width_m
    dashes = (np.abs(y - edge_y[0]) < 0.1) | (np.abs(y - edge_y[1]) < 0.1)
    picture[dashes & on_road & (x % 3 < 1.5)] = PAINT
    zebra = (np.abs(x) <= crossing.width_m / 2) & on_road & (y % (2 * STRIPE_M) < STRIPE_M)
    picture[zebra] = PAINT
    beside = np.abs(y - crossing.lane_centre_m) <= vehicle.width_m / 2
    picture[beside & (x <= x_m) & (x >= x_m - vehicle.length_m)] = EGO
    for their_x, their_y in people:
        picture[np.hypot(x - their_x, y - their_y) <= PEDESTRIAN_RADIUS_M + 0.05] = PERSON
    return picture
