"""A site in; each lane's stream out, with the positions at which its vehicles enter and leave."""

import math
from collections import Counter
from dataclasses import dataclass

from harness.site.site import TOLERANCE_M, Site, Stretch, Way
from harness.site.ways import REACH_AFTER_M, REACH_BEFORE_M

_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Stream:
    """The way of one lane for a stream of vehicles; x is along the lane's own direction.

    Its stretches belong to no other lane's way.  They begin where the road begins, where lanes
    merge, or at least 300 m before the crosswalk.  They end where the road ends, where lanes merge,
    or at least 120 m after it.

    Attributes:
        way: the lane's way.
        stretches: its lanes of edges, without those inside junctions.
        approach: the stretch that leads to the crosswalk.
    """

    way: Way
    stretches: tuple[Stretch, ...]
    approach: Stretch

    @property
    def begins_x_m(self) -> float:
        """The x farthest upstream at which vehicles can enter."""
        return max(self.stretches[0].start_m, -REACH_BEFORE_M - TOLERANCE_M)

    @property
    def ends_x_m(self) -> float:
        """The x at which vehicles leave the road."""
        return min(self.stretches[-1].end_m, REACH_AFTER_M)

    def entry_x_m(self, range_m: float, per_step_m: float) -> float | None:
        """The x at which vehicles enter: the farthest one that is whole steps before the range.

        Args:
            range_m: distance before the crosswalk at which a passage begins.
            per_step_m: distance of one step at v0.

        Returns:
            None if the lane begins within that range, or if every such x is inside a junction.
        """
        steps = math.floor((-self.begins_x_m - range_m) / per_step_m + _ROUNDING)
        for count in range(steps, -1, -1):
            x_m = -range_m - count * per_step_m
            if any(
                stretch.start_m - _ROUNDING <= x_m <= stretch.end_m for stretch in self.stretches
            ):
                return x_m
        return None

    def number_at(self, x_m: float) -> int:
        """The number of the stretch at x; where two stretches meet, the later one."""
        numbers = range(len(self.stretches))
        return max(n for n in numbers if self.stretches[n].start_m - _ROUNDING <= x_m)


def streams_of(site: Site) -> tuple[Stream, ...]:
    """The streams of a site's ways, in the order of ``Site.ways``."""
    users = Counter(
        lane for way in site.ways for lane in {_lane(stretch) for stretch in way.stretches}
    )
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
