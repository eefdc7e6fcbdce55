"""Queues of known load at a crosswalk with absolute priority: a simulation of the method itself."""

import math

import numpy as np

from tests.closed_forms import plain_priority_capacity_per_s

HEADWAY_S = 2.0
BEHIND_S = 37.0
"""How long after its schedule a vehicle would be through: 300 m at 8 m/s."""


def due_and_left(
    hours: int,
    load: float,
    end_s: float,
    *,
    pedestrians_per_hour: float = 1000.0,
    block_s: float = 8.0,
    lanes: int = 2,
    seed: int = 1,
) -> tuple[np.ndarray, np.ndarray]:
    """When vehicles are due through, and are, in hours of ``load`` times the capacity.

    Shape (hours, vehicles); who would come after ``end_s`` has infinite times.
    People come at random and block all lanes for ``block_s`` each; the queue of a lane moves up
    by a headway.  Its capacity has a closed form, λ e^{−λτ}/(1 − e^{−λh}) (tested elsewhere).
    """
    rng, rate = np.random.default_rng(seed), pedestrians_per_hour / 3600
    flow = load * plain_priority_capacity_per_s(rate, block_s, 0.0, HEADWAY_S)
    last_s = 4 * end_s + 4000  # after which nobody is followed any more
    apart_s = last_s + 1000 + np.arange(hours) * (last_s + 1000)
    begins, ends = [np.array([-2.0])], [np.array([-1.0])]
    for apart in apart_s:
        people = apart + np.sort(rng.uniform(0, last_s, rng.poisson(rate * last_s)))
        # A block lasts until nobody has come for block_s.
        first = np.append(True, np.diff(people) > block_s)
        begins.append(people[first])
        ends.append(people[np.append(first[1:], True)] + block_s)
    block_begins, block_ends = np.concatenate(begins), np.concatenate(ends)
    due, left = [], []
    for _ in range(lanes):
        count = int(flow * end_s + 6 * math.sqrt(flow * end_s) + 10)
        scheduled = np.cumsum(rng.exponential(1 / flow, (hours, count)), axis=1)
        through = np.empty_like(scheduled)
        before = np.full(hours, -math.inf)
        for number in range(count):
            ready = np.maximum(scheduled[:, number] + BEHIND_S, before + HEADWAY_S) + apart_s
            block = np.searchsorted(block_begins, ready, "right") - 1
            before = np.maximum(ready, block_ends[block]) - apart_s
            through[:, number] = before
        due.append(np.where(scheduled < end_s, scheduled + BEHIND_S, math.inf))
        left.append(np.where(scheduled < end_s, through, math.inf))
    return np.hstack(due), np.hstack(left)
