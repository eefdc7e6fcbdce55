"""A scenario and a pair's number in; the arrival of each pedestrian out."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from statistics import NormalDist
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np

from harness.core.seeding import Given, Purpose, stream
from harness.core.vocabulary import SECONDS_PER_HOUR, Arrival, FloatArray, Leg, Side
from harness.encounter.deciding import lognormal_s
from harness.scenario import Scenario
from harness.scenario.pedestrians import GapAcceptanceSection, PedestriansSection

_BLOCK = 32
"""Arrivals that are drawn at once; no result depends on it."""

Drawn = TypeVar("Drawn")


def planned_arrivals(
    scenario: Scenario,
    pair: int,
    given: Given = MappingProxyType({}),
    horizon_s: float | None = None,
    key: tuple[int, ...] = (),
) -> tuple[Arrival, ...]:
    """All pedestrians who may arrive during an episode of this pair, by arrival time.

    Arrivals are a Poisson process of rate λ (paper, section III-B).  The time of arrival i is the
    sum of i + 1 unit exponentials, times 3600/λ.  So λ only stretches the time axis, and the cells
    of a sweep over λ share their random numbers.  With ``first_at_trigger`` pedestrian 0 is at the
    kerb at t = 0, and the others follow.  Side, quantile, critical gap, threshold, latency, class
    and detection quantile of pedestrian i are the i-th draws of their own streams.  Timed
    pedestrians are present from the trigger, are the same in every pair, and have the first
    indices.

    In groups, the process is that of the groups, at λ over their mean size.  The members of group g
    arrive together; its size, side, critical gap, threshold and latency are the g-th draws of their
    streams.

    Args:
        scenario: has flow, bounds, shares and seed.
        pair: index of the pair; both arms and all cells get the same pedestrians.
        given: uniforms that replace the first draws.
        horizon_s: the last possible arrival time; None for ``timeout_s``.
        key: distinguishes the crosswalks of a pair that has several.

    Returns:
        At most ``max_count`` arrivals at times in [0, horizon], and the timed pedestrians.
    """
    pedestrians, experiment = scenario.pedestrians, scenario.experiment
    uniforms = _Uniforms(experiment.seed, (pair, *key), given)
    horizon_s = experiment.timeout_s if horizon_s is None else horizon_s
    times = _arrival_times(pedestrians, uniforms, horizon_s)
    groups = _groups(pedestrians, uniforms, len(times))
    count = len(groups)
    from_near = uniforms.first("side", len(times)) < pedestrians.near_side_share
    quantiles = uniforms.first("quantile", count)
    marks = _marks(pedestrians, uniforms, len(times), count)
    walks = scenario.timed_walks()
    certain = scenario.perception.detection_probability >= 1
    first_seen = uniforms.each("timed_detection", 0 if certain else len(walks), float)
    detections = uniforms.each("detection", 0 if certain else count, float)
    timed = [
        Arrival(index, 0.0, side, None, path=path, detection_quantile=first_seen.get(index))
        for index, (side, path) in enumerate(walks)
    ]
    others = [
        Arrival(
            len(timed) + number,
            times[group],
            Side.NEAR if from_near[group] else Side.FAR,
            float(quantiles[number]),
            marks.gaps_s.get(group),
            detection_quantile=detections.get(number),
            threshold_s=marks.thresholds_s.get(group),
            latency_s=marks.latencies_s.get(group),
            walking_class=marks.classes.get(number),
        )
        for number, group in enumerate(groups)
    ]
    return (*timed, *_led(others, groups))


class _Marks(NamedTuple):
    """What the behaviour draws for each group, and the classes of people; empty if not drawn."""

    gaps_s: Mapping[int, float]
    thresholds_s: Mapping[int, float]
    latencies_s: Mapping[int, float]
    classes: Mapping[int, int | None]


def _marks(
    pedestrians: PedestriansSection, uniforms: "_Uniforms", groups: int, people: int
) -> _Marks:
    """The marks of so many groups and people."""
    gaps, times = pedestrians.gap_acceptance, pedestrians.threshold

    def drawn(purpose: Purpose, count: int, of: Callable[[float], Drawn]) -> dict[int, Drawn]:
        return uniforms.each(purpose, count if purpose in pedestrians.marks else 0, of)

    return _Marks(
        drawn("critical_gap", groups, lambda uniform: critical_gap_s(uniform, gaps)),
        drawn(
            "threshold",
            groups,
            lambda uniform: times.factor * lognormal_s(uniform, times.log_mean, times.log_sd),
        ),
        drawn(
            "latency",
            groups,
            lambda uniform: lognormal_s(uniform, times.latency_log_mean, times.latency_log_sd),
        ),
        drawn("walking_class", people, pedestrians.walking_class_at),
    )


def already_walking(
    scenario: Scenario, pair: int, walking_speed: Callable[[float, int | None], float], first: int
) -> tuple[Arrival, ...]:
    """Pedestrians who arrived in ``pedestrians.warm_up_s`` and are on the crosswalk at the trigger.

    The flow before the trigger is a Poisson process of the rate at the trigger.  It is drawn
    backwards in time from its own stream, so later arrivals are the same with and without it.  A
    row of four draws belongs to a group: its gap and side, quantile and detection of its first
    member.  Its size with its further members, and the classes, have streams of their own.
    These pedestrians met no vehicle: each began to walk on arrival, at the speed of their own
    quantile.  Pedestrians who reached the other kerb before the trigger are left out.

    Args:
        scenario: has flow, shares, crossing and seed.
        pair: index of the pair.
        walking_speed: the walking speed in m/s at a quantile, in a class, without a vehicle.
        first: index of the first of these pedestrians.
    """
    pedestrians, length = scenario.pedestrians, scenario.crossing.length_m
    flow = pedestrians.flow_per_hour
    if not pedestrians.warm_up_s or not flow:
        return ()
    rng, others, classes = (
        stream(scenario.experiment.seed, "warm_up", pair, *part) for part in ((), (1,), (2,))
    )
    scale = SECONDS_PER_HOUR * pedestrians.mean_group_size / flow
    certain = scenario.perception.detection_probability >= 1
    present: list[Arrival] = []
    ago_s = 0.0
    while True:
        gap, side, *member = rng.random(4).tolist()
        ago_s -= scale * math.log1p(-gap)
        if ago_s > pedestrians.warm_up_s:
            return tuple(present)
        near = side < pedestrians.near_side_share
        kerb = Side.NEAR if near else Side.FAR
        members = [member]
        if len(pedestrians.group_size) > 1:
            size = pedestrians.group_size_at(others.random())
            members += others.random((size - 1, 2)).tolist()
        for quantile, detection in members:
            speed = walking_speed(quantile, pedestrians.walking_class_at(classes.random()))
            walked = speed * ago_s
            if walked < length:
                y, velocity = (walked, speed) if near else (length - walked, -speed)
                path = (Leg(0.0, 0.0, y, 0.0, velocity, 0.0),)
                seen = None if certain else detection
                index = first + len(present)
                present.append(Arrival(index, 0.0, kerb, None, path=path, detection_quantile=seen))


def critical_gap_s(uniform: float, gaps: GapAcceptanceSection) -> float:
    """The critical gap at a quantile of the distribution, in s, ≥ 0.

    With mean m and standard deviation s, the gap is either

    - lognormal, as in Troutbeck's maximum likelihood method: ln gap ~ N(ln m − σ²/2, σ) with
      σ² = ln(1 + s²/m²); or
    - logistic, as in binary logit models of gap acceptance, P = 1/(1 + exp(−(β0 + β1 gap))):
      m = −β0/β1 and s = π/(√3 β1); negative gaps become 0.

    Args:
        uniform: the quantile, in (0, 1).
        gaps: the distribution.
    """
    if gaps.distribution == "lognormal":
        sigma = math.sqrt(math.log1p((gaps.std_s / gaps.mean_s) ** 2))
        location = math.log(gaps.mean_s) - sigma**2 / 2
        return math.exp(location + sigma * NormalDist().inv_cdf(uniform))
    scale = gaps.std_s * math.sqrt(3) / math.pi
    return max(0.0, gaps.mean_s + scale * math.log(uniform / (1 - uniform)))


class _Uniforms:
    """The uniforms of a pair's streams; given values replace the first draws."""

    def __init__(self, seed: int, key: tuple[int, ...], given: Given) -> None:
        self._seed, self._key, self._given = seed, key, given

    def first(self, purpose: Purpose, count: int) -> FloatArray:
        """The first ``count`` uniforms of a purpose."""
        values = stream(self._seed, purpose, *self._key).random(count)
        given = self._given.get(purpose, ())[:count]
        values[: len(given)] = given
        return values

    def each(
        self, purpose: Purpose, count: int, made: Callable[[float], Drawn]
    ) -> dict[int, Drawn]:
        """What is made of each of these uniforms, by their numbers.

        NumPy draws from [0, 1), but a quantile at 0 may be infinite, so they are kept above 0.
        """
        if not count:
            return {}
        return dict(enumerate(map(made, np.maximum(self.first(purpose, count), 2.0**-54).tolist())))


