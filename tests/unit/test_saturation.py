"""Whether a road is saturated and how long it warms up, held by queues of known load."""

import math

import numpy as np
import pytest

from harness.encounter.traffic.saturation import Growth, growth_of, least_late
from tests.queues import due_and_left


def queues(
    hours: int, load: float, duration_s: float, warm_up_s: float, **road: float
) -> tuple[np.ndarray, np.ndarray]:
    """Growth and arrivals of hours whose vehicles come at ``load`` times the capacity."""
    end_s = warm_up_s + duration_s
    due, left = due_and_left(hours, load, end_s, **road)  # type: ignore[arg-type]
    half_s = warm_up_s + duration_s / 2
    growths = [
        least_late(*times, half_s, end_s) - least_late(*times, warm_up_s, half_s)
        for times in zip(due, left, strict=True)
    ]
    counted = (due > warm_up_s) & (due <= end_s)
    return np.array(growths, dtype=float), counted.sum(axis=1) / 2


def share_saturated(growths: np.ndarray, arrivals: np.ndarray, hours: int, lanes: int = 2) -> float:
    """The share of runs of so many hours that are called saturated."""
    whole = len(growths) // hours * hours
    runs = zip(growths[:whole].reshape(-1, hours), arrivals[:whole].reshape(-1, hours), strict=True)
    return float(np.mean([growth_of(*run, lanes).saturated for run in runs]))


CALM = [(60.0, 0.0), (60.0, 300.0), (300.0, 0.0), (900.0, 300.0), (3600.0, 0.0), (3600.0, 600.0)]


@pytest.mark.parametrize(("duration_s", "warm_up_s"), CALM[:4])
def test_a_road_below_its_capacity_is_not_saturated(duration_s: float, warm_up_s: float) -> None:
    """At 0.8 of the capacity at most 1 % of runs of 1, 5 and 30 hours say so."""
    found = queues(3000, 0.8, duration_s, warm_up_s)
    for hours in (1, 5, 30):
        assert share_saturated(*found, hours) <= 0.01


def test_a_road_beyond_its_capacity_is_found_in_five_hours() -> None:
    """At 1.25 of it in 95 % of runs at least, where it is 250 vehicles per hour and lane."""
    found = queues(2000, 1.25, 3600.0, 300.0)
    assert share_saturated(*found, 5) >= 0.95
    # One hour finds a part: it says little by itself.
    assert 0.1 < share_saturated(*found, 1) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pedestrians_per_hour", "block_s", "lanes"),
    [(1000.0, 8.0, 2), (250.0, 10.0, 2), (500.0, 12.0, 4), (100.0, 10.0, 1), (1000.0, 8.0, 4)],
)
def test_the_rule_on_many_roads(pedestrians_per_hour: float, block_s: float, lanes: int) -> None:
    """The same of five roads, with 9,000 or 3,000 hours each; 3 % of 30 hours are chance."""
    road = {"pedestrians_per_hour": pedestrians_per_hour, "block_s": block_s, "lanes": lanes}
    for duration_s, warm_up_s in CALM:
        count = 9000 if duration_s <= 300 else 3000
        found = queues(count, 0.8, duration_s, warm_up_s, seed=2, **road)
        assert share_saturated(*found, 1, lanes) <= 0.01
        assert share_saturated(*found, 5, lanes) <= 0.01
        assert share_saturated(*found, 30, lanes) <= 0.03
    found = queues(3000, 1.25, 3600.0, 300.0, seed=3, **road)
    assert share_saturated(*found, 5, lanes) >= 0.95


def test_growth_by_hand() -> None:
    due = np.arange(37.0, 60.0, 4.6)
    assert least_late(due, due, 30.0, 60.0) == least_late(due, due, 0.0, 30.0) == 0
    one = growth_of(np.array([50.0]), np.array([250.0]), 1)
    assert one.bound == pytest.approx(2.3263 * math.sqrt(2.5 * 250) / 250, rel=1e-4)
    assert one == Growth(0.2, one.bound)
    assert not one.saturated
    four = growth_of(np.full(4, 50.0), np.full(4, 250.0), 1)
    assert four.bound == pytest.approx(0.2326 / 2, rel=1e-3)
    assert four.saturated
    # Beyond chance is not enough.
    assert not growth_of(np.full(400, 12.0), np.full(400, 250.0), 1).saturated
    assert growth_of(np.zeros(3), np.zeros(3), 1) == Growth(None, None)
    assert not Growth(None, None).saturated


END_S = 7200.0
