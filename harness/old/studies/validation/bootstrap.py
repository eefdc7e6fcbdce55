"""Resamples the vehicles of passages, and warns if there are too few vehicles."""

from collections.abc import Sequence

import numpy as np
from scipy import special

from harness.core.seeding import resampling
from harness.old.studies.validation.passages import Passage

RESAMPLES = 1_000
"""Number of bootstrap resamples of vehicles."""

_TRUSTED = 0.935
"""An interval with lower coverage is called unreliable, as in a run."""


def resamples(passages: Sequence[Passage], seed: int) -> list[np.ndarray]:
    """Draw vehicles with replacement, ``RESAMPLES`` times, and return their passages.

    The result is empty for a single vehicle, because it does not show how vehicles differ.
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
    """Return why intervals over few vehicles are unreliable; None if they cover 93.5 % or more.

    The percentiles of a mean's bootstrap lie √((n − 1)/n) · 1.96 standard errors from the mean,
    closer than Student's t requires.  For normal values their coverage is P(|t| < that limit) with
    n − 1 degrees of freedom; for skewed values it is lower.

    >>> few_vehicles(5)
    'Intervals from 5 vehicles are unreliable: they cover a mean in at most 85 %, not 95 %.'
    >>> few_vehicles(30)
    """
    if vehicles < 2:
        return "One vehicle gives no intervals, so no difference between drivers is significant."
    reach = special.ndtri(0.975) * np.sqrt((vehicles - 1) / vehicles)
    coverage = float(2 * special.stdtr(vehicles - 1, reach) - 1)
    if coverage >= _TRUSTED:
        return None
    return (
        f"Intervals from {vehicles} vehicles are unreliable: they cover a mean in at most "
        f"{100 * coverage:.0f} %, not 95 %."
    )


def middle(values: Sequence[float | None]) -> tuple[float, float] | None:
    """Return the middle 95 % of resampled values; None if there are none or one is undefined."""
    defined = [value for value in values if value is not None]
    if not defined or len(defined) < len(values):
        return None
    low, high = np.quantile(defined, [0.025, 0.975])
    return float(low), float(high)
