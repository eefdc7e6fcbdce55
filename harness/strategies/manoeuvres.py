"""Manoeuvres that several strategies use; they are exact on the simulation's time grid."""

import math
from typing import NamedTuple

from harness.core.vocabulary import (
    PEDESTRIAN_RADIUS_M,
    ROUNDING,
    Observation,
    PedestrianView,
    Vehicle,
)

CLEARANCE_M = PEDESTRIAN_RADIUS_M + 0.1
"""Least range at which an ego stops: 0.1 m before a pedestrian on the centre line."""

COMFORTABLE_MPS2 = 3.0
"""Comfortable deceleration before the crosswalk: 10 ft/s², ITE's value before a red light."""

AT_KERB_M = 1.0
"""A pedestrian who stands at most this far behind the kerb waits at the crosswalk."""


def towards_v0(observation: Observation) -> float:
    """Acceleration back to the initial speed v0, at most a0 either way, in m/s²."""
    return towards(observation, observation.vehicle.initial_speed_mps)


def towards(
    observation: Observation, speed_mps: float, acceleration_mps2: float | None = None
) -> float:
    """Acceleration in m/s² to a speed: at most the given acceleration (or a0), at least −a0."""
    limit_mps2 = observation.vehicle.resume_acceleration_mps2
    most_mps2 = limit_mps2 if acceleration_mps2 is None else acceleration_mps2
    wanted_mps2 = (speed_mps - observation.ego.speed_mps) / observation.step_s
    if wanted_mps2 > most_mps2:
        return most_mps2
    if wanted_mps2 < -limit_mps2:
        return -limit_mps2
    return wanted_mps2


def stop_after(distance_m: float, speed_mps: float, step_s: float) -> float:
    """Acceleration that, held constant, stops the ego after exactly ``distance_m``.

    A constant deceleration from v over d takes T = 2d/v, which is seldom a whole number of
    steps.  With n = ceil(T/step) the acceleration is a for n − 1 steps, and the last step ends at
    speed 0.  a solves Σ (v_k + v_{k+1})/2 · step = d:
    a = −((n − ½) v − d/step) / (step n (n − 1)/2).  Its size exceeds v²/2d by a relative
    1/(4 n (n − 1)) at most.  The next step computes the same value.

    Args:
        distance_m: distance to the point of rest, > 0.
        speed_mps: present speed, ≥ 0.
        step_s: length of a step.
    """
    if speed_mps <= 0:
        return 0.0
    steps = max(1, math.ceil(2 * distance_m / speed_mps / step_s - ROUNDING))
    if steps == 1:
        return -speed_mps / step_s
    return -((steps - 0.5) * speed_mps - distance_m / step_s) / (step_s * steps * (steps - 1) / 2)


def full_braking_distance_m(speed_mps: float, deceleration_mps2: float, step_s: float) -> float:
    """Distance in which braking at the maximum stops on the time grid, in metres.

    The last step brakes only as hard as it takes to reach zero at its end, so this is up to
    deceleration · step²/8 longer than v²/2a.
    """
    last = math.fmod(speed_mps, deceleration_mps2 * step_s)
    return (speed_mps**2 - last**2) / (2 * deceleration_mps2) + last * step_s / 2


def full_braking(observation: Observation) -> float:
    """Acceleration of the hardest braking in m/s², which ends where the ego stands."""
    ego, limit_mps2 = observation.ego, observation.vehicle.max_deceleration_mps2
    return -min(limit_mps2, ego.speed_mps / observation.step_s)


def stop_at(observation: Observation, range_m: float) -> float | None:
    """Acceleration of the constant deceleration that stops the ego at a range.

    None if the range is behind it or the vehicle's maximum is not enough.
    """
    limit_mps2, speed_mps = observation.vehicle.max_deceleration_mps2, observation.ego.speed_mps
    distance_m = observation.ego.range_m - range_m
    if distance_m > 0 and speed_mps**2 <= 2 * limit_mps2 * distance_m:
        return max(-limit_mps2, stop_after(distance_m, speed_mps, observation.step_s))
    return None


def can_stop_before_disc(observation: Observation) -> bool:
    """Whether full braking stops the ego before a pedestrian on the centre line."""
    ego, limit_mps2 = observation.ego, observation.vehicle.max_deceleration_mps2
    needed_m = full_braking_distance_m(ego.speed_mps, limit_mps2, observation.step_s)
    return needed_m < ego.range_m - PEDESTRIAN_RADIUS_M


def clearing_time_s(pedestrian: PedestrianView) -> float:
    """t_L, the time until the pedestrian reaches the far kerb; infinite if they stand."""
    if pedestrian.speed_mps <= 0:
        return math.inf
    return pedestrian.remaining_m / pedestrian.speed_mps


def half_path_width_m(vehicle: Vehicle) -> float:
    """Half the width within which the ego touches a pedestrian's disc: w/2 + 0.25 m."""
    return vehicle.width_m / 2 + PEDESTRIAN_RADIUS_M


class InPath(NamedTuple):
    """When a pedestrian who keeps their velocity enters and leaves the ego's path, in s from now.

    ``enters_s`` is 0 if they are in the path; ``leaves_s`` is below 0 if they are past it; both are
    infinite if they stand before it.
    """

    index: int  # type: ignore[assignment]  # the field's own name; tuple.index is not needed
    enters_s: float
    leaves_s: float


