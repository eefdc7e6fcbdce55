"""Which vehicles are AVs: by their ids alone, nested in the share."""

import math

from hypothesis import given, strategies as some

from harness.simulation.shares import is_automated, uniform_of

CARS = frozenset({"passenger"})
SHARES = some.floats(0, 1)


@given(some.integers(0, 2**31), some.text(), SHARES, SHARES)
def test_a_greater_share_only_adds_avs(seed: int, name: str, one: float, other: float) -> None:
    low, high = sorted((one, other))
    if is_automated(seed, name, CARS, low, CARS):
        assert is_automated(seed, name, CARS, high, CARS)
    assert not is_automated(seed, name, CARS, 0.0, CARS)
    assert is_automated(seed, name, CARS, 1.0, CARS)
    assert not is_automated(seed, name, frozenset({"bus"}), 1.0, CARS)


def test_the_share_of_many_vehicles() -> None:
    """Numbers are uniform: 3 standard errors of a proportion; another seed draws others."""
    names = [f"car{number}" for number in range(4000)]
    for seed in (1, 2):
        found = sum(uniform_of(seed, name) < 0.3 for name in names) / len(names)
        assert abs(found - 0.3) < 3 * math.sqrt(0.3 * 0.7 / len(names))
    both = sum(uniform_of(1, name) < 0.3 > uniform_of(2, name) for name in names) / len(names)
    assert abs(both - 0.09) < 3 * math.sqrt(0.09 * 0.91 / len(names))
