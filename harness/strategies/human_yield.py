"""The human driver of traffic engineering, who yields at a measured rate and avoids crashes."""

import math
from typing import ClassVar

import numpy as np

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Observation
from harness.core.errors import InputError
from harness.strategies.driving import (
    CLEARANCE_M,
    COMFORTABLE_MPS2,
    ROUNDING,
    anybody_waits,
    can_stop_at_line,
    full_braking_distance,
    half_path,
    lane_free_in,
    resume,
    speeding_up,
    stop_after,
    stop_at_line,
    time_in_path,
)

MEAN_YIELD_RATE = 0.74
"""Mean of the yield rates measured at 40 site-periods (0.33 to 1.0) in NCHRP Project 17-87."""


class HumanYield:
    """Yields to pedestrians at a measured rate, and brakes for pedestrians in its path.

    *Yielding.*  A vehicle either always yields or never does.  A vehicle that yields stops at the
    stop line, 1 m before the crosswalk, for pedestrians who wait at a kerb.  It also stops for
    pedestrians on the crossing if part of their disc will still be in its lane when it would reach
    the near edge.  It does so if a comfortable deceleration is enough; otherwise it drives on.  It
    brakes as late as that deceleration allows, so it often need not stop at all.  Once it has
    stopped, it waits for pedestrians who step off.

    *Avoiding.*  Whether it yields or not, it brakes for a pedestrian whom it would meet if it drove
    on and they kept their velocity.  To meet means to come within 0.1 m of their disc, accelerating
    with a0 up to v0.  It stops comfortably at the stop line if possible; otherwise it brakes as
    hard as a stop 0.1 m before them requires, up to the vehicle's maximum.  If even a full stop
    comes too late for a pedestrian who would walk into its side, it drives on.

    *Limits.*  It has no reaction time and does not slow down for pedestrians whom it does not see
    yet: it hits a pedestrian who steps off within its stopping distance.

    Sources: yield rates as in the Highway Capacity Manual's pedestrian delay at uncontrolled
    crossings and its revision, NCHRP Project 17-87; comfortable deceleration, ITE's 10 ft/s².

    Args:
        rng: random numbers of this vehicle (given by the harness).
        yield_rate: the share of vehicles that yield, M_y, 0 to 1.  Its aggressiveness is
            −yield_rate.
        comfortable_deceleration_mps2: greatest deceleration for yielding, m/s², above 0.

    Raises:
        InputError: a value is outside its range.
    """

    AGGRESSIVENESS: ClassVar = {"yield_rate": -1.0}  # a smaller yield rate is bolder

    def __init__(
        self,
        *,
        rng: np.random.Generator,
        yield_rate: float = MEAN_YIELD_RATE,
        comfortable_deceleration_mps2: float = COMFORTABLE_MPS2,
    ) -> None:
        if not 0 <= yield_rate <= 1:
            raise InputError("human_yield.yield_rate", f"{yield_rate!r}", "0 to 1")
        if comfortable_deceleration_mps2 <= 0:
            where = "human_yield.comfortable_deceleration_mps2"
            raise InputError(where, f"{comfortable_deceleration_mps2!r} m/s²", "above 0")
        self._yields = bool(rng.random() < yield_rate)
        self._comfortable_mps2 = comfortable_deceleration_mps2

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²."""
        go = resume(observation)
        passed = observation.ego.range_m <= PEDESTRIAN_RADIUS_M + ROUNDING
        met = [] if passed else _people_met(observation)
        yields = self._yields and not passed and _somebody_to_yield_to(observation)
        if (yields or met) and can_stop_at_line(observation, self._comfortable_mps2):
            later = can_stop_at_line(observation, self._comfortable_mps2, observation.step_s, go)
            return go if later else stop_at_line(observation)
        return _avoid(observation, met, go) if met else go


def _somebody_to_yield_to(observation: Observation) -> bool:
    """Whether a pedestrian waits, or will still be in its lane when it reaches the near edge."""
    crossing = observation.crossing
    to_edge = max(0.0, observation.ego.range_m - crossing.width_m / 2)
    at_edge, _ = speeding_up(observation, to_edge, observation.ego.speed_mps)
    return anybody_waits(observation) or any(
        pedestrian.on_crossing and lane_free_in(observation, pedestrian) > at_edge
        for pedestrian in observation.pedestrians
    )


def _people_met(observation: Observation) -> list[tuple[float, float]]:
    """When each pedestrian whom it would meet enters and leaves its path, in s from now."""
    arrives, clears = _over_their_line(observation)
    half = half_path(observation.vehicle) + CLEARANCE_M - PEDESTRIAN_RADIUS_M
    met = []
    for pedestrian in observation.pedestrians:
        if pedestrian.on_crossing or pedestrian.speed_mps > 0:
            enters, leaves = time_in_path(pedestrian, half)
            if leaves >= max(0.0, arrives) and enters <= clears:
                met.append((enters, leaves))
    return met


def _over_their_line(observation: Observation) -> tuple[float, float]:
    """When it starts and when it stops covering the centre line, plus 0.1 m, if it drives on."""
    ego = observation.ego
    ahead = max(0.0, ego.range_m - CLEARANCE_M)
    behind = ego.range_m + observation.vehicle.length_m + CLEARANCE_M
    return (
        speeding_up(observation, ahead, ego.speed_mps)[0],
        speeding_up(observation, behind, ego.speed_mps)[0],
    )


def _avoid(observation: Observation, met: list[tuple[float, float]], go: float) -> float:
    """Stop before the disc; if that is too late, brake for those in front or drive on."""
    ego, step = observation.ego, observation.step_s
    limit = observation.vehicle.max_deceleration_mps2
    hardest = -min(limit, ego.speed_mps / step)
    room = ego.range_m - CLEARANCE_M
    if room > 0 and ego.speed_mps**2 <= 2 * limit * room:
        return max(hardest, stop_after(room, ego.speed_mps, step))
    to_disc = ego.range_m - PEDESTRIAN_RADIUS_M
    if full_braking_distance(ego.speed_mps, limit, step) < to_disc:
        return hardest
    reached = (ego.speed_mps - math.sqrt(max(0.0, ego.speed_mps**2 - 2 * limit * to_disc))) / limit
    in_front = any(enters <= reached for enters, _ in met)
    return hardest if in_front else go
