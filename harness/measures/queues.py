"""Times of many vehicles and people in; the growth of their number and levels of service out."""

import numpy as np

from harness.core.vocabulary import FloatArray

PEDESTRIAN_LOS_S = (5.0, 10.0, 20.0, 30.0, 45.0)
"""Longest mean delays of pedestrians for the levels A to E (HCM 2010, exhibit 19-2)."""


def level_of_service(delay_s: float) -> str:
    """The level of service of pedestrians, A to F, by their mean delay (HCM 2010).

    Raises:
        ValueError: the delay is NaN.

    >>> [level_of_service(delay_s) for delay_s in (5.0, 12.0, 46.0)]
    ['A', 'C', 'F']
    """
    if np.isnan(delay_s):
        raise ValueError("an undefined delay has no level of service")
    return "ABCDEF"[sum(delay_s > limit for limit in PEDESTRIAN_LOS_S)]


def growth(due_s: FloatArray, left_s: FloatArray, from_s: float, until_s: float) -> float | None:
    """By what share of the vehicles due in a third of a time a network fills.

    The means over time of the number that were due and have not arrived are compared, from the
    second third to the last.  In the first third it fills in any case.

    Args:
        due_s: times at which vehicles were due to depart, shape (k,), within the time.
        left_s: times at which they arrived; NaN if they never did.
        from_s, until_s: the time.

    Returns:
        None without a vehicle, or if mean trips are longer than a third.

    >>> due_s = np.arange(0.0, 900.0, 10.0)
    >>> growth(due_s, due_s + 60.0, 0.0, 900.0), growth(due_s, due_s * np.nan, 0.0, 900.0)
    (0.0, None)
    """
    third_s = (until_s - from_s) / 3
    left_s = np.fmin(left_s, until_s)
    if not len(due_s) or np.mean(left_s - due_s) > third_s:
        return None
    before, now = (
        float(np.sum(left_s.clip(low, low + third_s) - due_s.clip(low, low + third_s)))
        for low in (from_s + third_s, from_s + 2 * third_s)
    )
    return 3 * (now - before) / third_s / len(due_s)
