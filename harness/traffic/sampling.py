"""Samples of every second of an hour: queues, stops, and where everybody is."""

from collections.abc import Iterable, Sequence

from harness.engine.road import SumoRoad
from harness.measures.efficiency import STANDING_MPS
from harness.traffic.vehicles import HourVehicle, LaneOnRoad, state_of

QUEUED_MPS = 5 / 3.6
"""Slower than this counts as queued (SUMO's queue output: 5 km/h)."""

SAMPLE_S = 1.0
"""How often the queues are looked at."""


def queued_in(road: SumoRoad, lanes: Sequence[LaneOnRoad]) -> list[int]:
    """The number of queued vehicles of each lane, with those upstream of the road.

    Stops before R0 are counted on the way.
    """
    counts = []
    for lane in lanes:
        queued = len(lane.due) + sum(car.speed_mps < QUEUED_MPS for car in lane.driven)
        for moving in lane.coming:
            speed = road.speed_of(moving.name)
            queued += speed < QUEUED_MPS
            standing = speed < STANDING_MPS
            moving.stops += standing and not moving.standing
            moving.standing = standing
        counts.append(queued)
    return counts


def note_paths(road: SumoRoad, on_road: Iterable[HourVehicle], step: int) -> None:
    """Note the vehicles that no strategy drives; the others are noted at every step anyway."""
    for moving in on_road:
        if moving.first_step is None or moving.passed:
            moving.path.append((step, *state_of(road, moving)))
