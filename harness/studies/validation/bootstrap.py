"""Resamples of recorded vehicles, and how far intervals from them can be trusted."""

from collections.abc import Sequence

import numpy as np
from scipy import special

from harness.core.seeding import resampling
from harness.studies.validation.passages import Passage

RESAMPLES = 1_000
"""Bootstrap resamples of vehicles."""

_TRUSTED = 0.935
"""Intervals that hold less often are called too narrow, as those of a run are."""


def resamples(passages: Sequence[Passage], seed: int) -> list[np.ndarray]:
    """Passages of vehicles drawn with replacement, ``RESAMPLES`` times; none of a single vehicle.

    One vehicle says nothing of how others differ from it.
    """
    vehicles = list(dict.fromkeys(passage.vehicle_id for passage in passages))
    if len(vehicles) < 2:
        return []
    numbers = np.array([vehicles.index(passage.vehicle_id) for passage in passages])
    passages_of = [np.flatnonzero(numbers == number) for number in range(len(vehicles))]
    rng = resampling(seed, "validation")
    draws = rng.integers(0, len(vehicles), (RESAMPLES, len(vehicles)))
    return [np.concatenate([passages_of[vehicle] for vehicle in draw]) for draw in draws.tolist()]


def few_vehicles(vehicles: int) -> str | None:
    """Why intervals over so few vehicles are unreliable; None where they hold 93.5 % or more.

    The percentiles of the bootstrap of a mean lie √((n − 1)/n) · 1.96 standard errors about it,
    where Student's t asks for more: of normal values they hold P(|t| < that), with n − 1 degrees
    of freedom, and less of skewed ones.

    >>> few_vehicles(5)
    'Intervals rest on 5 vehicles: too narrow, of a mean they hold 85 % at most, not 95 %.'
    >>> few_vehicles(30)
    """
    if vehicles < 2:
        return "One vehicle: no intervals, and no two drivers can be told apart."
    reach = special.ndtri(0.975) * np.sqrt((vehicles - 1) / vehicles)
    holds = float(2 * special.stdtr(vehicles - 1, reach) - 1)
    if holds >= _TRUSTED:
        return None
    return (
        f"Intervals rest on {vehicles} vehicles: too narrow, of a mean they hold "
        f"{100 * holds:.0f} % at most, not 95 %."
    )


def middle(values: Sequence[float | None]) -> tuple[float, float] | None:
    """The middle 95 % of resampled values; None where one is undefined, or there is none."""
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return None
    low, high = np.quantile(known, [0.025, 0.975])
    return float(low), float(high)
