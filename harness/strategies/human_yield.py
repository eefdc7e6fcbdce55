"""The human driver of traffic engineering, who yields at a measured rate and avoids crashes."""

import math
from typing import ClassVar

import numpy as np
from scipy.special import ndtri

from harness.core.documents import NonNegative, Positive, Share
from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, ROUNDING, Observation
from harness.strategies.manoeuvres import (
    CLEARANCE_M,
    COMFORTABLE_MPS2,
    InPath,
    anybody_waits,
    can_stop_at_line,
    can_stop_before_disc,
    full_braking,
    lane_free_in_s,
    speeding_up,
    stop_at,
    stop_at_line,
    times_in_path,
    times_over_line_s,
    towards_v0,
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

    *Reacting.*  With a reaction time, a pedestrian counts for it only that long after they first
    were a reason to brake: to yield to them comfortably (the way driven until then included), or to
    avoid them.  This delays yielding and avoiding alike.  A driver who already brakes, or stands,
    reacts at once.  The reaction time and the comfortable deceleration may differ between drivers:
    both are log-normal, median × exp(σ z) with a standard normal z for each driver.

    *Limits.*  By default it has no reaction time.  It does not slow down for pedestrians whom it
    does not see yet: it hits a pedestrian who steps off within its stopping distance.

    Sources: yield rates as in the Highway Capacity Manual's pedestrian delay at uncontrolled
    crossings and its revision, NCHRP Project 17-87; comfortable deceleration, ITE's 10 ft/s².
    Reaction times and decelerations of 463 drivers who stopped at the onset of yellow (15th, 50th
    and 85th percentiles 0.7, 1.0 and 1.6 s; 7.2, 9.9 and 12.9 ft/s²): Gates, Noyce, Laracuente,
    Nordheim, Transportation Research Record 2030, 2007.  They are a median of 1.0 s with σ = 0.4,
    and a median of 3.0 m/s² with σ = 0.28.

    Args:
        rng: random numbers of this vehicle (given by the harness).
        yield_rate: the share of vehicles that yield, M_y, 0 to 1.  Its aggressiveness is
            −yield_rate.
        reaction_time_s: median reaction time before it begins to brake, s, 0 or more.
        reaction_time_sigma: σ of its logarithm, 0 or more; 0: all drivers have the median.
        comfortable_deceleration_mps2: greatest deceleration for yielding, m/s², above 0; with
            a spread, its median.
        comfortable_deceleration_sigma: σ of its logarithm, 0 or more.

    Attributes:
        yields: whether this vehicle yields.
        reaction_s, comfortable_mps2: this driver's reaction time and comfortable deceleration.
    """

    AGGRESSIVENESS: ClassVar = {"yield_rate": -1.0}  # a smaller yield rate is bolder

    def __init__(
        self,
        *,
        rng: np.random.Generator,
        yield_rate: Share = MEAN_YIELD_RATE,
        reaction_time_s: NonNegative = 0.0,
        reaction_time_sigma: NonNegative = 0.0,
        comfortable_deceleration_mps2: Positive = COMFORTABLE_MPS2,
        comfortable_deceleration_sigma: NonNegative = 0.0,
    ) -> None:
        self.yields = bool(rng.random() < yield_rate)
        self.reaction_s = reaction_time_s
        self.comfortable_mps2 = comfortable_deceleration_mps2
        if reaction_time_sigma or comfortable_deceleration_sigma:
            slow, hard = ndtri(rng.random(2)).tolist()
            self.reaction_s *= math.exp(reaction_time_sigma * slow)
            self.comfortable_mps2 *= math.exp(comfortable_deceleration_sigma * hard)
        self._reacts_s: dict[int, float] = {}

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²."""
        if self.reaction_s and observation.pedestrians:
            observation = self._reacted_to(observation)
        go_mps2 = towards_v0(observation)
        if not observation.pedestrians or observation.ego.range_m <= PEDESTRIAN_RADIUS_M + ROUNDING:
            return go_mps2
        met = _people_met(observation)
        comfortable_mps2, step_s = self.comfortable_mps2, observation.step_s
        stops = can_stop_at_line(observation, comfortable_mps2)
        if stops and (met or (self.yields and _somebody_to_yield_to(observation))):
            later = can_stop_at_line(observation, comfortable_mps2, step_s, go_mps2)
            return go_mps2 if later else stop_at_line(observation)
        return _avoid(observation, met, go_mps2) if met else go_mps2

    def _reacted_to(self, observation: Observation) -> Observation:
        """The observation with the pedestrians to whom it reacts by now."""
        ego, now_s, step_s = observation.ego, observation.time_s, observation.step_s
        on_the_brake = ego.speed_mps <= ROUNDING or ego.acceleration_mps2 < -ROUNDING
        # A command lasts for a step, so the reaction ends with one.
        delay_s = 0.0 if on_the_brake else step_s * math.ceil(self.reaction_s / step_s - ROUNDING)
        known = []
        for person in observation.pedestrians:
            since_s = self._reacts_s.get(person.index, math.inf)
            if since_s > now_s + delay_s + ROUNDING:
                alone = observation._replace(pedestrians=(person,))
                if self._may_brake(alone, delay_s):
                    since_s = self._reacts_s[person.index] = now_s + delay_s
            if since_s <= now_s + ROUNDING:
                known.append(person)
        return observation._replace(pedestrians=tuple(known))

    def _may_brake(self, observation: Observation, delay_s: float) -> bool:
        """Whether the pedestrians are a reason to brake, if it reacts after a delay."""
        yields = self.yields and _somebody_to_yield_to(observation)
        stops = yields and can_stop_at_line(observation, self.comfortable_mps2, delay_s)
        return stops or bool(_people_met(observation))


def _somebody_to_yield_to(observation: Observation) -> bool:
    """Whether a pedestrian waits, or will still be in its lane when it reaches the near edge."""
    if anybody_waits(observation):
        return True
    to_edge_m = max(0.0, observation.ego.range_m - observation.crossing.width_m / 2)
    at_edge_s, _ = speeding_up(observation, to_edge_m, observation.ego.speed_mps)
    return any(
        pedestrian.on_crossing and lane_free_in_s(observation, pedestrian) > at_edge_s
        for pedestrian in observation.pedestrians
    )


def _people_met(observation: Observation) -> list[InPath]:
    """The pedestrians whom it would meet if it drove on."""
    moving = times_in_path(observation, CLEARANCE_M - PEDESTRIAN_RADIUS_M)
    if not moving:
        return moving
    arrives_s, clears_s = times_over_line_s(observation, CLEARANCE_M)
    return [
        person
        for person in moving
        if person.leaves_s >= max(0.0, arrives_s) and person.enters_s <= clears_s
    ]


def _avoid(observation: Observation, met: list[InPath], go_mps2: float) -> float:
    """Stop before the disc; if that is too late, brake for those in front or drive on."""
    ego, limit_mps2 = observation.ego, observation.vehicle.max_deceleration_mps2
    wanted_mps2 = stop_at(observation, CLEARANCE_M)
    if wanted_mps2 is not None:
        return wanted_mps2
    if can_stop_before_disc(observation):
        return full_braking(observation)
    to_disc_m = ego.range_m - PEDESTRIAN_RADIUS_M
    there_mps = math.sqrt(max(0.0, ego.speed_mps**2 - 2 * limit_mps2 * to_disc_m))
    in_front = any(person.enters_s <= (ego.speed_mps - there_mps) / limit_mps2 for person in met)
    return full_braking(observation) if in_front else go_mps2
