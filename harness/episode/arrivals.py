"""A scenario and a pair's number in; the pair's pedestrians and their arrival times out."""

import math
from collections.abc import Callable
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import Arrival, Leg, Side
from harness.core.seeding import Given, Purpose, stream
from harness.episode.threshold import lognormal_s
from harness.scenario import GapAcceptanceSection, PedestriansSection, Scenario

SECONDS_PER_HOUR = 3600.0

_BLOCK = 32


def planned_arrivals(
    scenario: Scenario, pair: int, given: Given | None = None, horizon_s: float | None = None
) -> tuple[Arrival, ...]:
    """All pedestrians who may arrive during an episode of this pair, by arrival time.

    Arrivals are a Poisson process of rate λ (paper, section III-B).  The time of arrival i is the
    sum of i + 1 unit exponentials, times 3600/λ.  So λ only stretches the time axis, and the cells
    of a sweep over λ share their random numbers.  With ``first_at_trigger`` pedestrian 0 is at the
    kerb at t = 0, and the others follow.  Side, quantile, critical gap, threshold, latency and
    detection quantile of pedestrian i are the i-th draws of their own streams.  Timed pedestrians
    are present from the trigger, are the same in every pair, and have the first indices.

    Args:
        scenario: has flow, bounds, shares and seed.
        pair: index of the pair; both arms and all cells get the same pedestrians.
        given: uniforms that replace the first draws; None: the values of ``pedestrians.drawn`` for
            the pair, if any.
        horizon_s: the last possible arrival time; None for ``timeout_s``.

    Returns:
        At most ``max_count`` arrivals at times in [0, horizon], and the timed pedestrians.
    """
    pedestrians, experiment = scenario.pedestrians, scenario.experiment
    if given is None and pedestrians.drawn:
        drawn = pedestrians.drawn[pair]
        pair, given = drawn.episode, drawn.uniforms
    uniforms = _Uniforms(experiment.seed, pair, given or {})
    horizon_s = experiment.timeout_s if horizon_s is None else horizon_s
    times = _arrival_times(pedestrians, uniforms, horizon_s)
    count = len(times)
    from_near = uniforms.first("side", count) < pedestrians.near_side_share
    quantiles = uniforms.first("quantile", count)
    gaps = _critical_gaps(pedestrians, uniforms, count)
    thresholds, latencies = _thresholds(pedestrians, uniforms, count)
    walks = scenario.timed_walks()
    first_seen = _detections(scenario, uniforms, "timed_detection", len(walks))
    timed = [
        Arrival(index, 0.0, side, None, path=path, detection_quantile=detection)
        for index, ((side, path), detection) in enumerate(zip(walks, first_seen, strict=True))
    ]
    detections = _detections(scenario, uniforms, "detection", count)
    others = [
        Arrival(
            index,
            time,
            Side.NEAR if near else Side.FAR,
            float(quantile),
            gap,
            None,
            detection,
            threshold_s=threshold,
            latency_s=latency,
        )
        for index, (time, near, quantile, gap, detection, threshold, latency) in enumerate(
            zip(times, from_near, quantiles, gaps, detections, thresholds, latencies, strict=True),
            len(timed),
        )
    ]
    return (*timed, *others)


