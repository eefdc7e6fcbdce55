"""How fast a pedestrian walks who steps off: drawn from the interaction model at his quantile."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from harness.encounter import Arrival, Side, Walk
from harness.episode.rules import Rules
from harness.interaction import InteractionModel


class WalkingSpeeds:
    """f(v_p | 1/R, v), or f(v_p | R, v, L), at each pedestrian's quantile.

    Whoever steps off at the trigger sees (R0, v0) in every episode: those speeds are worked out
    together, which is many times faster and gives the same bits.
    """

    def __init__(self, model: InteractionModel, rules: Rules, reading: str) -> None:
        self._model = model
        self._on_curve = reading == "curve"
        self._lateral_m = {side: rules.crossing.to_lane_m(side) for side in Side}
        self._at_trigger = (rules.vehicle.trigger_range_m, rules.vehicle.initial_speed_mps)
        self._foreseen: dict[tuple[float, Side], float] = {}

    def foresee(self, planned: Iterable[tuple[Arrival, ...]]) -> None:
        first = [
            arrival
            for arrivals in planned
            for arrival in arrivals
            if arrival.arrival_s == 0 and arrival.quantile is not None
        ]
        self._foreseen = {}
        if first:
            keys = [(_quantile_of(arrival), arrival.side) for arrival in first]
            lateral = [self._lateral_m[arrival.side] for arrival in first]
            speeds = self._speeds([key for key, _ in keys], lateral, *self._at_trigger)
            self._foreseen = dict(zip(keys, speeds.tolist(), strict=True))

    def __call__(
        self, arrival: Arrival, range_m: float, speed_mps: float, lateral_m: float | None = None
    ) -> float:
        quantile = _quantile_of(arrival)
        key = (quantile, arrival.side)
        if (range_m, speed_mps) == self._at_trigger and lateral_m is None and key in self._foreseen:
            return self._foreseen[key]
        if range_m <= 0:
            return self._model.walking_speed_unconditional(quantile)
        if lateral_m is None:
            lateral_m = self._lateral_m[arrival.side]
        return float(self._speeds([quantile], [lateral_m], range_m, speed_mps)[0])

    def _speeds(
        self,
        quantile: Sequence[float],
        lateral_m: Sequence[float],
        range_m: float,
        speed_mps: float,
    ) -> NDArray[np.float64]:
        quantiles, laterals = np.array(quantile), np.array(lateral_m)
        range_of, speed_of = np.full(len(quantiles), range_m), np.full(len(quantiles), speed_mps)
        # Past the ego's lane there is no L: the curve says nothing there.
        if self._on_curve and (laterals > 0).all():
            speeds = self._model.walking_speed_on_curve(quantiles, range_of, laterals, speed_of)
            if not np.isnan(speeds).any():
                return speeds
            # Where no walking speed fits the box, L says nothing and is left out.
            marginal = self._model.walking_speed(quantiles, range_of, speed_of)
            return np.where(np.isnan(speeds), marginal, speeds)
        return self._model.walking_speed(quantiles, range_of, speed_of)


def _quantile_of(arrival: Arrival) -> float:
    """His quantile; timed pedestrians, who have none, never choose a speed."""
    assert arrival.quantile is not None
    return arrival.quantile


class SpeedsOfOtherArm:
    """Pairing by speed: what the pedestrian did in the AV's arm, whoever comes now."""

    def __init__(self, walks: tuple[Walk, ...], model: InteractionModel) -> None:
        self._speeds = {walk.arrival.index: walk.speed_mps for walk in walks}
        self._model = model

    def __call__(
        self,
        arrival: Arrival,
        range_m: float,  # noqa: ARG002
        speed_mps: float,  # noqa: ARG002
        lateral_m: float | None = None,  # noqa: ARG002
    ) -> float:
        speed = self._speeds.get(arrival.index)
        if speed is None:
            return self._model.walking_speed_unconditional(_quantile_of(arrival))
        return speed
