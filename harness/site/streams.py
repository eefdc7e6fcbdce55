"""Where streams of vehicles enter a site's road and leave it, lane by lane."""

import math
from collections import Counter
from dataclasses import dataclass

from harness.site.site import TOLERANCE_M, Site, Stretch, Way
from harness.site.ways import REACH_AFTER_M, REACH_BEFORE_M

_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Stream:
    """One lane's way for a stream of vehicles; x is that of the lane's own direction.

    Its stretches belong to no other lane's way: upstream of the first one the road begins, lanes
    join, or there are 300 m; beyond the last one it ends, lanes join, or there are 120 m.

    Attributes:
        way: the lane's way.
        stretches: the lanes it drives on, with those inside junctions left out.
        approach: the stretch that leads to the crosswalk.
    """

    way: Way
    stretches: tuple[Stretch, ...]
    approach: Stretch

    @property
    def begins_x_m(self) -> float:
        """How far upstream vehicles may enter."""
        return max(self.stretches[0].start_m, -REACH_BEFORE_M - TOLERANCE_M)

    @property
    def ends_x_m(self) -> float:
        """Where vehicles leave the road."""
        return min(self.stretches[-1].end_m, REACH_AFTER_M)

    def entry_x_m(self, range_m: float, per_step_m: float) -> float | None:
        """Where vehicles enter: as far upstream as there is road, whole steps before the range.

        Args:
            range_m: how far before the crosswalk a passage begins.
            per_step_m: the way of one step at v0.

        Returns:
            None where the lane begins within that range, or no such place is on a lane of a road.
        """
        steps = math.floor((-self.begins_x_m - range_m) / per_step_m + _ROUNDING)
        for count in range(steps, -1, -1):
            x_m = -range_m - count * per_step_m
            if any(each.start_m - _ROUNDING <= x_m <= each.end_m for each in self.stretches):
                return x_m
        return None

    def number_at(self, x_m: float) -> int:
        """Which stretch a place on the lane is on, before the crosswalk the later of two."""
        numbers = range(len(self.stretches))
        return max(n for n in numbers if self.stretches[n].start_m - _ROUNDING <= x_m)


def streams_of(site: Site) -> tuple[Stream, ...]:
    """The streams of a site's ways, in their order: the ego's direction, then the oncoming ones."""
    users = Counter(lane for way in site.ways for lane in {_lane(each) for each in way.stretches})
    streams = []
    for way in site.ways:
        stretches = way.stretches
        over = max(n for n, stretch in enumerate(stretches) if stretch.start_m < 0)
        first, last = over, over + 1
        while first > 0 and users[_lane(stretches[first - 1])] == 1:
            first -= 1
        while last + 1 < len(stretches) and users[_lane(stretches[last + 1])] == 1:
            if stretches[last + 1].start_m >= REACH_AFTER_M:
                break
            last += 1
        streams.append(Stream(way, stretches[first : last + 1], stretches[over]))
    return tuple(streams)


def _lane(stretch: Stretch) -> tuple[str, int]:
    return stretch.edge, stretch.lane
