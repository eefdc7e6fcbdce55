"""The true pedestrians of one episode in, the ones that a driver sees out."""

from collections import deque
from collections.abc import Sequence
from types import MappingProxyType

from harness.core.encounter import Arrival, PedestrianView
from harness.core.seeding import Given
from harness.strategies.perception.occlusion import is_hidden
from harness.strategies.perception.sensor import Sensor
from harness.strategies.perception.track import Track

ROUNDING_M = 1e-9
"""Tolerance of the detection range: engines differ in the last bits of their sums."""

Views = tuple[PedestrianView, ...]


class Perception:
    """The pedestrians that one driver sees in one episode; to be used at every step.

    The sensor updates at every ``update_steps``-th step.  The driver sees the result
    ``latency_steps`` later, and until the next result replaces it.  At an update the sensor detects
    pedestrians who are in sight and within the detection range (``Track``), and adds its errors to
    their position along the walk and to their speed.

    The sensor makes no errors in whether they walk or stand, and whether they are on the crossing.

    Args:
        sensor: the sensor of the arm.
        arrivals: all pedestrians who may arrive.
        pair: index of the pair, which keys every stream.
        given: uniforms that replace draws.
    """

    def __init__(
        self,
        sensor: Sensor,
        arrivals: Sequence[Arrival],
        pair: int,
        given: Given = MappingProxyType({}),
    ) -> None:
        self._sensor, self._pair, self._given = sensor, pair, given
        self._quantiles = {arrival.index: arrival.detection_quantile for arrival in arrivals}
        self._tracks: dict[int, Track] = {}
        self._findings: deque[tuple[int, Views]] = deque()
        self._shown: Views = ()

    def shown(self, step: int, x_m: float, people: Sequence[tuple[PedestrianView, float]]) -> Views:
        """The pedestrians that the driver sees at a step.

        Args:
            step: number of the step.  Successive calls have 0, 1, 2, ….
            x_m: x of the ego's front bumper.
            people: the ground truth: everybody at the crosswalk, with their x in m.
        """
        if step % self._sensor.update_steps == 0:
            self._findings.append((step + self._sensor.latency_steps, self._find(x_m, people)))
        while self._findings and self._findings[0][0] <= step:
            self._shown = self._findings.popleft()[1]
        return self._shown

    def _find(self, x_m: float, people: Sequence[tuple[PedestrianView, float]]) -> Views:
        in_range = abs(x_m) <= self._sensor.detection_range_m + ROUNDING_M
        views = []
        for view, their_x_m in people:
            track = self._track(view.index)
            errors = track.next_errors()
            if track.update(in_range and self._in_sight(x_m, view, their_x_m)):
                views.append(self._with_errors(view, *errors))
        return tuple(views)

    def _track(self, index: int) -> Track:
        if index not in self._tracks:
            quantile = self._quantiles[index]
            self._tracks[index] = Track(self._sensor, self._pair, index, quantile, self._given)
        return self._tracks[index]

    def _in_sight(self, x_m: float, view: PedestrianView, their_x_m: float) -> bool:
        sensor = self._sensor
        if not sensor.obstacles:
            return True
        eye = (x_m - sensor.eye_behind_m, sensor.crossing.lane_centre_m)
        place = (their_x_m, sensor.crossing.place_of(view.side, view.remaining_m))
        return not is_hidden(eye, place, sensor.obstacles)

    def _with_errors(
        self, view: PedestrianView, place_m: float, speed_mps: float
    ) -> PedestrianView:
        if not place_m and not speed_mps:
            return view
        # The driver sees nobody beyond the far kerb or walking backwards.
        ahead_m = min(place_m, view.remaining_m)
        return view._replace(
            lateral_m=view.lateral_m - ahead_m,
            remaining_m=view.remaining_m - ahead_m,
            speed_mps=max(0.0, view.speed_mps + speed_mps) if view.speed_mps > 0 else 0.0,
        )
