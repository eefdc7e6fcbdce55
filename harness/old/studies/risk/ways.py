"""Clusters the draws in the event into its likeliest ways."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.documents import JsonObject
from harness.core.encounter import FloatArray
from harness.encounter.arrivals import planned_arrivals
from harness.model.mixture.clusters import k_means
from harness.old.studies.risk.findings import Person
from harness.old.studies.risk.space import Space
from harness.scenario import Scenario
from harness.strategies.perception.track import updates_until_found

WAYS = 3

_ROUNDS = 50


@dataclass(frozen=True, slots=True)
class Cluster:
    """Similar draws in the event.

    ``share`` is their share of the probability.  ``members`` are their indices among all draws in
    the event, sorted by the distance of their keys from 0, the nominal mean.
    """

    share: float
    members: tuple[int, ...]


def ways_of(keys: FloatArray, weights: FloatArray, rng: np.random.Generator) -> list[Cluster]:
    """Return at most ``WAYS`` clusters by weighted k-means, the largest share first.

    Args:
        keys: result of ``keys_of`` for the draws in the event, shape (n, d), n ≥ 1.
        weights: φ/q of each draw, shape (n,).
        rng: generator for the starting points of k-means.
    """
    weights = weights / weights.sum()
    _, clusters = k_means(keys, weights, min(WAYS, len(keys)), _ROUNDS, rng)
    distance = np.sum(keys**2, axis=1)
    ways = []
    for k in np.unique(clusters):
        members = np.flatnonzero(clusters == k)
        likeliest = members[np.argsort(distance[members], kind="stable")]
        ways.append(Cluster(float(weights[members].sum()), tuple(likeliest.tolist())))
    return sorted(ways, key=lambda way: -way.share)


def people_of(
    scenario: Scenario,
    space: Space,
    number: int,
    z: FloatArray,
    speeds_mps: Sequence[float | None],
    culprit: int | None,
) -> tuple[Person, ...]:
    """Return the timed and the sampled pedestrians of an episode.

    ``speeds_mps`` are their walking speeds by index; nobody beyond its end walked.  ``culprit`` is
    the index of the pedestrian to whom the event is due; None if there is none.
    """
    given = space.given(z, number)
    arrivals = planned_arrivals(scenario, number, given)
    perception = scenario.perception
    chance, update_s = perception.detection_probability, perception.update_s
    step_s = scenario.experiment.step_s if update_s is None else update_s
    speeds = dict(enumerate(speeds_mps))
    return tuple(
        Person(
            arrival_s=arrival.arrival_s,
            side=arrival.side,
            walking_speed_mps=speeds.get(arrival.index),
            critical_gap_s=arrival.critical_gap_s,
            threshold_s=arrival.threshold_s,
            latency_s=arrival.latency_s,
            seen_after_s=None
            if arrival.detection_quantile is None or chance == 0
            else (int(updates_until_found(arrival.detection_quantile, chance)) - 1) * step_s,
            culprit=arrival.index == culprit,
        )
        for arrival in arrivals[: len(scenario.timed_walks()) + len(given.get("quantile", ()))]
    )


def drawn_of(space: Space, number: int, z: FloatArray) -> JsonObject:
    """Return the entry of ``[[pedestrians.drawn]]`` that repeats an episode."""
    uniforms: JsonObject = {key: [*values] for key, values in space.given(z, number).items()}
    return {"episode": number} | uniforms
