"""People's recorded places in the network's coordinates, and how far they may be off."""

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
"""How far from a crosswalk somebody on it may be: SUMO's people walk beside their lane."""
_MOST_BESIDE = 0.1
"""Which share of the records may be farther."""


def in_network(
    people: "pd.DataFrame", network: RoadNetwork, crosswalks: Sequence[Crosswalk], net: Path
) -> tuple["pd.DataFrame", float, bool]:
    """Records of people in the network's coordinates.

    Args:
        people: records of ``read_recorded``.
        network: of the simulation.
        crosswalks: with the ways over them.
        net: its file, for messages.

    Returns:
        The records, by how much a place may be off by the file's decimals (m), and whether the file
        holds longitudes and latitudes.

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
    """With how many decimals a file's numbers are written."""
    sample = values[:: max(1, len(values) // 1000)]
    for digits in range(_MOST_DECIMALS):
        if np.all(np.abs(sample - sample.round(digits)) < 10.0 ** -(_MOST_DECIMALS + 2)):
            return digits
    return _MOST_DECIMALS


def _beside(
    people: "pd.DataFrame", crosswalks: Sequence[Crosswalk], x_m: FloatArray, y_m: FloatArray
) -> float:
    """The share of records on a crossing's edge that do not lie there."""
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
