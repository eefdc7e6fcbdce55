"""Hard-Yield: a strategy that stops before the crosswalk and waits until it is clear."""

from harness.core.vocabulary import Observation
from harness.strategies.manoeuvres import (
    anybody_waits,
    can_stop_at_line,
    can_stop_before_disc,
    full_braking,
    stop_at,
    towards_v0,
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
            return towards_v0(observation)
        # Once it brakes at the maximum, it does so until the crossing is clear.
        if not self._braking_at_maximum:
            wanted = stop_at(observation, observation.crossing.stop_line_m)
            if wanted is not None:
                return wanted
            self._braking_at_maximum = can_stop_before_disc(observation)
        return full_braking(observation) if self._braking_at_maximum else towards_v0(observation)
