"""The errors of a sensor's track of one pedestrian; to add one, add an entry to ``ERRORS``."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from harness.core.seeding import Given, GivenFirst, Purpose, stream
from harness.core.vocabulary import PedestrianView
from harness.scenario.sections import PerceptionSection
from harness.strategies.perception.sensor import Sensor

Sighting = tuple[PedestrianView, bool]
"""A pedestrian, and whether the sensor sees them."""


class SensorTrack(NamedTuple):
    """A sensor's track of one pedestrian, with the streams of its random numbers.

    Attributes:
        sensor: the sensor, with its probabilities and errors.
        pair: index of the pair, which keys the streams.
        person: index of the pedestrian, which keys the streams too.
        quantile: quantile of the time to the first detection; None if detection is certain.
        given: uniforms that replace the first draws of streams, by pedestrian.
        vehicle: numbers ≥ 0 that key the streams of a vehicle among several; see ``track_from``.
    """

    sensor: Sensor
    pair: int
    person: int
    quantile: float | None
    given: Given = MappingProxyType({})
    vehicle: tuple[int, ...] = ()

    def stream(self, purpose: Purpose) -> np.random.Generator:
        """The track's stream of a purpose."""
        return stream(self.sensor.seed, purpose, self.pair, *self.vehicle, self.person)

    def first(self, purpose: Purpose) -> Sequence[float]:
        """The given first random numbers of a purpose."""
        count = TRACK_STREAMS[purpose].given
        return self.given.get(purpose, ())[count * self.person : count * (self.person + 1)]


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


class Detection:
    """Late detections and lost tracks.

    The sensor detects a pedestrian at the N-th update in sight (``updates_until_found``).  It keeps
    the track until an update drops it or they are out of sight; then it must detect them again.
    """

    def __init__(self, track: SensorTrack) -> None:
        section = track.sensor.section
        self._probability, self._lost = section.detection_probability, section.dropout_probability
        self._later = self._waits(track)
        self._wait, self._found = next(self._later), False
        self._dropout = track.stream("dropout") if self._lost > 0 else None

    def __call__(self, view: PedestrianView, seen: bool) -> Sighting:
        """The same pedestrian, and whether they are tracked after one more update."""
        return view, self.found(seen)

    def found(self, in_sight: bool) -> bool:
        """Whether a pedestrian is tracked after one more update, at which they may be in sight."""
        # There is one draw for each update in any case, so that strategies share the draws.
        drawn = 1.0 if self._dropout is None else self._dropout.random()
        if self._found:
            self._found = in_sight and drawn >= self._lost
            if not self._found:
                self._wait = next(self._later)
        elif in_sight:
            self._wait -= 1
            self._found = self._wait <= 0
        return self._found

    def _waits(self, track: SensorTrack) -> Iterator[float]:
        """The updates in sight until the first detection, then until each later one."""
        first = 0.0 if track.quantile is None else track.quantile  # None: at the first update
        yield updates_until_found(first, self._probability)
        again = GivenFirst(track.stream("redetection").bit_generator, track.first("redetection"))
        while True:
            yield updates_until_found(again.random(), self._probability)


class Noise:
    """Errors of the position along the walk and of the speed.

    They are first-order autoregressive, e' = φ e + √(1 − φ²) σ n: an Ornstein-Uhlenbeck process at
    the times of the updates, with variance σ² and correlation φ^k after k updates.
    """

    def __init__(self, track: SensorTrack) -> None:
        section, given = track.sensor.section, track.first("perception_error")
        self._place_m, self._speed_mps = section.position_sd_m, section.speed_sd_mps
        kept_s = section.correlation_s
        self._kept = math.exp(-track.sensor.update_s / kept_s) if kept_s else 0.0
        self._noise = track.stream("perception_error")
        # In standard deviations; the process is stationary from the first update on.
        errors = self._noise.standard_normal(2)
        self._errors = ndtri(np.array(given)) if given else errors

    def __call__(self, view: PedestrianView, seen: bool) -> Sighting:
        """The pedestrian where the sensor takes them to be, which it does at every update."""
        place_m, speed_mps = self.next_errors()
        if not seen:
            return view, seen
        # The driver sees nobody beyond the far kerb or walking backwards.
        ahead_m = min(place_m, view.remaining_m)
        shifted = view._replace(
            lateral_m=view.lateral_m - ahead_m,
            remaining_m=view.remaining_m - ahead_m,
            speed_mps=max(0.0, view.speed_mps + speed_mps) if view.speed_mps > 0 else 0.0,
        )
        return shifted, seen

    def next_errors(self) -> tuple[float, float]:
        """The errors of this update, in m and m/s."""
        place, speed = self._errors.tolist()
        kept, fresh = self._kept, self._noise.standard_normal(2)
        self._errors = kept * self._errors + math.sqrt(1 - kept**2) * fresh
        return place * self._place_m, speed * self._speed_mps


class TrackStream(NamedTuple):
    """Random numbers of the track of one pedestrian, from the stream of one purpose.

    Attributes:
        given: how many of a pedestrian's first ones can be given, as those that a risk samples.
        later: what the others decide, in words; empty if a risk need not tell.
        drawn: whether a sensor with the error draws them on the way to the crosswalk.
    """

    given: int = 0
    later: str = ""
    drawn: Callable[[Sensor], bool] = lambda _: True


class TrackError(NamedTuple):
    """An error of a sensor.

    Attributes:
        begin: makes the error of a new track.  At every update it is given the pedestrian, and
            whether they are seen, as the errors before it leave them, and returns the same.
        keys: its keys of ``[perception]``; there is no error if all have their defaults.
        streams: its random numbers by purpose, in the order in which a risk samples them.
    """

    begin: Callable[[SensorTrack], Callable[[PedestrianView, bool], Sighting]]
    keys: tuple[str, ...]
    streams: Mapping[Purpose, TrackStream]

    def is_of(self, sensor: Sensor) -> bool:
        """Whether a sensor has the error."""
        return bool(sensor.section.changed(self.keys))


# fmt: off
ERRORS = (
    TrackError(Detection, ("detection_probability", "dropout_probability"), MappingProxyType({
        "redetection": TrackStream(1, drawn=lambda s: s.section.detection_probability < 1 and (
            s.section.dropout_probability > 0 or len(s.obstacles) > 0)),
        "dropout": TrackStream(later="the updates at which perception loses a pedestrian",
                               drawn=lambda s: s.section.dropout_probability > 0),
    })),
    TrackError(Noise, ("position_sd_m", "speed_sd_mps"), MappingProxyType({
        "perception_error": TrackStream(
            2, "the change of perception errors after a pedestrian's first update"),
    })),
)
"""The errors, in the order in which they act at an update."""
# fmt: on
_KEYS = {key for error in ERRORS for key in error.keys}
assert PerceptionSection.model_fields.keys() >= _KEYS, "a key of an error is none of [perception]"

TRACK_STREAMS = MappingProxyType({key: of for error in ERRORS for key, of in error.streams.items()})
"""All that tracks draw at random, by purpose."""


def streams_of(sensor: Sensor) -> dict[Purpose, TrackStream]:
    """What the tracks of a sensor draw at random, by purpose."""
    streams = (each for error in ERRORS if error.is_of(sensor) for each in error.streams.items())
    return {purpose: of for purpose, of in streams if of.drawn(sensor)}
