"""The human driver of the paper, who drives at the most likely speed of the interaction model."""

from typing import Literal

import numpy as np

from harness.core.vocabulary import ROUNDING, Observation, PedestrianView, advantage_s
from harness.model.interaction import InteractionModel, ModelUseCounter
from harness.scenario.consistency import check_steps


class HumanGmm:
    """Every Δt it chooses the acceleration to the mode of f(v | 1/R, v_p, 1/T_adv) and holds it.

    a_d = (v_d − v) / Δt (paper, section III-D) within the vehicle's limits, where v_d is the
    smallest mode over all pedestrians on the crossing, and at most v0.  T_adv uses the present v
    and the signed L.  If nobody is on the crossing, or if R ≤ 0, it returns to v0 with at most a0;
    it holds this acceleration for Δt too.

    ``model_use`` counts the states of the ego for which the model was used.

    Args:
        model: the interaction model (given by the harness).
        rng: random numbers of this pair (given by the harness); used by ``speed="sampled"``.
        step_s: the simulation's step (given by the harness).
        decision_interval_s: Δt, a whole number of steps.
        reading: whether the density is conditioned on the time advantage or not (``marginal``).
        speed: the mode of the density, or a draw from it (``sampled``).
    """

    def __init__(
        self,
        *,
        model: InteractionModel,
        rng: np.random.Generator,
        step_s: float,
        decision_interval_s: float = 1.0,
        reading: Literal["given_time_advantage", "marginal"] = "given_time_advantage",
        speed: Literal["mode", "sampled"] = "mode",
    ) -> None:
        check_steps("decision_interval_s", decision_interval_s, step_s, 1)
        self._model, self._rng = model, rng
        self.model_use = ModelUseCounter(model)
        self._interval_s = decision_interval_s
        self._reading, self._speed = reading, speed
        self._decisions = 0
        self._held_mps2 = 0.0

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²; it changes only at whole multiples of Δt."""
        # A step's time and a multiple of Δt may differ in their last bit.
        if observation.time_s >= self._decisions * self._interval_s - ROUNDING:
            self._decisions += 1
            self._held_mps2 = self._wanted(observation)
        return self._held_mps2

    def _wanted(self, observation: Observation) -> float:
        ego, vehicle = observation.ego, observation.vehicle
        present = [p for p in observation.pedestrians if p.on_crossing]
        if not present or ego.range_m <= 0:
            limit_mps2 = vehicle.resume_acceleration_mps2
            initial_mps2 = (vehicle.initial_speed_mps - ego.speed_mps) / self._interval_s
            return max(-limit_mps2, min(limit_mps2, initial_mps2))
        desired_mps = min(self._desired_speed(observation, pedestrian) for pedestrian in present)
        desired_mps = min(desired_mps, vehicle.initial_speed_mps)
        return vehicle.within_limits((desired_mps - ego.speed_mps) / self._interval_s)

    def _desired_speed(self, observation: Observation, pedestrian: PedestrianView) -> float:
        ego, walking_mps = observation.ego, pedestrian.speed_mps
        self.model_use.note(ego.range_m, ego.speed_mps)
        quantile = None if self._speed == "mode" else self._rng.random()
        if self._reading == "marginal":
            return self._model.driver_speed(ego.range_m, walking_mps, quantile=quantile)
        per_s = inverse_time_advantage(*ego[:2], pedestrian.lateral_m, walking_mps)
        return self._model.driver_speed(ego.range_m, walking_mps, per_s, quantile=quantile)


def inverse_time_advantage(
    range_m: float, speed_mps: float, lateral_m: float, walking_speed_mps: float
) -> float:
    """1/T_adv = 1/abs(R/v − L/v_p) in 1/s; 0 if either of them stands, infinite if T_adv = 0."""
    if speed_mps <= 0 or walking_speed_mps <= 0:
        return 0.0
    advantage: float = advantage_s(range_m, speed_mps, lateral_m, walking_speed_mps)
    return 1 / advantage if advantage > 0 else float("inf")
