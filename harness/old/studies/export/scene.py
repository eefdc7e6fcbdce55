"""What is exported of one arm of a pair: who moves where, on which road.

Positions are in the road frame (docs/export.md): the middle of a vehicle's front bumper, the centre
of a pedestrian.  Times count from the moment at which the exported vehicle is at the trigger.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from harness.core.encounter import Crossing, FloatArray, Side, Vehicle, Walk
from harness.measures.motion.walking import cleared_s, states_at
from harness.site.site import RoadFrame


@dataclass(frozen=True)
class Mover:
    """A vehicle or a pedestrian.

    Attributes:
        name: its name in the file.
        vehicle: its constants; None for a pedestrian.
        appears_s: the time from which it is there, at its first position.
        leaves_s: the time from which it is gone; None if it stays.
        time_s, x_m, y_m, speed_mps: its states, shapes (n,), n ≥ 1; n = 1 if it stands.
        facing: its direction in the road frame where it stands: (1, 0), (−1, 0), (0, 1), (0, −1).
    """

    name: str
    vehicle: Vehicle | None
    appears_s: float
    leaves_s: float | None
    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    speed_mps: FloatArray
    facing: tuple[float, float]


@dataclass(frozen=True)
class Box:
    """An obstacle in the road frame: centre, extent along the road and along the crosswalk."""

    x_m: float
    y_m: float
    length_m: float
    width_m: float


@dataclass(frozen=True)
class Scene:
    """One arm of a pair, or one passage and what is around it.

    Attributes:
        title: what it is, in a line.
        net: SUMO's network.
        frame: the road frame in the network.
        movers: the exported vehicle first.
        crossing: the crosswalk, for the exported vehicle's lane.
        end_s: the end of the record.
        timeout_s: time after which an episode of such a scenario ends.
        boxes: the obstacles.
    """

    title: str
    net: Path
    frame: RoadFrame
    movers: tuple[Mover, ...]
    crossing: Crossing
    end_s: float
    timeout_s: float
    boxes: tuple[Box, ...] = ()

    @cached_property
    def slant(self) -> float:
        """Sine of the angle between road and crosswalk."""
        frame = self.frame
        return abs(frame.along_x * frame.across_y - frame.along_y * frame.across_x)

    def headings(self, mover: Mover) -> FloatArray:
        """Directions (n,) in the network in rad, counter-clockwise from its x axis."""
        frame = self.frame
        along, across = mover.facing
        last = math.atan2(
            along * frame.along_y + across * frame.across_y,
            along * frame.along_x + across * frame.across_x,
        )
        if mover.vehicle is not None:
            return np.full(len(mover.time_s), last)
        x, y = frame.to_network(mover.x_m, mover.y_m)
        headings = []
        for dx, dy in zip(np.diff(x).tolist(), np.diff(y).tolist(), strict=True):
            last = math.atan2(dy, dx) if math.hypot(dx, dy) > _STANDS_M else last
            headings.append(last)
        return np.array([*headings, last])


_STANDS_M = 1e-6
"""A shorter way within a step has no direction."""


def walkers(
    walks: Iterable[Walk], crossing: Crossing, step_s: float, end_s: float, *, to_the_kerb: bool
) -> Iterator[Mover]:
    """The pedestrians of a record, by their arrival.

    Args:
        walks: their walks; times count from the trigger.
        crossing: the crosswalk.
        step_s: the simulation's step.
        end_s: the end of the record.
        to_the_kerb: whether those who are on their way at the end walk on to the other kerb.
    """
    for walk in walks:
        arrival = walk.arrival
        ends_s = cleared_s(walk, crossing)
        if arrival.arrival_s > end_s or (ends_s is not None and ends_s <= 0):
            continue
        near = arrival.side is Side.NEAR
        facing = (0.0, 1.0) if near else (0.0, -1.0)
        name, appears_s = f"pedestrian-{arrival.index}", max(0.0, arrival.arrival_s)
        if walk.start_s is None or (walk.start_s >= end_s and not to_the_kerb):
            place = np.array([0.0 if near else crossing.length_m])
            yield Mover(name, None, appears_s, None, np.array([appears_s]), 0 * place, place,
                        0 * place, facing)  # fmt: skip
            continue
        until_s = end_s if ends_s is None or (ends_s > end_s and not to_the_kerb) else ends_s
        start_s = max(0.0, walk.start_s)
        between = np.arange(math.floor(start_s / step_s), math.ceil(until_s / step_s) + 1) * step_s
        inside = between[(between > start_s + _ROUNDING_S) & (between < until_s - _ROUNDING_S)]
        times = np.array([start_s, *inside, until_s])
        x, y, speed, _ = states_at(walk, crossing, times)
        leaves_s = until_s if until_s == ends_s else None
        yield Mover(name, None, min(appears_s, start_s), leaves_s, times, x, y, speed, facing)


_ROUNDING_S = 1e-9
