"""Named random streams: the same numbers for the same name, unrelated ones for another."""

import itertools
from typing import get_args

import numpy as np
import pytest
from scipy import stats

from harness.core.seeding import GivenFirst, Purpose, Resampled, resampling, stream
from harness.core.vocabulary import Arm
from harness.encounter.arms import make_strategy
from harness.model.interaction import InteractionModel
from tests.scenes import scenario

PURPOSES = get_args(Purpose)


@pytest.mark.parametrize("seed", [0, 1, 2**32 - 1, 2**63 - 1])
def test_every_name_has_its_own_numbers(seed: int) -> None:
    roots, others = (seed, seed // 2 + 5), get_args(Resampled)
    names = itertools.product(roots, PURPOSES, range(40))
    first = {stream(root, purpose, pair).random() for root, purpose, pair in names}
    first |= {resampling(root, each).random() for root in roots for each in others}
    assert len(first) == 2 * (len(PURPOSES) * 40 + len(others))


def test_purposes_keep_their_numbers() -> None:
    """Named last, it moves with any change of those before it."""
    seeds = np.random.SeedSequence(5, spawn_key=(24, 3))
    assert stream(5, "start_of_fit", 3).random() == np.random.default_rng(seeds).random()


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


class Keeps:
    """Keeps the generator that a strategy is given."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def decide(self, _seen: object) -> float:
        return 0.0


def test_a_strategy_is_given_the_streams_numbers_and_not_its_seed(model: InteractionModel) -> None:
    scene = scenario(arms={"av": f"{__name__}:Keeps"}, experiment={"seed": 987_654})
    made: list = [make_strategy(scene, Arm.AV, pair, model) for pair in (7, 8)]
    rng, other = (strategy.rng for strategy in made)
    seeds = rng.bit_generator.seed_seq
    assert {987_654, 7}.isdisjoint([*np.ravel(seeds.entropy), *seeds.spawn_key])
    assert rng.random() == stream(987_654, "av_strategy", 7).random()
    assert rng.spawn(1)[0].random() != other.spawn(1)[0].random()


@pytest.mark.parametrize("size", [None, 1, 2, 3, (2, 2)])
def test_the_first_draws_of_random_can_be_given(size: int | None) -> None:
    """Later draws, and what other methods draw, are those of the stream."""
    given = GivenFirst(stream(3, "strategy", 5).bit_generator, (0.25, 0.75))
    own = stream(3, "strategy", 5)
    drawn = np.append([given.random(size) for _ in range(4)], [])
    np.testing.assert_array_equal(drawn[:2], [0.25, 0.75])
    np.testing.assert_array_equal(drawn[2:], own.random(drawn.size)[2:])
    assert given.standard_normal() == own.standard_normal()
    assert given.spawn(1)[0].random() == own.spawn(1)[0].random()
