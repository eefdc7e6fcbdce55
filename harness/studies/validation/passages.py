"""Recorded passages: one vehicle's way through one group of people who cross its path."""

from collections.abc import Mapping
from dataclasses import dataclass

from harness.core.encounter import Arrival, Crossing, FloatArray, Vehicle

BEYOND_S = 30.0
"""How much later than the recorded vehicle a simulated one may pass before its time is up."""

LEFT_OUT: Mapping[str, str] = {
    "parked_vehicle": "vehicle that never gets away from where it was first seen",
    "no_pedestrian": "nobody was recorded together with the vehicle",
    "nobody_crosses": "no path of a walker crosses the vehicle's path at 50 to 130°",
    "only_standing_pedestrians": "everybody recorded together with the vehicle stood",
    "begins_too_near": "the record begins less than 6 m before the group, or among it",
    "gap": "a gap in the record of the vehicle, or of someone on the crossing",
    "pass_not_recorded": "the record ends before the front bumper is at x = 0, or with the "
    "vehicle standing, or more than 12 m before its rear has left the crosswalk",
    "nobody_left": "everybody of the group had crossed when the passage begins",
}
"""Why a vehicle, or its way through a group, is no passage: the first reason that applies."""


@dataclass(frozen=True, eq=False)
class Passage:
    """One recorded passage in the road's frame: x = 0 at the group's median conflict point.

    Attributes:
        source, clip, vehicle_key, group: identify the passage; ``group`` counts along the path.
        vehicle: the ego's constants; ``initial_speed_mps`` is its free speed v0, which it goes
            back to: the highest of its speed at the start and its mean speeds over one second.
        start_speed_mps: its speed at the start, of a parabola through the first 0.5 s.
        crossing: as wide as the conflict points are apart, kerbs 4.5 m either side of the path.
        step_s: of ``x_m``, and of the simulations.
        x_m: (n,) the recorded front bumper at every step, until its rear has left the crosswalk.
        recorded_s: when the record ends; from then on it keeps its last speed.
        arrivals: the people who are there during the passage, with their walks.
        passing_s: for each of them, when they pass the vehicle's path; −inf for those who had
            passed it at the start, inf for those who never do.
        conflict_x_m: where they do.
        extended: for each of them, whether a part of the walk was not recorded.
    """

    source: str
    clip: str
    vehicle_key: str
    group: int
    vehicle: Vehicle
    start_speed_mps: float
    crossing: Crossing
    step_s: float
    x_m: FloatArray
    recorded_s: float
    arrivals: tuple[Arrival, ...]
    passing_s: FloatArray
    conflict_x_m: FloatArray
    extended: tuple[bool, ...]

    @property
    def vehicle_id(self) -> tuple[str, str, str]:
        """The vehicle, whose passages resampling and folds keep together."""
        return self.source, self.clip, self.vehicle_key

    @property
    def name(self) -> str:
        """Clip, vehicle and group in one word."""
        return f"{self.clip}/{self.vehicle_key}#{self.group}"


@dataclass(frozen=True, eq=False)
class Passages:
    """The passages of a set, and how many were left out for which reason of ``LEFT_OUT``."""

    used: tuple[Passage, ...]
    left_out: Mapping[str, int]

    @property
    def vehicles(self) -> int:
        """Vehicles with a passage."""
        return len({passage.vehicle_id for passage in self.used})

    @property
    def encounters(self) -> int:
        """Pedestrians who pass a vehicle's path after its passage began, over all passages."""
        return sum(int((passage.passing_s > 0).sum()) for passage in self.used)
