"""An emergency brake alone (AEB): nothing before a collision is near, then everything."""

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Observation, PedestrianView
from harness.core.errors import InputError
from harness.strategies.driving import ROUNDING, half_path, resume, time_in_path


class EmergencyBrake:
    """Drives at v0, brakes at the maximum when the TTC to a pedestrian falls under a threshold.

    With both keeping their velocities the ego is over the pedestrian's line (x = 0) from
    (R − r)/v to (R + l + r)/v, they are in its path from (L − h)/v_p to (L + h)/v_p; r = 0.25 m,
    l the vehicle's length, h half its width plus r.  The two are on a collision course where these
    times overlap, and the TTC is the first moment of both; so "about to enter the lane" means: in
    the ego's path while the ego is there.  The TTC is that of docs/measures.md but for the rounding
    of the corners, which it takes as full: never later.

    Having begun to brake it goes on until whoever it brakes for has left its path, or stands
    outside it; then a0 to v0.  With the bumper past R = r it goes on: braking could only lengthen
    the time it is in the way.

    Source: the function that Euro NCAP's AEB VRU test protocol presumes (full braking by itself
    when a collision is near, TTC with both velocities kept).  It sets no threshold.  1.2 s stops a
    car that brakes at b = 9 m/s² from 60 km/h: that takes v/2b = 0.93 s, and two steps are spare.

    Args:
        ttc_threshold_s: it brakes below this TTC, s, above 0.

    Raises:
        InputError: the threshold is not above 0.
    """

    def __init__(self, *, ttc_threshold_s: float = 1.2) -> None:
        if ttc_threshold_s <= 0:
            raise InputError("emergency_brake.ttc_threshold_s", f"{ttc_threshold_s!r} s", "above 0")
        self._threshold_s = ttc_threshold_s
        self._braking_for: set[int] = set()

    def decide(self, observation: Observation, /) -> float:
        """Wanted acceleration in m/s²."""
        ego, vehicle = observation.ego, observation.vehicle
        half = half_path(vehicle)
        threats = set()
        if ego.range_m > PEDESTRIAN_RADIUS_M + ROUNDING:
            for pedestrian in observation.pedestrians:
                time = _time_to_collision(observation, pedestrian, half)
                near = time < self._threshold_s - ROUNDING
                known = pedestrian.index in self._braking_for
                if near or (known and _in_or_before_path(pedestrian, half)):
                    threats.add(pedestrian.index)
        self._braking_for = threats
        if threats:
            return -min(vehicle.max_deceleration_mps2, ego.speed_mps / observation.step_s)
        return resume(observation)


def _time_to_collision(
    observation: Observation, pedestrian: PedestrianView, half_path_m: float
) -> float:
    """TTC in s, infinite off a collision course or for someone who is not on the crossing."""
    ego = observation.ego
    if not pedestrian.on_crossing or ego.speed_mps <= 0:
        return float("inf")
    enters, leaves = time_in_path(pedestrian, half_path_m)
    arrives = (ego.range_m - PEDESTRIAN_RADIUS_M) / ego.speed_mps
    gone = (ego.range_m + observation.vehicle.length_m + PEDESTRIAN_RADIUS_M) / ego.speed_mps
    first = max(enters, arrives, 0.0)
    return first if first <= min(leaves, gone) else float("inf")


def _in_or_before_path(pedestrian: PedestrianView, half_path_m: float) -> bool:
    enters, leaves = time_in_path(pedestrian, half_path_m)
    return leaves >= 0 and enters < float("inf")
