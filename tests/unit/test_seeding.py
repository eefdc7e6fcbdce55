"""Named random streams: the same numbers for the same name, unrelated ones for another."""

import itertools

import numpy as np
import pytest
from scipy import stats

from harness.seeding import stream

PURPOSES = ("arrival", "side", "quantile", "strategy", "critical_gap", "av_strategy")


def test_the_same_name_gives_the_same_numbers() -> None:
    first = stream(7, "quantile", 3).random(100)
    stream(7, "quantile", 4).random(50)  # whatever is drawn elsewhere in between
    np.testing.assert_array_equal(first, stream(7, "quantile", 3).random(100))


def test_longer_draws_begin_like_shorter_ones() -> None:
    # Pedestrian i keeps their numbers when more pedestrians are planned.
    np.testing.assert_array_equal(
        stream(1, "side", 0).random(5), stream(1, "side", 0).random(500)[:5]
    )


@pytest.mark.parametrize("seed", [0, 1, 2**32 - 1, 2**63 - 1])
def test_every_name_has_its_own_numbers(seed: int) -> None:
    names = itertools.product((seed, seed // 2 + 5), PURPOSES, range(40))
    first = {stream(root, purpose, pair).random() for root, purpose, pair in names}
    assert len(first) == 2 * len(PURPOSES) * 40


def test_pairs_are_independent_and_uniform() -> None:
    numbers = np.array([stream(5, "quantile", pair).random(2) for pair in range(4000)])
    assert stats.kstest(numbers[:, 0], "uniform").pvalue > 1e-3
    # Independent numbers correlate by less than 4/√n.
    for one, other in (
        (numbers[:, 0], numbers[:, 1]),
        (numbers[:-1, 0], numbers[1:, 0]),
        (numbers[:, 0], [stream(5, "side", pair).random() for pair in range(4000)]),
    ):
        assert abs(np.corrcoef(one, other)[0, 1]) < 4 / np.sqrt(4000)
