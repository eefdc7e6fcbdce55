"""Converts people's recorded positions to the network's coordinates, with their accuracy."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from harness.core.encounter import FloatArray
from harness.core.errors import InputError
from harness.site import Crosswalk, RoadNetwork

if TYPE_CHECKING:
    import pandas as pd

_MOST_DECIMALS = 7
_METRES_PER_DEGREE = 111_320.0
_BESIDE_M = 3.0
"""Tolerated distance in m from the crosswalk.  SUMO's people may walk beside their lane."""
_MOST_BESIDE = 0.1
"""Tolerated share of the records that are farther from the crosswalk."""


def in_network(
    people: "pd.DataFrame", network: RoadNetwork, crosswalks: Sequence[Crosswalk], net: Path
) -> tuple["pd.DataFrame", float, bool]:
    """Return the records of people in the network's coordinates.

    Args:
        people: records of ``read_recorded``.
        network: the simulation's network.
        crosswalks: the crosswalks with the ways over them.
        net: the network's file, for messages.

    Returns:
        The records, the rounding error of a position in m, and whether the file contains
        longitudes and latitudes.

    Raises:
        InputError: people on a crosswalk are recorded elsewhere.
    """
    x, y = people["x"].to_numpy(float), people["y"].to_numpy(float)
    unit = 10.0 ** -min(_decimals(x), _decimals(y))
    rounding = 0.0 if unit <= 10.0**-_MOST_DECIMALS else unit / math.sqrt(2)
    if _beside(people, crosswalks, x, y) <= _MOST_BESIDE:
        return people, rounding, False
    on_earth = bool(np.all(np.abs(x) <= 180) and np.all(np.abs(y) <= 90))
    places = network.from_the_ground(x, y) if on_earth else None
    if places is None or _beside(people, crosswalks, *places) > _MOST_BESIDE:
        problem = "the people on its crosswalks are recorded elsewhere"
        allowed = "the network of this simulation"
        raise InputError(str(net), problem, allowed)
    moved = people.assign(x=places[0], y=places[1])
    return moved, rounding * _METRES_PER_DEGREE, True


def _decimals(values: FloatArray) -> int:
    """Return the number of decimals of a file's numbers."""
    sample = values[:: max(1, len(values) // 1000)]
    for digits in range(_MOST_DECIMALS):
        if np.all(np.abs(sample - sample.round(digits)) < 10.0 ** -(_MOST_DECIMALS + 2)):
            return digits
    return _MOST_DECIMALS


def _beside(
    people: "pd.DataFrame", crosswalks: Sequence[Crosswalk], x_m: FloatArray, y_m: FloatArray
) -> float:
    """Return the share of records on a crossing's edge whose position is not on the crossing."""
    beside, all_of_them = 0, 0
    edges = people["edge"].to_numpy()
    for crosswalk in crosswalks:
        on = edges == crosswalk.id
        if not crosswalk.ways or not on.any():
            continue
        way = crosswalk.ways[0]
        along, across = way.frame.to_road(x_m[on], y_m[on])
        far = np.abs(along) > crosswalk.width_m / 2 + _BESIDE_M
        far |= (across < -_BESIDE_M) | (across > crosswalk.length_m + _BESIDE_M)
        beside, all_of_them = beside + int(far.sum()), all_of_them + int(on.sum())
    return beside / all_of_them if all_of_them else 0.0
