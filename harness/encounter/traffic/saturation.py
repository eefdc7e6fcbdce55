"""Times when vehicles were due and passed in; growth of late vehicles and length of queues out."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from harness.core.encounter import FloatArray

GROWTH = 0.05
"""A road is saturated if its number of late vehicles grows by more than this share of the arrivals,
and by more than ``Growth.bound``."""

CHANCE = 0.01
"""Probability that a road without growth exceeds ``Growth.bound``."""

DEPARTURES = 1.5
"""Variance of the number of vehicles that pass in a lane, divided by its mean (docs/method.md)."""


@dataclass(frozen=True, slots=True)
class Growth:
    """The growth of the number of late vehicles, as a share of the arrivals.

    ``bound`` is the largest share that chance explains.  Both are None if no vehicle arrives.
    """

    share: float | None
    bound: float | None

    @property
    def saturated(self) -> bool:
        """Whether the share exceeds both ``GROWTH`` and ``bound``."""
        if self.share is None or self.bound is None:
            return False
        return self.share > max(GROWTH, self.bound)


def least_late(due_s: FloatArray, left_s: FloatArray, begin_s: float, end_s: float) -> int:
    """The smallest number of late vehicles in any second from ``begin_s`` to ``end_s``.

    Args:
        due_s: when each vehicle was due to pass; vehicles that were on time are left out.
        left_s: when each vehicle passed; infinite if it never did.
        begin_s: the first second.
        end_s: the last second.

    >>> least_late(np.array([1.0, 2.0, 5.0]), np.array([4.0, math.inf, 6.0]), 2.0, 8.0)
    1
    """
    seconds = np.arange(begin_s, end_s + 1e-9)
    late = np.searchsorted(np.sort(due_s), seconds, "right")
    return int((late - np.searchsorted(np.sort(left_s), seconds, "right")).min())


def growth_of(growths: FloatArray, arrivals: FloatArray, lanes: int) -> Growth:
    """The growth of late vehicles from the first half of the hours to the second.

    Args:
        growths: for each hour, ``least_late`` of the second half minus ``least_late`` of the first.
        arrivals: for each hour, the vehicles due to pass within half of the counted time.
        lanes: number of lanes with vehicles.

    Derivation: docs/method.md.

    >>> growth_of(np.array([30.0]), np.array([150.0]), 2)  # 2.33 √(4 · 150) = 57
    Growth(share=0.2, bound=0.379...)
    """
    total = float(np.sum(arrivals))
    if total == 0:
        return Growth(None, None)
    error = math.sqrt((1 + DEPARTURES * lanes) * total)
    return Growth(float(np.sum(growths)) / total, float(special.ndtri(1 - CHANCE)) * error / total)
