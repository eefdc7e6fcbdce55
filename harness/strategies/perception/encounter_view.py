"""Whom a driver sees in an encounter: within range, past obstacles, with the sensor's errors."""

from collections.abc import Iterable, Sequence

from harness.core.seeding import Given
from harness.core.vocabulary import Arrival, PedestrianView, Views
from harness.strategies.perception.occlusion import is_hidden
from harness.strategies.perception.sensor import Sensor
from harness.strategies.perception.track_errors import SensorTrack
from harness.strategies.perception.updates import Updates


class Perception:
    """The pedestrians that one driver sees in one episode (``Updates``); to be used at every step.

    Args:
        sensor: the sensor of the arm.
        arrivals: all pedestrians who may arrive.
        pair: index of the pair, which keys every stream.
        given: uniforms that replace draws.
    """

    def __init__(
        self, sensor: Sensor, arrivals: Sequence[Arrival], pair: int, given: Given
    ) -> None:
        self._sensor = sensor
        found = {arrival.index: arrival.detection_quantile for arrival in arrivals}
        self._updates = Updates(sensor, lambda i: SensorTrack(sensor, pair, i, found[i], given))

    def shown(self, near: bool, x_m: float, people: Iterable[PedestrianView]) -> Views:
        """The pedestrians that the driver sees at the next step.

        Args:
            near: whether the ego is within the detection range.
            x_m: x of the ego's front bumper.
            people: the ground truth: everybody at the crosswalk.
        """
        return self._updates.shown(
            lambda: [(view, near and self._in_sight(x_m, view)) for view in people]
        )

    def _in_sight(self, x_m: float, view: PedestrianView) -> bool:
        sensor = self._sensor
        if not sensor.obstacles:
            return True
        eye = (x_m - sensor.eye_behind_m, sensor.crossing.lane_centre_m)
        place = (0.0, sensor.crossing.place_of(view.side, view.remaining_m))
        return not is_hidden(eye, place, sensor.obstacles)
