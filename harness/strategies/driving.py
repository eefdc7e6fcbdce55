"""Manoeuvres that several strategies share, exact on the simulation's time grid."""

import math

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Observation, PedestrianView, Vehicle

ROUNDING = 1e-9
"""An ego this near a threshold (m, s) is on it: engines differ in the last bits of their sums."""

CLEARANCE_M = PEDESTRIAN_RADIUS_M + 0.1
"""Range at which an ego stands at the latest: 0.1 m before somebody on the centre line."""

COMFORTABLE_MPS2 = 3.0
"""Deceleration towards the crosswalk: 10 ft/s², ITE's for drivers before a red light."""

AT_KERB_M = 1.0
"""Somebody who stands no farther than this behind the kerb waits at the crosswalk."""


def resume(observation: Observation) -> float:
    """Acceleration back to the initial speed v0, at most a0 either way, in m/s²."""
    return towards(observation, observation.vehicle.initial_speed_mps)


def towards(
    observation: Observation, speed_mps: float, acceleration_mps2: float | None = None
) -> float:
    """Acceleration to a speed, at most that up (a0 where it is not said) and a0 down, in m/s²."""
    limit = observation.vehicle.resume_acceleration_mps2
    most = limit if acceleration_mps2 is None else acceleration_mps2
    wanted = (speed_mps - observation.ego.speed_mps) / observation.step_s
    if wanted > most:
        return most
    return wanted if wanted > -limit else -limit


def stop_after(distance_m: float, speed_mps: float, step_s: float) -> float:
    """Acceleration of a constant deceleration that stands still after exactly ``distance_m``.

    A constant deceleration from v over d takes T = 2d/v, which is seldom a whole number of
    steps.  With n = ceil(T/step) this holds a for n − 1 steps and the rest in the last one, where
    a solves Σ (v_k + v_{k+1})/2 · step = d: a = −((n − ½) v − d/step) / (step n (n − 1)/2).  It
    differs from v²/2d by a relative 1/(4 n (n − 1)) at most and repeats itself when asked again
    at the next step.

    Args:
        distance_m: distance to the point of rest, > 0.
        speed_mps: present speed, ≥ 0.
        step_s: length of a step.
    """
    if speed_mps <= 0:
        return 0.0
    steps = max(1, math.ceil(2 * distance_m / speed_mps / step_s - 1e-9))
    if steps == 1:
        return -speed_mps / step_s
    return -((steps - 0.5) * speed_mps - distance_m / step_s) / (step_s * steps * (steps - 1) / 2)


def full_braking_distance(speed_mps: float, deceleration_mps2: float, step_s: float) -> float:
    """Distance in which braking at the maximum stops on the time grid, in metres.

    The last step brakes only as hard as it takes to reach zero at its end, so this is up to
    deceleration · step²/8 longer than v²/2a.
    """
    last = math.fmod(speed_mps, deceleration_mps2 * step_s)
    return (speed_mps**2 - last**2) / (2 * deceleration_mps2) + last * step_s / 2


def clearing_time(pedestrian: PedestrianView) -> float:
    """t_L, the time until the pedestrian reaches the far kerb; infinite for one who stands."""
    if pedestrian.speed_mps <= 0:
        return math.inf
    return pedestrian.remaining_m / pedestrian.speed_mps


def half_path(vehicle: Vehicle) -> float:
    """Half the width in which the ego touches a walker's disc: w/2 + 0.25 m."""
    return vehicle.width_m / 2 + PEDESTRIAN_RADIUS_M


def time_in_path(pedestrian: PedestrianView, half_path_m: float) -> tuple[float, float]:
    """From when to when a pedestrian is in the ego's path if they keep their velocity, s from now.

    Returns:
        (enters, leaves): enters is 0 for one who is in it, leaves below 0 for one who is past it;
        one who stands before it never enters: both infinite.
    """
    to_centre, speed = pedestrian.lateral_m, pedestrian.speed_mps
    if speed > 0:
        return max(0.0, (to_centre - half_path_m) / speed), (to_centre + half_path_m) / speed
    if to_centre < -half_path_m:
        return 0.0, -math.inf
    return (0.0 if to_centre <= half_path_m else math.inf), math.inf


def lane_free_in(observation: Observation, pedestrian: PedestrianView) -> float:
    """Time until a pedestrian has left the ego's lane, disc and all, in s.

    Where it lies at a kerb they leave it there.  0 or less for one who has left it, infinite for
    one who stands before its end.
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
    """(time in s, speed at the end in m/s) of a distance ≥ 0 at a0, or as said, up to v0."""
    vehicle = observation.vehicle
    gain, top = acceleration_mps2 or vehicle.resume_acceleration_mps2, vehicle.initial_speed_mps
    reached = max(speed_mps, min(top, math.sqrt(speed_mps**2 + 2 * gain * distance_m)))
    left = distance_m - (reached**2 - speed_mps**2) / (2 * gain)
    return (reached - speed_mps) / gain + left / max(top, speed_mps), reached


def stop_at_line(observation: Observation) -> float:
    """Acceleration of a constant deceleration to a stop at the stop line; no harder than needed."""
    speed, step = observation.ego.speed_mps, observation.step_s
    distance = observation.ego.range_m - observation.crossing.stop_line_m
    return stop_after(distance, speed, step) if distance > ROUNDING else -speed / step


def anybody_waits(observation: Observation) -> bool:
    """Whether somebody stands at one of the kerbs, not yet on the crossing."""
    farthest = observation.crossing.length_m + AT_KERB_M
    return any(
        not pedestrian.on_crossing
        and pedestrian.speed_mps <= 0
        and pedestrian.remaining_m <= farthest
        for pedestrian in observation.pedestrians
    )


def can_stop_at_line(
    observation: Observation,
    deceleration_mps2: float = COMFORTABLE_MPS2,
    after_s: float = 0.0,
    at_mps2: float = 0.0,
) -> bool:
    """Whether a deceleration is enough for a stop at the stop line; what was possible stays so.

    An ego that stands before the near edge has stopped.  With the bumper over the edge it is too
    late: nobody steps off in front of such a car, so it and they would wait for each other.

    Args:
        observation: where the ego is.
        deceleration_mps2: above 0; the vehicle's maximum counts if that is less.
        after_s: asks of so much later, …
        at_mps2: … having driven at this acceleration until then.
    """
    ego, crossing = observation.ego, observation.crossing
    speed = ego.speed_mps + at_mps2 * after_s
    if speed <= ROUNDING:
        return ego.range_m > crossing.width_m / 2 + ROUNDING
    room = ego.range_m - crossing.stop_line_m - (ego.speed_mps + speed) / 2 * after_s
    limit = min(deceleration_mps2, observation.vehicle.max_deceleration_mps2)
    return room > 0 and speed**2 <= 2 * limit * room + ROUNDING