def _groups(pedestrians: PedestriansSection, uniforms: _Uniforms, count: int) -> list[int]:
    """The number of each pedestrian's group, of ``count`` groups; at most ``max_count``."""
    if len(pedestrians.group_size) == 1:
        return [*range(count)]
    drawn = uniforms.first("group_size", count).tolist()
    sizes = map(pedestrians.group_size_at, drawn)
    groups = [group for group, size in enumerate(sizes) for _ in range(size)]
    return groups[: pedestrians.max_count]


def _led(people: Iterable[Arrival], groups: Iterable[int]) -> Iterator[Arrival]:
    """The people; in each group, all but the first have the first as their leader."""
    leaders: dict[int, Arrival] = {}
    for person, group in zip(people, groups, strict=True):
        leader = leaders.setdefault(group, person)
        yield person if leader is person else person._replace(leader=leader)


def _arrival_times(
    pedestrians: PedestriansSection, uniforms: _Uniforms, horizon_s: float
) -> list[float]:
    """The times at which groups arrive; at most ``max_count``."""
    most = pedestrians.max_count
    times: list[float] = []
    if pedestrians.first_at_trigger and most != 0:
        times.append(0.0)
    if not pedestrians.flow_per_hour or len(times) == most:
        return times
    mean_s = SECONDS_PER_HOUR * pedestrians.mean_group_size / pedestrians.flow_per_hour
    waited, count = 0.0, _BLOCK
    # The first draw belongs to pedestrian 0, whether or not they were placed at the trigger.
    first = len(times)
    while True:
        # A longer sequence from the same stream begins with the same draws.
        for gap in -np.log1p(-uniforms.first("arrival", count)[first:]):
            waited += float(gap)
            time_s = waited * mean_s
            if time_s > horizon_s or len(times) == most:
                return times
            times.append(time_s)
        first, count = count, 2 * count
