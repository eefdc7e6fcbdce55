"""The human driver of traffic engineering, who yields at a measured rate and avoids crashes."""

import math
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.special import ndtri

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Observation
from harness.core.errors import InputError, unknown_name
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

SOURCE = "NCHRP Project 17-87, working paper, table D2, unstaged crossings"


class Treatment(NamedTuple):
    """The mean yield rate and the range of the studies; None where the source has none."""

    mean: float | None
    low: float | None = None
    high: float | None = None

    @property
    def words(self) -> str:
        """The mean and the range in per cent.

        >>> Treatment(0.79, 0.45, 0.95).words
        '79 % (studies 45 to 95 %)'
        """
        mean = "no mean" if self.mean is None else f"{100 * self.mean:.0f} %"
        if self.low is None or self.high is None:
            return f"{mean} (no range)"
        return f"{mean} (studies {100 * self.low:.0f} to {100 * self.high:.0f} %)"


TREATMENTS = {
    "sign_overhead_or_in_street": Treatment(0.71, 0.51, 0.97),
    "refuge_island": Treatment(0.80, 0.65, 0.92),
    "high_visibility_signs_and_markings": Treatment(0.20, 0.04, 0.35),
    "continental_markings": Treatment(0.79),
    "rrfb": Treatment(0.79, 0.45, 0.95),
    "pedestal_beacon": Treatment(0.57),
    "overhead_beacon_push_button": Treatment(0.51, 0.13, 0.91),
    "overhead_beacon_passive": Treatment(0.73, 0.61, 0.76),
    "in_road_lights": Treatment(0.58, 0.53, 0.65),
    "crossing_guards_with_rrfb": Treatment(None, 0.81, 0.98),
    "hybrid_beacon": Treatment(0.88, 0.83, 1.00),
    "half_signal": Treatment(0.98, 0.96, 1.00),
    "any_markings": Treatment(0.56, 0.42, 0.70),
    "crossing_flags": Treatment(0.74, 0.72, 0.80),
}
"""Every treatment of the table: ``rrfb`` is a rectangular rapid-flashing beacon, ``hybrid_beacon``
the pedestrian hybrid beacon (HAWK)."""


def rate_of(treatment: str, where: str) -> float:
    """The mean yield rate of a treatment, 0 to 1.

    Raises:
        InputError: the treatment is unknown, or the source has no mean; ``where`` is its key.
    """
    usable = [name for name, row in TREATMENTS.items() if row.mean is not None]
    if treatment not in TREATMENTS:
        raise unknown_name(where, "treatment", treatment, usable)
    row = TREATMENTS[treatment]
    if row.mean is None:
        why = f"{treatment!r} has {row.words}, so the source gives no rate"
        raise InputError(where, why, "yield_rate, within that range")
    return row.mean


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
        treatment: the crosswalk's treatment (``yield_rates.TREATMENTS``), whose mean yield rate
            replaces ``yield_rate``; a scenario sets one of the two.
        reaction_time_s: median reaction time before it begins to brake, s, 0 or more.
        reaction_time_sigma: σ of its logarithm, 0 or more; 0: all drivers have the median.
        comfortable_deceleration_mps2: greatest deceleration for yielding, m/s², above 0; with
            a spread, its median.
        comfortable_deceleration_sigma: σ of its logarithm, 0 or more.

    Raises:
        InputError: a value is outside its range, or the treatment is unknown or has no rate.
    """

    AGGRESSIVENESS: ClassVar = {"yield_rate": -1.0}  # a smaller yield rate is bolder

    ALTERNATIVES: ClassVar = ("treatment", "yield_rate")  # a scenario sets one of them

    NOTES: ClassVar = {
        "treatment": (
            f"mean yield rates by treatment, {SOURCE}:",
            *(f"{name}: {row.words}" for name, row in TREATMENTS.items()),
        ),
        "reaction_time_s": ("measured at the onset of yellow: 1.0, sigma 0.4 (Gates et al. 2007)",),
        "comfortable_deceleration_mps2": (
            "ITE: 3.0; measured at the onset of yellow: 3.0, sigma 0.28 (Gates et al. 2007)",
        ),
    }

    def __init__(
        self,
        *,
        rng: np.random.Generator,
        yield_rate: float = MEAN_YIELD_RATE,
        treatment: str | None = None,
        reaction_time_s: float = 0.0,
        reaction_time_sigma: float = 0.0,
        comfortable_deceleration_mps2: float = COMFORTABLE_MPS2,
        comfortable_deceleration_sigma: float = 0.0,
    ) -> None:
        if treatment is not None:
            yield_rate = rate_of(treatment, "human_yield.treatment")
        if not 0 <= yield_rate <= 1:
            raise InputError("human_yield.yield_rate", f"{yield_rate!r}", "0 to 1")
        if comfortable_deceleration_mps2 <= 0:
            where = "human_yield.comfortable_deceleration_mps2"
            raise InputError(where, f"{comfortable_deceleration_mps2!r} m/s²", "above 0")
        for name, value in (
            ("reaction_time_s", reaction_time_s),
            ("reaction_time_sigma", reaction_time_sigma),
            ("comfortable_deceleration_sigma", comfortable_deceleration_sigma),
        ):
            if value < 0:
                raise InputError(f"human_yield.{name}", f"{value!r}", "0 or more")
        self._yields = bool(rng.random() < yield_rate)
        self._reaction_s = reaction_time_s
        self._comfortable_mps2 = comfortable_deceleration_mps2
        if reaction_time_sigma or comfortable_deceleration_sigma:
            slow, hard = ndtri(rng.random(2)).tolist()
            self._reaction_s *= math.exp(reaction_time_sigma * slow)
            self._comfortable_mps2 *= math.exp(comfortable_deceleration_sigma * hard)
        self._reacts_s: dict[int, float] = {}

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²."""
        if self._reaction_s:
            observation = self._reacted_to(observation)
        go = resume(observation)
        passed = observation.ego.range_m <= PEDESTRIAN_RADIUS_M + ROUNDING
        met = [] if passed else _people_met(observation)
        yields = self._yields and not passed and _somebody_to_yield_to(observation)
        if (yields or met) and can_stop_at_line(observation, self._comfortable_mps2):
            later = can_stop_at_line(observation, self._comfortable_mps2, observation.step_s, go)
            return go if later else stop_at_line(observation)
        return _avoid(observation, met, go) if met else go

    def _reacted_to(self, observation: Observation) -> Observation:
        """The observation with the pedestrians to whom it reacts by now."""
        ego, now, step = observation.ego, observation.time_s, observation.step_s
        on_the_brake = ego.speed_mps <= ROUNDING or ego.acceleration_mps2 < -ROUNDING
        # A command lasts for a step, so the reaction ends with one.
        delay_s = 0.0 if on_the_brake else step * math.ceil(self._reaction_s / step - 1e-9)
        known = []
        for person in observation.pedestrians:
            since_s = self._reacts_s.get(person.index, math.inf)
            if since_s > now + delay_s + ROUNDING:
                alone = observation._replace(pedestrians=(person,))
                if self._may_brake(alone, delay_s):
                    since_s = self._reacts_s[person.index] = now + delay_s
            if since_s <= now + ROUNDING:
                known.append(person)
        return observation._replace(pedestrians=tuple(known))

    def _may_brake(self, observation: Observation, delay_s: float) -> bool:
        """Whether the pedestrians are a reason to brake, if it reacts after a delay."""
        yields = self._yields and _somebody_to_yield_to(observation)
        if yields and can_stop_at_line(observation, self._comfortable_mps2, delay_s):
            return True
        return bool(_people_met(observation))


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
