"""A lane in; its path over a crosswalk out, with its straight part."""

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter
from typing import TYPE_CHECKING

from harness.site.road_network import RoadNetwork, allows, drawn_m, line_of
from harness.site.site import REACH_AFTER_M, REACH_BEFORE_M

if TYPE_CHECKING:
    from sumolib.net.connection import Connection
    from sumolib.net.lane import Lane

STRAIGHT_DEG = 1.0
"""Largest bend of a straight road."""

_TURNAROUND_DEG = 150.0
"""A link that turns by more than this is a turnaround."""

_ROUNDING_M = 0.02
"""Rounding of a network file's points, most of which have two decimals."""
_LENGTH_SHARE = 0.01
_LENGTH_M = 0.1
"""Largest difference between SUMO's length of a lane and its shape's: the larger of both limits."""


@dataclass(frozen=True)
class Path:
    """Successive lanes, and the point where they meet the crosswalk's centre line.

    ``start_m`` has the position of each lane's beginning by SUMO's lengths; positions are 0 at that
    point.  ``direction`` is the unit vector of travel there.
    """

    lanes: tuple["Lane", ...]
    start_m: tuple[float, ...]
    meeting: complex
    direction: complex

    def pieces(self) -> Iterator[tuple["Lane", float]]:
        """Each lane with the position of its beginning."""
        return zip(self.lanes, self.start_m, strict=True)


def paths_over(
    network: RoadNetwork, lane: "Lane", crosswalk: tuple[complex, complex]
) -> Iterator[Path]:
    """The paths from a lane through its junction over a crosswalk, straightest first.

    The last lane of each path is the one beyond the junction.
    """
    ways = []
    for link in lane.getOutgoing():
        via = _via(network, link)
        turn_deg = round(_turn_deg(_entering(via[-1]), _leaving(lane)), 3)
        ways.append((turn_deg, via[-1].getID(), via))
    for _, _, via in sorted(ways, key=itemgetter(0, 1)):
        path = _met([lane, *via], crosswalk)
        if path is not None:
            yield path


def extended(network: RoadNetwork, path: Path) -> Path:
    """A path extended at both ends by the straightest lanes."""
    lanes, starts = list(path.lanes), list(path.start_m)
    while starts[0] > -REACH_BEFORE_M:
        before = _straightest(network, lanes[0], backward=True)
        if before is None or any(lane in lanes for lane in before):
            break
        for lane in reversed(before):
            lanes.insert(0, lane)
            starts.insert(0, starts[0] - lane.getLength())
    while (end := starts[-1] + lanes[-1].getLength()) < REACH_AFTER_M:
        after = _straightest(network, lanes[-1], backward=False)
        if after is None or any(lane in lanes for lane in after):
            break
        for lane in after:
            lanes.append(lane)
            starts.append(end)
            end += lane.getLength()
    return Path(tuple(lanes), tuple(starts), path.meeting, path.direction)


@dataclass(frozen=True)
class Straight:
    """The straight part of a path at the crosswalk.

    Attributes:
        direction: its unit vector.
        before_m: its length before the crosswalk.
        after_m: its length after the crosswalk.
        ends_before: why it begins there, in words.
        ends_after: why it ends there, in words.
    """

    direction: complex
    before_m: float
    after_m: float
    ends_before: str
    ends_after: str


def straight(path: Path) -> Straight:
    """The part of a path that is straight within 1° of its direction at the crosswalk."""
    points = _simplified(_points(path))
    middle = next(i for i in range(len(points) - 1) if points[i][0] <= 0 < points[i + 1][0])
    direction = points[middle + 1][1] - points[middle][1]
    before, why_before = 0.0, "begins there"
    for i in range(middle, -1, -1):
        turn = _turn_deg(points[i + 1][1] - points[i][1], direction)
        if turn > STRAIGHT_DEG:
            why_before = f"bends by {turn:.1f}° {-points[i + 1][0]:.1f} m before the crosswalk"
            break
        before = -points[i][0]
    after, why_after = 0.0, "ends there"
    for i in range(middle, len(points) - 1):
        turn = _turn_deg(points[i + 1][1] - points[i][1], direction)
        if turn > STRAIGHT_DEG:
            why_after = f"bends by {turn:.1f}° {points[i][0]:.1f} m after the crosswalk"
            break
        after = points[i + 1][0]
    for lane, start_m in path.pieces():
        length, drawn = lane.getLength(), drawn_m(lane)
        if abs(length - drawn) <= max(_LENGTH_M, _LENGTH_SHARE * drawn):
            continue
        sizes = f"a length of {length:.6g} m and a shape of {drawn:.6g} m"
        problem = f"has a lane {lane.getID()} with {sizes}"
        if start_m < 0 and -start_m - length < before:
            before, why_before = max(0.0, -start_m - length), problem
        if start_m + length > 0 and start_m < after:
            after, why_after = max(0.0, start_m), problem
    return Straight(direction / abs(direction), before, after, why_before, why_after)


