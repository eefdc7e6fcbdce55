"""Manoeuvres that several strategies share, exact on the simulation's time grid."""

import math

from harness.encounter import PEDESTRIAN_RADIUS_M, Observation, PedestrianView, Vehicle

ROUNDING = 1e-9
"""An ego this near a threshold (m, s) is on it: engines differ in the last bits of their sums."""


def resume(observation: Observation) -> float:
    """Acceleration back to the initial speed v0, at most a0 either way, in m/s²."""
    vehicle = observation.vehicle
    limit = vehicle.resume_acceleration_mps2
    wanted = (vehicle.initial_speed_mps - observation.ego.speed_mps) / observation.step_s
    return max(-limit, min(limit, wanted))


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
    """From when to when a pedestrian is in the ego's path if he keeps his velocity, s from now.

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