def already_walking(
    scenario: Scenario, pair: int, walking_speed: Callable[[float], float], first: int
) -> tuple[Arrival, ...]:
    """Pedestrians who arrived in ``pedestrians.warm_up_s`` and are on the crosswalk at the trigger.

    The flow before the trigger is a Poisson process of the same rate.  It is drawn backwards in
    time from its own stream, so later arrivals are the same with and without it.  These pedestrians
    met no vehicle: each began to walk on arrival, at the speed of their own quantile.  Pedestrians
    who reached the other kerb before the trigger are left out.

    Args:
        scenario: has flow, shares, crossing and seed.
        pair: index of the pair.
        walking_speed: the walking speed in m/s at a quantile, without a vehicle.
        first: index of the first of these pedestrians.
    """
    pedestrians, length = scenario.pedestrians, scenario.crossing.length_m
    if not pedestrians.warm_up_s or not pedestrians.flow_per_hour:
        return ()
    rng = stream(scenario.experiment.seed, "warm_up", pair)
    scale = SECONDS_PER_HOUR / pedestrians.flow_per_hour
    present: list[Arrival] = []
    ago_s = 0.0
    while True:
        gap, side, quantile, detection = rng.random(4).tolist()
        ago_s -= scale * math.log1p(-gap)
        if ago_s > pedestrians.warm_up_s:
            return tuple(present)
        speed = walking_speed(quantile)
        walked = speed * ago_s
        if walked < length:
            near = side < pedestrians.near_side_share
            y, velocity = (walked, speed) if near else (length - walked, -speed)
            path = (Leg(0.0, 0.0, y, 0.0, velocity, 0.0),)
            kerb = Side.NEAR if near else Side.FAR
            certain = scenario.perception.detection_probability >= 1
            seen = None if certain else detection
            present.append(
                Arrival(first + len(present), 0.0, kerb, None, path=path, detection_quantile=seen)
            )


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

    def __init__(self, seed: int, pair: int, given: Given) -> None:
        self._seed, self._pair, self._given = seed, pair, given

    def first(self, purpose: Purpose, count: int) -> NDArray[np.float64]:
        """The first ``count`` uniforms of a purpose."""
        values = stream(self._seed, purpose, self._pair).random(count)
        given = self._given.get(purpose, ())[:count]
        values[: len(given)] = given
        return values

    def inside(self, purpose: Purpose, count: int) -> list[float]:
        """The same, above 0: NumPy draws from [0, 1), but a quantile at 0 may be infinite."""
        inside: list[float] = np.maximum(self.first(purpose, count), 2.0**-54).tolist()
        return inside


def _critical_gaps(
    pedestrians: PedestriansSection, uniforms: _Uniforms, count: int
) -> list[float] | list[None]:
    if pedestrians.behaviour != "gap_acceptance":
        return [None] * count
    drawn = uniforms.inside("critical_gap", count)
    return [critical_gap_s(uniform, pedestrians.gap_acceptance) for uniform in drawn]


def _thresholds(
    pedestrians: PedestriansSection, uniforms: _Uniforms, count: int
) -> tuple[list[float], list[float]] | tuple[list[None], list[None]]:
    """The threshold θ and the latency of each pedestrian."""
    if pedestrians.behaviour != "threshold":
        return [None] * count, [None] * count
    times = pedestrians.threshold
    thresholds = [
        times.factor * lognormal_s(uniform, times.log_mean, times.log_sd)
        for uniform in uniforms.inside("threshold", count)
    ]
    latencies = [
        lognormal_s(uniform, times.latency_log_mean, times.latency_log_sd)
        for uniform in uniforms.inside("latency", count)
    ]
    return thresholds, latencies


def _detections(
    scenario: Scenario, uniforms: _Uniforms, purpose: Purpose, count: int
) -> list[float] | list[None]:
    """Quantiles of the time to the first detection; None if detection is certain."""
    if scenario.perception.detection_probability >= 1:
        return [None] * count
    quantiles: list[float] = uniforms.first(purpose, count).tolist()
    return quantiles


def _arrival_times(
    pedestrians: PedestriansSection, uniforms: _Uniforms, horizon_s: float
) -> list[float]:
    most = pedestrians.max_count
    times: list[float] = []
    if pedestrians.first_at_trigger and most != 0:
        times.append(0.0)
    if pedestrians.flow_per_hour == 0 or len(times) == most:
        return times
    scale = SECONDS_PER_HOUR / pedestrians.flow_per_hour
    waited, count = 0.0, _BLOCK
    # The first draw belongs to pedestrian 0, whether or not they were placed at the trigger.
    first = len(times)
    while True:
        # A longer sequence from the same stream begins with the same draws.
        for gap in -np.log1p(-uniforms.first("arrival", count)[first:]):
            waited += float(gap)
            if waited * scale > horizon_s or len(times) == most:
                return times
            times.append(waited * scale)
        first, count = count, 2 * count
