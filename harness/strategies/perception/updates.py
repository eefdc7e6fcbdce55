"""The truth at a step in; the pedestrians as a sensor with errors shows them out.

docs/strategies.md defines the errors.  ``encounter_view`` uses them in encounters, and
``simulation.people_at`` in simulations.
"""

from collections import deque
from collections.abc import Callable, Iterable

from harness.core.seeding import stream
from harness.core.vocabulary import PedestrianView, Views
from harness.strategies.perception.sensor import Sensor
from harness.strategies.perception.track_errors import ERRORS, SensorTrack, Sighting


def track_from(sensor: Sensor, pair: int, vehicle: tuple[int, ...], index: int) -> SensorTrack:
    """The track of a pedestrian by the sensor of one vehicle among several.

    Every draw, also that of the first detection, is from a stream of this vehicle and pedestrian.

    Args:
        sensor: the sensor.
        pair: index of the pair.
        vehicle: numbers ≥ 0 of the vehicle and of whatever else keys the streams of its sensor.
        index: number of the pedestrian, ≥ 0.
    """
    quantile = None
    if sensor.section.detection_probability < 1:
        quantile = stream(sensor.seed, "detection", pair, *vehicle, index).random()
    return SensorTrack(sensor, pair, index, quantile, vehicle=vehicle)


class Updates:
    """The updates of one vehicle's sensor; to be used at every step.

    The sensor updates at every ``update_steps``-th step.  The driver sees the result
    ``latency_steps`` later, and until the next result replaces it.  At an update the sensor detects
    pedestrians who are in sight and within the detection range, with its ``ERRORS``.

    The sensor makes no errors in whether they walk or stand, and whether they are on the crossing.

    Args:
        sensor: the sensor.
        new_track: makes the track of the pedestrian with this index.
    """

    def __init__(self, sensor: Sensor, new_track: Callable[[int], SensorTrack]) -> None:
        self._sensor, self._new_track = sensor, new_track
        self._errors = [error for error in ERRORS if error.is_of(sensor)]
        self._tracks: dict[int, list[Callable[[PedestrianView, bool], Sighting]]] = {}
        self._findings: deque[tuple[int, Views]] = deque()
        self._shown: Views = ()
        self._step = -1

    def shown(self, look: Callable[[], Iterable[Sighting]]) -> Views:
        """The pedestrians that the driver sees at the next step.

        Args:
            look: returns everybody at the crosswalk, and whether they are in range and in sight; it
                is called only at updates.
        """
        self._step += 1
        step = self._step
        if step % self._sensor.update_steps == 0:
            found = tuple(self._found(look()))
            self._findings.append((step + self._sensor.latency_steps, found))
        while self._findings and self._findings[0][0] <= step:
            self._shown = self._findings.popleft()[1]
        return self._shown

    def _found(self, people: Iterable[Sighting]) -> Iterable[PedestrianView]:
        for seen in people:
            index = seen[0].index
            if index not in self._tracks:
                track = self._new_track(index)
                self._tracks[index] = [error.begin(track) for error in self._errors]
            for error in self._tracks[index]:
                seen = error(*seen)
            if seen[1]:
                yield seen[0]
