"""The true pedestrians at a sensor's updates in, the ones that a driver sees at each step out."""

from collections import deque
from collections.abc import Callable, Iterable

from harness.core.encounter import PedestrianView
from harness.strategies.perception.sensor import Sensor
from harness.strategies.perception.track import Track

Views = tuple[PedestrianView, ...]

Look = Callable[[], Iterable[tuple[PedestrianView, bool]]]
"""Returns everybody at the crosswalk, and whether they are in range and in sight."""


class Updates:
    """The updates of one vehicle's sensor; to be used at every step.

    The sensor updates at every ``update_steps``-th step.  The driver sees the result
    ``latency_steps`` later, and until the next result replaces it.  At an update the sensor detects
    pedestrians who are in sight and within the detection range (``Track``), and adds its errors to
    their position along the walk and to their speed.

    The sensor makes no errors in whether they walk or stand, and whether they are on the crossing.

    Args:
        sensor: the sensor.
        new_track: makes the track of the pedestrian with this index.
    """

    def __init__(self, sensor: Sensor, new_track: Callable[[int], Track]) -> None:
        self._sensor, self._new_track = sensor, new_track
        self._tracks: dict[int, Track] = {}
        self._findings: deque[tuple[int, Views]] = deque()
        self._shown: Views = ()

    def shown(self, step: int, look: Look) -> Views:
        """The pedestrians that the driver sees at a step.

        Args:
            step: number of the step.  Successive calls have 0, 1, 2, ….
            look: returns the ground truth; it is called only at updates.
        """
        if step % self._sensor.update_steps == 0:
            found = tuple(self._found(look()))
            self._findings.append((step + self._sensor.latency_steps, found))
        while self._findings and self._findings[0][0] <= step:
            self._shown = self._findings.popleft()[1]
        return self._shown

    def _found(self, people: Iterable[tuple[PedestrianView, bool]]) -> Iterable[PedestrianView]:
        for view, in_sight in people:
            track = self._tracks.get(view.index)
            if track is None:
                track = self._tracks[view.index] = self._new_track(view.index)
            errors = track.next_errors()
            if track.update(in_sight):
                yield _with_errors(view, *errors)


def _with_errors(view: PedestrianView, place_m: float, speed_mps: float) -> PedestrianView:
    if not place_m and not speed_mps:
        return view
    # The driver sees nobody beyond the far kerb or walking backwards.
    ahead_m = min(place_m, view.remaining_m)
    return view._replace(
        lateral_m=view.lateral_m - ahead_m,
        remaining_m=view.remaining_m - ahead_m,
        speed_mps=max(0.0, view.speed_mps + speed_mps) if view.speed_mps > 0 else 0.0,
    )
