"""The most likely ways to the event: clusters of its draws, and the people to meet them again."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.encounter import FloatArray
from harness.episode.arrivals import planned_arrivals
from harness.risk.proposal import nearest_of, starts_of
from harness.risk.space import Space
from harness.scenario import Scenario

WAYS = 3

_ROUNDS = 50


@dataclass(frozen=True, slots=True)
class Way:
    """One way to the event.

    ``share`` is its part of the probability, ``members`` its draws by their place among all draws
    of the event, the likeliest first: the nearest to the origin of standard normal space.
    """

    share: float
    members: tuple[int, ...]


def ways_of(z: FloatArray, weights: FloatArray, rng: np.random.Generator) -> list[Way]:
    """At most ``WAYS`` clusters by weighted k-means, the largest share first.

    Args:
        z: draws of the event, shape (n, d), n ≥ 1.
        weights: φ/q of each, shape (n,).
        rng: for the starts.
    """
    weights = weights / weights.sum()
    centres = starts_of(z, weights, min(WAYS, len(z)), rng)
    cluster = nearest_of(z, centres)
    for _ in range(_ROUNDS):
        for k in np.unique(cluster):
            own = cluster == k
            centres[k] = weights[own] @ z[own] / weights[own].sum()
        moved = nearest_of(z, centres)
        if np.array_equal(moved, cluster):
            break
        cluster = moved
    distance = np.sum(z**2, axis=1)
    ways = []
    for k in np.unique(cluster):
        own = np.flatnonzero(cluster == k)
        likeliest = own[np.argsort(distance[own], kind="stable")]
        ways.append(Way(float(weights[own].sum()), tuple(likeliest.tolist())))
    return sorted(ways, key=lambda way: -way.share)


def people_of(scenario: Scenario, space: Space, number: int, z: FloatArray) -> list[dict[str, Any]]:
    """Who comes in an episode, in words that a table can hold: the sampled pedestrians alone."""
    arrivals = planned_arrivals(scenario, number, space.given(z))
    timed = len(scenario.timed_walks())
    return [
        {
            "arrival_s": arrival.arrival_s,
            "side": arrival.side.value,
            "quantile": arrival.quantile,
            "critical_gap_s": arrival.critical_gap_s,
        }
        for arrival in arrivals[timed : timed + space.people]
    ]


def drawn_of(space: Space, number: int, z: FloatArray) -> dict[str, Any]:
    """The entry of ``[[pedestrians.drawn]]`` that lets an episode be met again."""
    return {
        "episode": number,
        **{name: list(uniforms) for name, uniforms in space.given(z).items()},
    }
