"""Hard-Yield: a strategy that stops before the crosswalk and waits until it is clear."""

from harness.core.encounter import PEDESTRIAN_RADIUS_M, Observation
from harness.strategies.driving import (
    anybody_waits,
    can_stop_at_line,
    full_braking_distance,
    resume,
    stop_after,
)


class HardYield:
    """Brakes constantly to a stop 1 m before the crosswalk, waits until clear, then resumes.

    It may be past that line, or unable to stop there even at the vehicle's maximum deceleration.
    Then it brakes at the maximum if that stops it before R = 0.25 m, and otherwise drives on.  It
    waits for all pedestrians on the crossing.  Source: the stopping counterpart of Soft-Yield in
    Schroeder et al. 2014, as defined in docs/method.md.

    Args:
        yield_to_waiting: also stop for pedestrians who wait at a kerb, if 3 m/s² are enough.
    """

    def __init__(self, *, yield_to_waiting: bool = False) -> None:
        self._yield_to_waiting = yield_to_waiting
        self._braking_at_maximum = False

    def decide(self, observation: Observation, /) -> float:
        """Commanded acceleration in m/s²."""
        ego = observation.ego
        occupied = any(pedestrian.on_crossing for pedestrian in observation.pedestrians)
        if self._yield_to_waiting and anybody_waits(observation):
            occupied |= can_stop_at_line(observation)
        if not occupied or ego.range_m <= 0:
            self._braking_at_maximum = False
            return resume(observation)
        limit, step = observation.vehicle.max_deceleration_mps2, observation.step_s
        distance = ego.range_m - observation.crossing.stop_line_m
        # Once it brakes at the maximum, it does so until the crossing is clear.
        if (
            not self._braking_at_maximum
            and distance > 0
            and ego.speed_mps**2 <= 2 * limit * distance
        ):
            return stop_after(distance, ego.speed_mps, step)
        room = ego.range_m - PEDESTRIAN_RADIUS_M
        if not self._braking_at_maximum:
            self._braking_at_maximum = full_braking_distance(ego.speed_mps, limit, step) < room
        if self._braking_at_maximum:
            return -min(limit, ego.speed_mps / step)
        return resume(observation)
