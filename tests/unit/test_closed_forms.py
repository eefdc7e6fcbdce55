"""Closed forms against published values, sums written out, and simulations of their own models."""

import math

import numpy as np
import pytest

from harness.measures.queues import level_of_service
from tests import closed_forms as forms


def hcm_sum(v: float, t: float, lanes: int, rate: float, headway: float, events: int) -> float:
    """The handbook's sum, term by term."""
    blocked = 1 - math.exp(-t * v / lanes)
    delayed = 1 - (1 - blocked) ** lanes
    gap = (math.exp(v * t) - v * t - 1) / v / delayed
    left, total = delayed, 0.0
    for event in range(1, events + 1):
        chance = ((1 - blocked + blocked * rate) ** lanes - (1 - blocked) ** lanes) / delayed
        total += headway * (event - 0.5) * left * chance
        left -= left * chance
    return total + left * gap


def test_published_examples_and_limits() -> None:
    v = 850 / 3600
    assert forms.revised_hcm_delay_s(v, 8.0, 2, 0.5) == pytest.approx(4.74, abs=0.005)
    assert forms.hcm_delay_s(v, 8.0, 2, 0.5) == pytest.approx(9.83, abs=0.005)
    assert math.isfinite(forms.revised_hcm_delay_s(1.0, 800.0, 2, 0.9))
    assert forms.revised_hcm_delay_s(1.0, 800.0, 2, 0.0) == math.inf
    assert [level_of_service(s) for s in (0, 5, 5.1, 45, 46)] == ["A", "A", "B", "E", "F"]


@pytest.mark.parametrize("rate", [0.0, 0.3, 0.9])
@pytest.mark.parametrize("lanes", [1, 2, 4])
def test_yielding_is_the_sum_written_out(lanes: int, rate: float) -> None:
    v, t = 600 / 3600, 7.0
    revised = (1 / v - (t + 1 / v) * math.exp(-v * t)) / (1 - math.exp(-v * t))
    wanted = hcm_sum(v, t, lanes, rate, revised, int(math.exp(v * t)))
    assert forms.revised_hcm_delay_s(v, t, lanes, rate) == pytest.approx(wanted, rel=1e-12)
    delayed = 1 - math.exp(-v * t)
    events = int(forms.gap_wait_s(v, t) / delayed / (lanes / v))
    wanted = hcm_sum(v, t, lanes, rate, lanes / v, events)
    assert forms.hcm_delay_s(v, t, lanes, rate) == pytest.approx(wanted, rel=1e-12)


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


def test_plain_capacity_is_the_sum_and_the_limit() -> None:
    lam, block, first, headway = 0.1, 6.0, 1.0, 2.0
    steps = [first + k * headway for k in range(2000)]
    exact = forms.priority_capacity_per_s(lam, block, steps)
    plain = forms.plain_priority_capacity_per_s(lam, block, first, headway)
    assert plain == pytest.approx(exact, rel=1e-12)
    nobody = forms.plain_priority_capacity_per_s(0.0, block, first, headway)
    assert forms.plain_priority_capacity_per_s(1e-9, block, first, headway) == pytest.approx(nobody)


def test_capacity_is_what_a_queue_gets_through() -> None:
    """A queue before people who each block for 6 s; a vehicle goes 2 s after the one before."""
    rng, lam, block, headway = np.random.default_rng(7), 0.1, 6.0, 2.0
    people = np.cumsum(rng.exponential(1 / lam, 200_000))
    free_s = np.maximum(np.diff(people) - block, 0.0)
    through = np.ceil(free_s / headway)  # one at the very beginning of the free time
    seen = through.sum() / people[-1]
    wanted = forms.plain_priority_capacity_per_s(lam, block, 0.0, headway)
    assert seen == pytest.approx(wanted, rel=0.01)


def test_a_group_needs_longer_than_one() -> None:
    alone = forms.group_headway_s(0.2, 0.0, 8.0, 3.0)
    assert alone == pytest.approx(8.0)
    # N_c by hand: v_p = 0.1, v = 0.2, t = 8: (0.1 e^0.8 + 0.2 e^-1.6)/(0.3 e^-0.8) = 1.9507.
    people = (0.1 * math.exp(0.8) + 0.2 * math.exp(-1.6)) / (0.3 * math.exp(-0.8))
    wanted = 8.0 + 2 * (max(2.4384 * people / 3.0, 1.0) - 1)
    assert forms.group_headway_s(0.2, 0.1, 8.0, 3.0) == pytest.approx(wanted)
