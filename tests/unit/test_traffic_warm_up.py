"""How long a road takes to forget how it began."""

import numpy as np
import pytest

from harness.episode.traffic.saturation import longest_queue_s
from tests.queues import BEHIND_S, due_and_left

END_S = 7200.0


@pytest.mark.parametrize(
    ("load", "longest_s", "missed"), [(0.3, 900.0, 0.03), (0.7, 1800.0, 0.04), (0.9, 3600.0, 0.06)]
)
def test_queues_of_known_load(load: float, longest_s: float, missed: float) -> None:
    """After a pilot the next hour misses no more of the long run's delay than after an hour.

    250 people per hour, 10 s each: at 0.9 of the capacity 9 % is missed after 300 s.  And a road
    with little to forget is not warmed up for an hour.
    """
    road = {"pedestrians_per_hour": 250.0, "block_s": 10.0}
    due, left = due_and_left(300, load, 3 * 3600.0, seed=5, **road)  # type: ignore[arg-type]
    came = np.isfinite(due)
    scheduled, delays = due - BEHIND_S, np.where(came, left, 0) - np.where(came, due, 0)

    def mean(begin_s: float) -> float:
        own = (scheduled >= begin_s) & (scheduled < begin_s + 3600)
        return float(delays[own].mean())

    pilots = []
    for times, ends in zip(due, left, strict=True):
        own = (times < END_S + BEHIND_S) & (ends > times + 0.1)
        longest = longest_queue_s(times[own], ends[own], END_S + BEHIND_S)
        pilots.append(min(300 * np.ceil(longest / 300), 3600.0))
    assert np.quantile(pilots, 0.9) <= longest_s
    after = np.mean([mean(begin_s) for begin_s in pilots])
    assert abs(1 - after / mean(END_S)) <= missed
    assert after >= mean(3600.0) - 0.03 * mean(END_S)


def test_by_hand() -> None:
    """From 10 to 40 s in turns, and one who never gets through; nobody late is no queue."""
    due = np.array([30.0, 10.0, 20.0, 100.0])
    left = np.array([40.0, 22.0, 35.0, np.inf])
    assert longest_queue_s(due, left, 105.0) == 30.0
    assert longest_queue_s(due, left, 300.0) == 200.0
    # One who was through before, but came later, ends nothing.
    assert longest_queue_s(np.array([0.0, 5.0, 50.0]), np.array([60.0, 6.0, 70.0]), 99.0) == 70.0
    assert longest_queue_s(np.array([]), np.array([]), 99.0) == 0.0
