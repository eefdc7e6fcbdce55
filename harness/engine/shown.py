"""The positions at which SUMO's own driver sees pedestrians; docs/sumo.md says why they differ."""

from dataclasses import dataclass

from harness.core.encounter import Side

WAITING_M = 0.3
"""A waiting pedestrian is shown this far behind the kerb, off the crossing."""

ON_CROSSING_M = 0.1
"""Smallest distance from their first kerb at which a pedestrian on the crossing is shown."""

COMING_M = 5.0
"""A pedestrian who has not arrived yet is held this far behind their kerb, on the footpath.

SUMO's driver ignores pedestrians there.
"""


@dataclass(frozen=True, slots=True)
class Shown:
    """The positions at which the drivers of one lane see pedestrians.

    SUMO assumes that every person on its crossing walks in the crossing's own direction, and it
    counts a person at the kerb as on the crossing.  So waiting pedestrians are shown behind their
    kerb.  Pedestrians who walk against that direction are shown mirrored at the lane's centre.
    So their distance from the lane, and whether they approach or leave it, are true.
    """

    lane_centre_m: float
    length_m: float
    crossing_from: Side

    def y_of(self, side: Side, y_m: float) -> float:
        """The shown y of a pedestrian who comes from ``side`` and is at ``y_m``."""
        if y_m <= 0 if side is Side.NEAR else y_m >= self.length_m:
            return -WAITING_M if side is Side.NEAR else y_m + WAITING_M
        return y_m if side is self.crossing_from else self._mirrored(y_m)

    def coming_y(self, side: Side) -> float:
        """The y at which a pedestrian is held before they arrive."""
        return -COMING_M if side is Side.NEAR else self.length_m + COMING_M

    def _mirrored(self, y_m: float) -> float:
        """``y_m`` mirrored at the lane's centre, limited to the crossing."""
        y_m = 2 * self.lane_centre_m - y_m
        if self.crossing_from is Side.FAR:
            return min(max(0.0, y_m), self.length_m - ON_CROSSING_M)
        return min(max(ON_CROSSING_M, y_m), self.length_m)
