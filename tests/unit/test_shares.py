"""Which vehicles are AVs: by their ids alone, nested in the share; and SUMO's seeds."""

import math
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, strategies as some

from harness.core.seeding import SUMO_SEEDS_APART, stream, sumo_seed
from harness.simulation.traffic_counts import TrafficCounts


def is_automated(key: bytes, name: str, share: float, kind: str = "passenger") -> bool:
    cars = SimpleNamespace(av_share=share, av_types=("passenger",))
    counts: Any = SimpleNamespace(_setup=SimpleNamespace(simulation=cars), _classes={}, _key=key)
    return TrafficCounts.is_automated(counts, name, kind)


@given(some.binary(min_size=32, max_size=32), some.text(), some.floats(0, 1), some.floats(0, 1))
def test_a_greater_share_only_adds_avs(key: bytes, name: str, one: float, other: float) -> None:
    low, high = sorted((one, other))
    assert is_automated(key, name, low) <= is_automated(key, name, high)
    assert not is_automated(key, name, 0.0)
    assert is_automated(key, name, 1.0)
    assert not is_automated(key, name, 1.0, "bus")


def test_the_share_of_many_vehicles() -> None:
    """Numbers are uniform: 3 standard errors of a proportion; another seed or pair draws others."""
    keys = (stream(of, "automated", n).bytes(32) for of, n in ((1, 0), (2, 0), (1, 2**31)))
    one, *others = ({n for n in range(4000) if is_automated(key, f"car{n}", 0.3)} for key in keys)
    for found, share in ((one, 0.3), *((one & other, 0.09) for other in others)):
        assert abs(len(found) / 4000 - share) < 3 * math.sqrt(share * (1 - share) / 4000)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 2**31, 2**63 - 2])
def test_sumo_has_other_seeds_for_another_seed(seed: int) -> None:
    """With the most pairs the seeds of successive values do not overlap, and SUMO takes all."""
    assert 0 <= sumo_seed(seed, 7, 0) < 2**31
    apart = (sumo_seed(seed + 1, 7, 0) - sumo_seed(seed, 7, 0)) % 2**31
    assert SUMO_SEEDS_APART <= apart <= 2**31 - SUMO_SEEDS_APART
    # The default is the configuration's own seed.
    assert sumo_seed(1, 7, 0) == 7
