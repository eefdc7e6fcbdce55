"""The true pedestrians of one episode in, the ones that a driver sees out."""

from collections.abc import Sequence
from types import MappingProxyType

from harness.core.encounter import Arrival, PedestrianView
from harness.core.seeding import Given
from harness.strategies.perception.occlusion import is_hidden
from harness.strategies.perception.sensor import ROUNDING_M, Sensor
from harness.strategies.perception.updates import Track, Updates, Views


class Perception:
    """The pedestrians that one driver sees in one episode (``Updates``); to be used at every step.

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
        self._sensor = sensor
        quantiles = {arrival.index: arrival.detection_quantile for arrival in arrivals}
        self._updates = Updates(
            sensor, lambda index: Track(sensor, pair, index, quantiles[index], given)
        )

    def shown(self, step: int, x_m: float, people: Sequence[tuple[PedestrianView, float]]) -> Views:
        """The pedestrians that the driver sees at a step.

        Args:
            step: number of the step.  Successive calls have 0, 1, 2, ….
            x_m: x of the ego's front bumper.
            people: the ground truth: everybody at the crosswalk, with their x in m.
        """
        return self._updates.shown(
            step,
            lambda: [(view, self._in_sight(x_m, view, their_x_m)) for view, their_x_m in people],
        )

    def _in_sight(self, x_m: float, view: PedestrianView, their_x_m: float) -> bool:
        sensor = self._sensor
        if abs(x_m) > sensor.detection_range_m + ROUNDING_M:
            return False
        if not sensor.obstacles:
            return True
        eye = (x_m - sensor.eye_behind_m, sensor.crossing.lane_centre_m)
        place = (their_x_m, sensor.crossing.place_of(view.side, view.remaining_m))
        return not is_hidden(eye, place, sensor.obstacles)
