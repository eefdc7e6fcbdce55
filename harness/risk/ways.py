"""The most likely ways to the event: clusters of its draws, and the people to meet them again."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.encounter import FloatArray
from harness.episode.arrivals import planned_arrivals
from harness.perception.track import updates_until_found
from harness.risk.fitting import nearest_of, starts_of
from harness.risk.space import Space
from harness.scenario import Scenario

WAYS = 3

_ROUNDS = 50


@dataclass(frozen=True, slots=True)
class Way:
    """One way to the event.

    ``share`` is its part of the probability, ``members`` its draws by their place among all draws
    of the event, those with the most ordinary keys first: the nearest to 0.
    """

    share: float
    members: tuple[int, ...]


def ways_of(keys: FloatArray, weights: FloatArray, rng: np.random.Generator) -> list[Way]:
    """At most ``WAYS`` clusters by weighted k-means, the largest share first.

    Args:
        keys: of the draws of the event, as ``keys_of`` gives them, shape (n, d), n ≥ 1.
        weights: φ/q of each, shape (n,).
        rng: for the starts.
    """
    weights = weights / weights.sum()
    centres = starts_of(keys, weights, min(WAYS, len(keys)), rng)
    cluster = nearest_of(keys, centres)
    for _ in range(_ROUNDS):
        for k in np.unique(cluster):
            own = cluster == k
            centres[k] = weights[own] @ keys[own] / weights[own].sum()
        moved = nearest_of(keys, centres)
        if np.array_equal(moved, cluster):
            break
        cluster = moved
    distance = np.sum(keys**2, axis=1)
    ways = []
    for k in np.unique(cluster):
        own = np.flatnonzero(cluster == k)
        likeliest = own[np.argsort(distance[own], kind="stable")]
        ways.append(Way(float(weights[own].sum()), tuple(likeliest.tolist())))
    return sorted(ways, key=lambda way: -way.share)


def people_of(scenario: Scenario, space: Space, number: int, z: FloatArray) -> list[dict[str, Any]]:
    """Who comes in an episode, as a table can hold them: those who are timed, and the sampled.

    ``quantile`` is None of those who are timed, ``found_at_look`` where everybody, or
    nobody, is found.
    """
    given = space.given(z, number)
    arrivals = planned_arrivals(scenario, number, given)
    chance = scenario.perception.detection_probability
    return [
        {
            "arrival_s": arrival.arrival_s,
            "side": arrival.side.value,
            "quantile": arrival.quantile,
            "critical_gap_s": arrival.critical_gap_s,
            "found_at_look": None
            if arrival.detection_quantile is None or chance == 0
            else int(updates_until_found(arrival.detection_quantile, chance)),
        }
        for arrival in arrivals[: len(scenario.timed_walks()) + len(given.get("quantile", ()))]
    ]


def drawn_of(space: Space, number: int, z: FloatArray) -> dict[str, Any]:
    """The entry of ``[[pedestrians.drawn]]`` that lets an episode be met again."""
    return {
        "episode": number,
        **{name: list(uniforms) for name, uniforms in space.given(z, number).items()},
    }
