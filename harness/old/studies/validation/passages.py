"""Recorded passages, in which one vehicle passes through one group of crossing pedestrians."""

from collections.abc import Mapping
from dataclasses import dataclass

from harness.core.encounter import Arrival, Crossing, FloatArray, Vehicle

BEYOND_S = 30.0
"""A simulated vehicle times out this long after the recorded vehicle has passed."""

LEFT_OUT: Mapping[str, str] = {
    "parked_vehicle": "the vehicle stays near its first position",
    "no_pedestrian": "no pedestrian is recorded at the same time as the vehicle",
    "nobody_crosses": "no pedestrian's path crosses the vehicle's path at 50 to 130°",
    "only_standing_pedestrians": "all pedestrians recorded with the vehicle stand",
    "begins_too_near": "the vehicle's record begins less than 6 m before the conflict points",
    "gap": "the record of the vehicle or of a pedestrian on the crosswalk has a gap",
    "pass_not_recorded": "the record ends too early: before the front bumper reaches x = 0, while "
    "the vehicle stands, or more than 12 m before its rear leaves the crosswalk",
    "nobody_left": "all pedestrians of the group crossed before the passage begins",
}
"""Reasons why a vehicle or a passage is excluded.  Only the first reason that applies counts."""


@dataclass(frozen=True, eq=False)
class Passage:
    """One recorded passage in the road's frame: x = 0 at the group's median conflict point.

    Attributes:
        source, clip, vehicle_key, group: identify the passage; groups are numbered along the path.
        vehicle: the ego's constants.  ``initial_speed_mps`` is the free speed v0: the maximum of
            the start speed and of the mean speeds over one second.
        start_speed_mps: the speed at the start, from a parabola through the first 0.5 s.
        crossing: the crosswalk.  Its width is the spread of the conflict points; its kerbs are
            4.5 m from the vehicle's path on either side.
        step_s: time step of ``x_m`` and of the simulations.
        x_m: (n,) recorded position of the front bumper at every step, until the rear has left the
            crosswalk.
        recorded_s: end of the record; after it the vehicle keeps its last speed.
        arrivals: the pedestrians who are present during the passage, with their walks.
        passing_s: (pedestrians,) time at which they cross the vehicle's path; −inf if they crossed
            it before the start, inf if they never cross it.
        conflict_x_m: (pedestrians,) place along the road at which they cross the vehicle's path.
        extended: (pedestrians,) whether a part of the walk was not recorded.
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
        """Identifies the vehicle, whose passages stay together in resampling and folds."""
        return self.source, self.clip, self.vehicle_key

    @property
    def name(self) -> str:
        """A name made of clip, vehicle and group."""
        return f"{self.clip}/{self.vehicle_key}#{self.group}"


@dataclass(frozen=True, eq=False)
class Passages:
    """The passages of a data set, and the number excluded for each reason of ``LEFT_OUT``."""

    used: tuple[Passage, ...]
    left_out: Mapping[str, int]

    @property
    def vehicles(self) -> int:
        """Number of vehicles with a passage."""
        return len({passage.vehicle_id for passage in self.used})

    @property
    def encounters(self) -> int:
        """Number of pedestrians who cross a vehicle's path after its passage began."""
        return sum(int((passage.passing_s > 0).sum()) for passage in self.used)