def time_in_path(pedestrian: PedestrianView, half_path_m: float) -> InPath:
    """When a pedestrian is in a path of this half width."""
    index, lateral_m, speed_mps = pedestrian.index, pedestrian.lateral_m, pedestrian.speed_mps
    if speed_mps > 0:
        enters_s = max(0.0, (lateral_m - half_path_m) / speed_mps)
        return InPath(index, enters_s, (lateral_m + half_path_m) / speed_mps)
    if lateral_m < -half_path_m:
        return InPath(index, 0.0, -math.inf)
    return InPath(index, 0.0 if lateral_m <= half_path_m else math.inf, math.inf)


def times_in_path(observation: Observation, spare_m: float) -> list[InPath]:
    """When those who walk or are on the crossing are in the path, with space on both sides."""
    half_m = half_path_width_m(observation.vehicle) + spare_m
    return [
        time_in_path(pedestrian, half_m)
        for pedestrian in observation.pedestrians
        if pedestrian.on_crossing or pedestrian.speed_mps > 0
    ]


def lane_free_in_s(observation: Observation, pedestrian: PedestrianView) -> float:
    """Time in s until the whole disc of a pedestrian has left the ego's lane.

    If the lane ends at a kerb, they leave it at the kerb.  The time is 0 or less if they have left
    it, and infinite if they stand before its end.
    """
    end_m = observation.crossing.lane_width_m / 2 + PEDESTRIAN_RADIUS_M
    rest_m = min(pedestrian.lateral_m + end_m, pedestrian.remaining_m)
    if pedestrian.speed_mps > 0:
        return rest_m / pedestrian.speed_mps
    return math.inf if rest_m > 0 else 0.0


def speeding_up(
    observation: Observation,
    distance_m: float,
    speed_mps: float,
    acceleration_mps2: float | None = None,
) -> tuple[float, float]:
    """Time in s and final speed in m/s over a distance ≥ 0, up to v0.

    The acceleration is above 0; None: a0.
    """
    vehicle = observation.vehicle
    a0_mps2, top_mps = vehicle.resume_acceleration_mps2, vehicle.initial_speed_mps
    gain_mps2 = a0_mps2 if acceleration_mps2 is None else acceleration_mps2
    reached_mps = max(speed_mps, min(top_mps, math.sqrt(speed_mps**2 + 2 * gain_mps2 * distance_m)))
    left_m = distance_m - (reached_mps**2 - speed_mps**2) / (2 * gain_mps2)
    return (reached_mps - speed_mps) / gain_mps2 + left_m / max(top_mps, speed_mps), reached_mps


def times_over_line_s(
    observation: Observation, spare_m: float, acceleration_mps2: float | None = None
) -> tuple[float, float]:
    """When the ego covers the centre line, from ``spare_m`` before to behind it, if it drives on.

    Args:
        observation: what the strategy sees.
        spare_m: the distance that counts as covered before its front and behind its rear.
        acceleration_mps2: its acceleration up to v0; None: a0.
    """
    ego = observation.ego
    ahead_m = max(0.0, ego.range_m - spare_m)
    behind_m = ego.range_m + spare_m + observation.vehicle.length_m
    return (
        speeding_up(observation, ahead_m, ego.speed_mps, acceleration_mps2)[0],
        speeding_up(observation, behind_m, ego.speed_mps, acceleration_mps2)[0],
    )


def stop_at_line(observation: Observation) -> float:
    """Acceleration of the constant deceleration that stops the ego at the stop line."""
    speed_mps, step_s = observation.ego.speed_mps, observation.step_s
    left_m = observation.ego.range_m - observation.crossing.stop_line_m
    return stop_after(left_m, speed_mps, step_s) if left_m > ROUNDING else -speed_mps / step_s


def anybody_waits(observation: Observation) -> bool:
    """Whether a pedestrian stands at one of the kerbs and is not yet on the crossing."""
    farthest_m = observation.crossing.length_m + AT_KERB_M
    return any(
        not pedestrian.on_crossing
        and pedestrian.speed_mps <= 0
        and pedestrian.remaining_m <= farthest_m
        for pedestrian in observation.pedestrians
    )


def can_stop_at_line(
    observation: Observation,
    deceleration_mps2: float = COMFORTABLE_MPS2,
    after_s: float = 0.0,
    at_mps2: float = 0.0,
) -> bool:
    """Whether a deceleration is enough to stop at the stop line; once true, it stays true.

    An ego that stands before the near edge counts as stopped.  If its bumper is over the edge it
    must not stop: nobody steps off in front of such a car, so ego and pedestrians would wait for
    each other.

    Args:
        observation: what the strategy sees.
        deceleration_mps2: the deceleration, above 0, limited by the vehicle's maximum.
        after_s: time in s at which the ego begins to brake.
        at_mps2: acceleration until then.
    """
    ego, crossing = observation.ego, observation.crossing
    speed_mps = ego.speed_mps + at_mps2 * after_s
    if speed_mps <= ROUNDING:
        return ego.range_m > crossing.width_m / 2 + ROUNDING
    room_m = ego.range_m - crossing.stop_line_m - (ego.speed_mps + speed_mps) / 2 * after_s
    limit_mps2 = min(deceleration_mps2, observation.vehicle.max_deceleration_mps2)
    return room_m > 0 and speed_mps**2 <= 2 * limit_mps2 * room_m + ROUNDING
