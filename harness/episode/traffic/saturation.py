"""Late vehicles: whether more come to a crosswalk than get through, and how long queues last."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from harness.core.encounter import FloatArray

GROWTH = 0.05
"""A road is saturated where its late vehicles grow by more than this share of what arrives, and by
more than chance."""

CHANCE = 0.01
"""How often a road on which nothing grows may exceed the bound of chance."""

DEPARTURES = 1.5
"""Variance of the vehicles that a lane lets through, over their number (docs/method.md)."""


@dataclass(frozen=True, slots=True)
class Growth:
    """By how much late vehicles grow, over what arrives meanwhile, and what chance alone explains.

    Both None where nobody arrives.
    """

    share: float | None
    bound: float | None

    @property
    def saturated(self) -> bool:
        """Whether the growth is beyond ``GROWTH`` and beyond chance."""
        if self.share is None or self.bound is None:
            return False
        return self.share > max(GROWTH, self.bound)


def least_late(due_s: FloatArray, left_s: FloatArray, begin_s: float, end_s: float) -> int:
    """The least number of vehicles that are late at any second from ``begin_s`` to ``end_s``.

    Args:
        due_s: when each is due through, without whoever is in time.
        left_s: when each was through, infinite for who never was.
        begin_s: the first second.
        end_s: the last.

    >>> least_late(np.array([1.0, 2.0, 5.0]), np.array([4.0, math.inf, 6.0]), 2.0, 8.0)
    1
    """
    seconds = np.arange(begin_s, end_s + 1e-9)
    late = np.searchsorted(np.sort(due_s), seconds, "right")
    return int((late - np.searchsorted(np.sort(left_s), seconds, "right")).min())


def longest_queue_s(due_s: FloatArray, left_s: FloatArray, end_s: float) -> float:
    """The longest time for which a vehicle was late at every moment.

    A queue that has cleared goes on as one that begins empty: the longest that it took to clear
    tells how long it remembers (docs/method.md).

    Args:
        due_s: when each vehicle that was late was due through, in any order.
        left_s: when each was through, infinite for who never was.
        end_s: when nobody looked any more.

    >>> due_s, left_s = np.array([5.0, 0.0, 60.0]), np.array([25.0, 10.0, 90.0])
    >>> longest_queue_s(due_s, left_s, 80.0)  # from 0 to 25 s, and from 60 to 80 s
    25.0
    """
    order = np.argsort(due_s)
    due, until = due_s[order], np.minimum(np.maximum.accumulate(left_s[order]), end_s)
    if not len(due):
        return 0.0
    first = np.append(True, due[1:] > until[:-1])
    last = np.append(first[1:], True)
    return float((until[last] - due[first]).max())


def growth_of(growths: FloatArray, arrivals: FloatArray, lanes: int) -> Growth:
    """The growth of late vehicles from the first half of the hours to the second.

    Args:
        growths: the least number late in the second half less that in the first, of each hour.
        arrivals: vehicles due through within half of the counted time, of each hour.
        lanes: those on which vehicles come.

    Derivation: docs/method.md.

    >>> growth_of(np.array([30.0]), np.array([150.0]), 2)  # 2.33 √(4 · 150) = 57
    Growth(share=0.2, bound=0.379...)
    """
    total = float(np.sum(arrivals))
    if total == 0:
        return Growth(None, None)
    error = math.sqrt((1 + DEPARTURES * lanes) * total)
    return Growth(float(np.sum(growths)) / total, float(special.ndtri(1 - CHANCE)) * error / total)
