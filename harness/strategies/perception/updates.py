"""The truth at a step in; the pedestrians as a sensor with errors shows them out.

docs/strategies.md defines the errors.  ``encounter_view`` uses them in encounters, and
``simulation.people_at`` in simulations.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from types import MappingProxyType

import numpy as np
from scipy.special import ndtri

from harness.core.seeding import Given, GivenFirst, Purpose, stream
from harness.core.vocabulary import PedestrianView, Views
from harness.strategies.perception.sensor import TRACK_STREAMS, Sensor

Look = Callable[[], Iterable[tuple[PedestrianView, bool]]]
"""Returns everybody at the crosswalk, and whether they are in range and in sight."""


def updates_until_found(quantile: float, detection_probability: float) -> float:
    """Number of updates until a pedestrian in sight is detected: geometric, by its inverse CDF.

    N = ⌈ln(1 − u)/ln(1 − p)⌉, at least 1, so that P(N = n) = p (1 − p)^(n − 1).

    Args:
        quantile: u in [0, 1); a larger one means a later detection.
        detection_probability: p in [0, 1], the probability at each update.

    Returns:
        A whole number ≥ 1; infinite for p = 0.

    Example:
        >>> updates_until_found(0.5, 0.9), updates_until_found(0.95, 0.9)
        (1, 2)
    """
    if detection_probability >= 1:
        return 1
    if detection_probability <= 0:
        return math.inf
    return max(1, math.ceil(math.log1p(-quantile) / math.log1p(-detection_probability)))


class SensorTrack:
    """A sensor's track of one pedestrian; ``update`` is called at every update after they arrive.

    Args:
        sensor: the sensor, with its probabilities and errors.
        pair: index of the pair, which keys the streams.
        index: index of the pedestrian, which keys the streams too.
        quantile: quantile of the time to the first detection; None if detection is certain.
        given: uniforms of the first errors and of the wait after the first loss, by pedestrian.
        vehicle: numbers ≥ 0 that key the streams of a vehicle among several; see ``track_from``.
    """

    def __init__(
        self,
        sensor: Sensor,
        pair: int,
        index: int,
        quantile: float | None,
        given: Given = MappingProxyType({}),
        vehicle: tuple[int, ...] = (),
    ) -> None:
        self._sensor, self._key = sensor, (pair, *vehicle, index)
        section = self._section = sensor.section
        self._wait = 1.0
        if quantile is not None:
            self._wait = updates_until_found(quantile, section.detection_probability)
        self._found = False
        self._again: np.random.Generator | None = None
        self._dropout, self._noise = self._stream("dropout"), self._stream("perception_error")
        # In standard deviations; the process is stationary from the first update on.
        self._errors = np.zeros(2) if self._noise is None else self._noise.standard_normal(2)
        self._wait_given = _first("redetection", given, index)
        first = _first("perception_error", given, index)
        if self._noise is not None and first:
            self._errors = ndtri(np.array(first))

    def update(self, in_sight: bool) -> bool:
        """Whether the driver sees the pedestrian after one more update.

        The sensor detects them at the N-th update in sight (``updates_until_found``).  It keeps the
        track until an update drops it or they are out of sight; then it must detect them again.
        """
        # There is one draw for each update in any case, so that strategies share the draws.
        drawn = 1.0 if self._dropout is None else self._dropout.random()
        if self._found:
            if in_sight and drawn >= self._section.dropout_probability:
                return True
            self._found, self._wait = False, self._wait_again()
            return False
        if in_sight:
            self._wait -= 1
            self._found = self._wait <= 0
        return self._found

    def next_errors(self) -> tuple[float, float]:
        """The errors of this update: of the position along the walk in m and of the speed in m/s.

        They are first-order autoregressive, e' = φ e + √(1 − φ²) σ n: an Ornstein-Uhlenbeck process
        at the times of the updates, with variance σ² and correlation φ^k after k updates.
        """
        if self._noise is None:
            return 0.0, 0.0
        place, speed = self._errors.tolist()
        kept = self._sensor.correlation
        fresh = self._noise.standard_normal(2)
        self._errors = kept * self._errors + math.sqrt(1 - kept**2) * fresh
        return place * self._section.position_sd_m, speed * self._section.speed_sd_mps

    def _wait_again(self) -> float:
        probability = self._section.detection_probability
        if probability >= 1:
            return 1
        if self._again is None:
            again = stream(self._sensor.seed, "redetection", *self._key)
            self._again = GivenFirst(again.bit_generator, self._wait_given)
        return updates_until_found(self._again.random(), probability)

    def _stream(self, purpose: Purpose) -> np.random.Generator | None:
        drawn = TRACK_STREAMS[purpose].drawn(self._sensor)
        return stream(self._sensor.seed, purpose, *self._key) if drawn else None


def _first(purpose: Purpose, given: Given, index: int) -> Sequence[float]:
    """The given first random numbers of the pedestrian with this index."""
    count = TRACK_STREAMS[purpose].given
    return given.get(purpose, ())[count * index : count * (index + 1)]


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
    pedestrians who are in sight and within the detection range (``SensorTrack``), and adds its
    errors to their position along the walk and to their speed.

    The sensor makes no errors in whether they walk or stand, and whether they are on the crossing.

    Args:
        sensor: the sensor.
        new_track: makes the track of the pedestrian with this index.
    """

    def __init__(self, sensor: Sensor, new_track: Callable[[int], SensorTrack]) -> None:
        self._sensor, self._new_track = sensor, new_track
        self._tracks: dict[int, SensorTrack] = {}
        self._findings: deque[tuple[int, Views]] = deque()
        self._shown: Views = ()
        self._step = -1

    def shown(self, look: Look) -> Views:
        """The pedestrians that the driver sees at the next step.

        Args:
            look: returns the ground truth; it is called only at updates.
        """
        self._step += 1
        step = self._step
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
