"""Closed forms against published values, sums written out, and simulations of their own models."""

import math

import numpy as np

from harness.measures.queues import level_of_service
from tests import closed_forms as forms


def test_levels_of_service_are_the_handbooks() -> None:
    """HCM 2010, exhibit 19-2: up to 5, 10, 20, 30 and 45 s."""
    assert [level_of_service(s) for s in (0, 5, 5.1, 45, 46)] == ["A", "A", "B", "E", "F"]


def test_gap_wait_is_what_waiting_people_find() -> None:
    """People at random times look for the first gap of at least 5 s in a random stream."""
    rng, flow, gap = np.random.default_rng(5), 0.2, 5.0
    cars = np.cumsum(rng.exponential(1 / flow, 400_000))
    arrivals = np.sort(rng.uniform(0, cars[-1000], 100_000))
    # From the arrival itself, or from a car with a long enough headway behind it.
    following = np.diff(cars) >= gap
    goes = np.append(np.where(following, np.arange(len(following)), len(cars)), len(cars))
    first_free = np.minimum.accumulate(goes[::-1])[::-1]
    nxt = np.searchsorted(cars, arrivals)
    lag = cars[nxt] - arrivals
    waits = np.where(lag >= gap, 0.0, cars[first_free[nxt]] - arrivals)
    error = waits.std() / math.sqrt(len(waits)) * 2  # neighbours share gaps
    assert abs(waits.mean() - forms.gap_wait_s(flow, gap)) < 3 * error