def _points(path: Path) -> list[tuple[float, complex]]:
    """The points of a path, each with its position on it; the crosswalk is one of them."""
    points: list[tuple[float, complex]] = [(0.0, path.meeting)]
    for lane, start_m in path.pieces():
        line, drawn = line_of(lane), drawn_m(lane)
        scale, done_m = (lane.getLength() / drawn if drawn else 1.0), 0.0
        points.append((start_m, line[0]))
        for a, b in pairwise(line):
            done_m += abs(b - a)
            points.append((start_m + done_m * scale, b))
    points.sort(key=itemgetter(0))
    return points


def _via(network: RoadNetwork, link: "Connection") -> list["Lane"]:
    """The internal lanes of a connection, then its target lane."""
    lanes: list[Lane] = []
    via = link.getViaLaneID()
    while via and len(lanes) < 10:
        lanes.append(network.net.getLane(via))
        ahead = (link.getViaLaneID() for link in lanes[-1].getOutgoing())
        via = next(filter(None, ahead), "")
    return [*lanes, link.getToLane()]


def _met(lanes: list["Lane"], crosswalk: tuple[complex, complex]) -> Path | None:
    """The path along successive lanes; None if they do not meet the crosswalk's centre line."""
    start, end = crosswalk
    starts = [0.0]
    for lane in lanes[:-1]:
        starts.append(starts[-1] + lane.getLength())
    for number, lane in enumerate(lanes):
        line, drawn = line_of(lane), drawn_m(lane)
        done = 0.0
        for a, b in pairwise(line):
            share = _crossed_at(a, b, start, end)
            if share is not None:
                at_m = starts[number] + lane.getLength() * (done + share * abs(b - a)) / drawn
                meeting = a + share * (b - a)
                direction = (b - a) / abs(b - a)
                return Path(tuple(lanes), tuple(s - at_m for s in starts), meeting, direction)
            done += abs(b - a)
    return None


def _crossed_at(a: complex, b: complex, c: complex, d: complex) -> float | None:
    """The point where segment c–d crosses segment a–b, as a share of a–b; None if it does not."""
    u, v, w = b - a, d - c, c - a
    area = (u.conjugate() * v).imag
    if area == 0:
        return None
    share, other = (w.conjugate() * v).imag / area, (w.conjugate() * u).imag / area
    return share if 0 <= share <= 1 and 0 <= other <= 1 else None


def _straightest(network: RoadNetwork, lane: "Lane", *, backward: bool) -> list["Lane"] | None:
    """The straightest lanes that lead to a lane, or from it; None if there are none."""
    best: tuple[float, str, list[Lane]] | None = None
    for link in lane.getIncomingConnections() if backward else lane.getOutgoing():
        start = link.getFromLane()
        if start.getEdge().isSpecial():
            continue
        lanes = [start, *_via(network, link)]
        if backward:
            turn = _turn_deg(_entering(lane), _leaving(start))
            ways = lanes[:-1]
        else:
            turn = _turn_deg(_entering(lanes[-1]), _leaving(lane))
            ways = lanes[1:]
        if turn > _TURNAROUND_DEG or not all(allows(part, "passenger") for part in ways):
            continue
        name = start.getID() + link.getToLane().getID()
        if best is None or (turn, name) < best[:2]:
            best = (turn, name, ways)
    return None if best is None else best[2]


def _leaving(lane: "Lane") -> complex:
    *_, a, b = line_of(lane)
    return b - a


def _entering(lane: "Lane") -> complex:
    a, b, *_ = line_of(lane)
    return b - a


def _turn_deg(heading: complex, other: complex) -> float:
    return math.degrees(abs(cmath.phase(heading * other.conjugate())))


def _simplified(points: list[tuple[float, complex]]) -> list[tuple[float, complex]]:
    """A line without the points that are within rounding of it (Douglas and Peucker, 1973)."""
    keep = {0, len(points) - 1}
    spans = [(0, len(points) - 1)]
    while spans:
        low, high = spans.pop()
        a, b = points[low][1], points[high][1]
        chord = b - a
        far, worst = 0, _ROUNDING_M
        for i in range(low + 1, high):
            off = points[i][1] - a
            away = abs((chord.conjugate() * off).imag) / abs(chord) if chord else abs(off)
            if away > worst:
                far, worst = i, away
        if far:
            keep.add(far)
            spans += [(low, far), (far, high)]
    kept = [points[i] for i in sorted(keep)]
    # Two equal points have no direction between them.
    return [
        point for i, point in enumerate(kept) if i == 0 or abs(point[1] - kept[i - 1][1]) > 1e-9
    ]
