"""Where SUMO's own driver is shown people who are held; docs/sumo.md says why."""

from dataclasses import dataclass

from harness.core.encounter import Side

WAITING_M = 0.3
"""Someone who waits is shown this far behind the kerb, off the crossing."""

ON_CROSSING_M = 0.1
"""Somebody who is shown on the crossing is at least so far from its far kerb."""

COMING_M = 5.0
"""Somebody who has not arrived yet is held so far behind their kerb, on their footpath.

SUMO's driver ignores people there.
"""


@dataclass(frozen=True, slots=True)
class Shown:
    """Where the drivers of one lane are shown people.

    SUMO takes everyone who is placed on its crossing for somebody who walks in the crossing's own
    direction; at the kerb itself, too, they are on the crossing to SUMO.  So people who wait are
    shown behind their kerb.  People who walk against that direction are shown mirrored at the
    centre of the lane: as far from its path, on their way to it or away from it, until they have
    left the lane.
    """

    lane_centre_m: float
    length_m: float
    crossing_from: Side

    def y_of(self, side: Side, y_m: float) -> float:
        """y at which somebody from that side is shown who is at ``y_m``."""
        if y_m <= 0 if side is Side.NEAR else y_m >= self.length_m:
            return -WAITING_M if side is Side.NEAR else y_m + WAITING_M
        return y_m if side is self.crossing_from else self._mirrored(y_m)

    def coming_y(self, side: Side) -> float:
        """y at which somebody is held who has not arrived yet."""
        return -COMING_M if side is Side.NEAR else self.length_m + COMING_M

    def _mirrored(self, y_m: float) -> float:
        """As far on the other side of the lane, on the crossing."""
        y_m = 2 * self.lane_centre_m - y_m
        if self.crossing_from is Side.FAR:
            return min(max(0.0, y_m), self.length_m - ON_CROSSING_M)
        return min(max(ON_CROSSING_M, y_m), self.length_m)
