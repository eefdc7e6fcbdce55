"""Named random streams: the same numbers for the same name, unrelated ones for another."""

import itertools

import numpy as np
import pytest
from scipy import stats

from harness.core.seeding import beginning_with, has_drawn_more, stream
from harness.simulation.opening import sumo_seed

PURPOSES = ("arrival", "side", "quantile", "strategy", "critical_gap", "av_strategy")


def test_the_same_name_gives_the_same_numbers_however_many_are_drawn() -> None:
    first = stream(7, "quantile", 3).random(100)
    stream(7, "quantile", 4).random(50)  # whatever is drawn elsewhere in between
    np.testing.assert_array_equal(first, stream(7, "quantile", 3).random(100))
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


def test_the_first_draws_of_a_generator_can_be_given() -> None:
    """PCG64's state is solved for its first two words; what follows is as random as before."""
    given = np.random.default_rng(1).random((4_000, 2))
    drawn = np.array(
        [
            beginning_with(pair, stream(1, "strategy", k)).random(4)
            for k, pair in enumerate(given.tolist())
        ]
    )
    # random() has 53 bits.
    np.testing.assert_allclose(drawn[:, :2], given, rtol=0, atol=2**-53)
    # Known chances of a false alarm: 1 in 1,000 each.
    assert stats.kstest(drawn[:, 2:].ravel(), "uniform").pvalue > 1e-3
    correlations = np.corrcoef(drawn.T)[np.triu_indices(4, 1)]
    assert np.abs(correlations).max() < stats.norm.isf(1e-3 / 12) / np.sqrt(len(drawn))
    # A normal drawn first is one too: its word's lower bits are drawn.
    normal = [
        beginning_with(pair, stream(1, "strategy", k)).standard_normal()
        for k, pair in enumerate(given.tolist())
    ]
    assert stats.kstest(normal, "norm").pvalue > 1e-3


def test_without_given_draws_a_generator_is_its_stream() -> None:
    np.testing.assert_array_equal(
        beginning_with((), stream(3, "strategy", 5)).random(9), stream(3, "strategy", 5).random(9)
    )
    one = beginning_with((0.25,), stream(3, "strategy", 5))
    assert one.random() == 0.25
    # Children are those of the stream.
    assert one.spawn(1)[0].random() == stream(3, "strategy", 5).spawn(1)[0].random()


@pytest.mark.parametrize("draws", range(5))
def test_who_draws_more_than_what_is_given_is_noticed(draws: int) -> None:
    def begun() -> np.random.Generator:
        return beginning_with((0.1, 0.9), stream(3, "strategy", 5))

    rng = begun()
    rng.random(draws)
    assert has_drawn_more(rng, begun()) is (draws > 2)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 2**31, 2**63 - 2])
def test_sumo_has_other_seeds_for_another_seed(seed: int) -> None:
    """Below a million pairs the seeds of successive values do not overlap, and SUMO takes all."""

    def first(seed: int) -> int:
        return sumo_seed(seed, 7, 0)

    assert 0 <= first(seed) < 2**31
    apart = (first(seed + 1) - first(seed)) % 2**31
    assert 1_000_000 <= apart <= 2**31 - 1_000_000
    # The default is the configuration's own seed.
    assert first(1) == 7
