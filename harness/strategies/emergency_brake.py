"""Autonomous emergency braking (AEB) alone: no reaction until a collision is near."""

import math

from harness.core.documents import Positive
from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, ROUNDING, Observation, PedestrianView
from harness.strategies.manoeuvres import full_braking, half_path_width_m, time_in_path, towards_v0


class EmergencyBrake:
    """Drives at v0 and brakes at the maximum if the TTC to a pedestrian is below a threshold.

    If both keep their velocities, the ego covers the pedestrian's line (x = 0) from (R − r)/v to
    (R + l + r)/v, and the pedestrian is in its path from (L − h)/v_p to (L + h)/v_p.  Here
    r = 0.25 m, l is the vehicle's length, and h is half its width plus r.  Both are on a collision
    course if these intervals overlap, and the TTC is the beginning of the overlap.  It equals the
    TTC of docs/measures.md, except that the corners of the ego's outline are not rounded; so it is
    never larger.

    It brakes until the pedestrian has left its path or stands outside it; then it returns to v0
    with a0.  If the bumper is past R = r it drives on, because braking would only lengthen the time
    for which it is in the way.

    Source: the function that Euro NCAP's AEB VRU test protocol presumes (full automatic braking
    when a collision is near, TTC with constant velocities).  The protocol sets no threshold.  1.2 s
    are enough for a car that brakes from 60 km/h at b = 9 m/s²: a stop needs a TTC of
    v/2b = 0.93 s, and two steps remain.

    Args:
        ttc_threshold_s: the TTC below which it brakes, s, above 0.
    """

    def __init__(self, *, ttc_threshold_s: Positive = 1.2) -> None:
        self._threshold_s = ttc_threshold_s
        self._braking_for: set[int] = set()

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²."""
        ego, vehicle = observation.ego, observation.vehicle
        half_m = half_path_width_m(vehicle)
        threats = set()
        if ego.range_m > PEDESTRIAN_RADIUS_M + ROUNDING:
            for pedestrian in observation.pedestrians:
                ttc_s = _ttc_s(observation, pedestrian, half_m)
                near = ttc_s < self._threshold_s - ROUNDING
                known = pedestrian.index in self._braking_for
                if near or (known and _in_or_before_path(pedestrian, half_m)):
                    threats.add(pedestrian.index)
        self._braking_for = threats
        return full_braking(observation) if threats else towards_v0(observation)


def _ttc_s(observation: Observation, pedestrian: PedestrianView, half_path_m: float) -> float:
    """TTC in s; infinite without a collision course or if the pedestrian is not on the crossing."""
    ego = observation.ego
    if not pedestrian.on_crossing or ego.speed_mps <= 0:
        return math.inf
    _, enters_s, leaves_s = time_in_path(pedestrian, half_path_m)
    arrives_s = (ego.range_m - PEDESTRIAN_RADIUS_M) / ego.speed_mps
    clears_s = (ego.range_m + observation.vehicle.length_m + PEDESTRIAN_RADIUS_M) / ego.speed_mps
    first_s = max(enters_s, arrives_s, 0.0)
    return first_s if first_s <= min(leaves_s, clears_s) else math.inf


def _in_or_before_path(pedestrian: PedestrianView, half_path_m: float) -> bool:
    _, enters_s, leaves_s = time_in_path(pedestrian, half_path_m)
    return leaves_s >= 0 and enters_s < math.inf
