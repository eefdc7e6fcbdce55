"""The pedestrians of every pair, known before anything runs."""

import math
from collections.abc import Callable
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import Arrival, Leg, Side
from harness.core.seeding import Given, Purpose, stream
from harness.scenario import GapAcceptanceSection, PedestriansSection, Scenario

SECONDS_PER_HOUR = 3600.0

_BLOCK = 32


def planned_arrivals(
    scenario: Scenario, pair: int, given: Given | None = None, horizon_s: float | None = None
) -> tuple[Arrival, ...]:
    """Everyone who may come during an episode of this pair, by arrival time.

    A Poisson process of rate λ (paper, section III-B): arrival i is the sum of i + 1 unit
    exponentials, times 3600/λ, so λ only stretches the time axis and sweeps over it share their
    randomness.  With ``first_at_trigger`` pedestrian 0 is at the kerb at t = 0 and the others
    follow from there.  Side, quantile, critical gap and the quantile of the first detection of
    pedestrian i are the i-th draws of their own streams.  Timed pedestrians are there from the
    trigger on, in every pair alike; they have the first indices.

    Args:
        scenario: gives flow, bounds, shares and seed.
        pair: index of the pair; both arms and all cells get the same pedestrians.
        given: uniforms that are not drawn; None: those that ``pedestrians.drawn`` lists for the
            pair, if it lists any.
        horizon_s: the last time at which anybody may come; ``timeout_s`` by default.

    Returns:
        Arrivals at times in [0, horizon], at most ``max_count`` of them and the timed ones.
    """
    pedestrians, experiment = scenario.pedestrians, scenario.experiment
    if given is None and pedestrians.drawn:
        drawn = pedestrians.drawn[pair]
        pair, given = drawn.episode, drawn.uniforms
    uniforms = _Uniforms(experiment.seed, pair, given or {})
    horizon_s = experiment.timeout_s if horizon_s is None else horizon_s
    times = _arrival_times(pedestrians, uniforms, horizon_s)
    count = len(times)
    from_near = uniforms.of("side", count) < pedestrians.near_side_share
    quantiles = uniforms.of("quantile", count)
    gaps = _critical_gaps(pedestrians, uniforms, count)
    walks = scenario.timed_walks()
    first_seen = _detections(scenario, uniforms, "timed_detection", len(walks))
    timed = [
        Arrival(index, 0.0, side, None, path=path, detection_quantile=detection)
        for index, ((side, path), detection) in enumerate(zip(walks, first_seen, strict=True))
    ]
    detections = _detections(scenario, uniforms, "detection", count)
    others = [
        Arrival(index, time, Side.NEAR if near else Side.FAR, float(quantile), gap, None, detection)
        for index, (time, near, quantile, gap, detection) in enumerate(
            zip(times, from_near, quantiles, gaps, detections, strict=True), len(timed)
        )
    ]
    return (*timed, *others)


def already_walking(
    scenario: Scenario, pair: int, walking_speed: Callable[[float], float], first: int
) -> tuple[Arrival, ...]:
    """Those of ``pedestrians.warm_up_s`` before the trigger who are still on the crosswalk.

    The flow before the trigger is a Poisson process of the same rate, drawn backwards in time from
    a stream of its own, so that those who come later are the same people with and without it.
    Nobody met a vehicle: each began to walk on arrival, at the speed of their own quantile.
    Whoever has reached the other kerb by the trigger is gone.

    Args:
        scenario: gives flow, shares, crossing and seed.
        pair: index of the pair.
        walking_speed: in m/s, at a quantile, of someone who meets no vehicle.
        first: index of the first of them.
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
    """A person's critical gap at a quantile of the distribution, in s, ≥ 0.

    Lognormal, as Troutbeck's maximum likelihood method takes critical gaps to be: with mean m and
    standard deviation s, σ² = ln(1 + s²/m²) and ln gap ~ N(ln m − σ²/2, σ).  Logistic, as binary
    logit models of accepting a gap do, P = 1/(1 + exp(−(β0 + β1 gap))): m = −β0/β1 and
    s = π/(√3 β1); where it would be negative it is 0.

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
    """The uniforms of a pair's streams, the first ones given or drawn."""

    def __init__(self, seed: int, pair: int, given: Given) -> None:
        self._seed, self._pair, self._given = seed, pair, given

    def of(self, purpose: Purpose, count: int) -> NDArray[np.float64]:
        """The first ``count`` of a purpose."""
        values = stream(self._seed, purpose, self._pair).random(count)
        given = self._given.get(purpose, ())[:count]
        values[: len(given)] = given
        return values


def _critical_gaps(
    pedestrians: PedestriansSection, uniforms: _Uniforms, count: int
) -> list[float] | list[None]:
    if pedestrians.behaviour != "gap_acceptance":
        return [None] * count
    # numpy draws from [0, 1); 0 has no quantile.
    drawn = np.maximum(uniforms.of("critical_gap", count), 2.0**-54)
    return [critical_gap_s(float(uniform), pedestrians.gap_acceptance) for uniform in drawn]


def _detections(
    scenario: Scenario, uniforms: _Uniforms, purpose: Purpose, count: int
) -> list[float] | list[None]:
    """Quantiles of the time to the first detection; none where detection is certain."""
    if scenario.perception.detection_probability >= 1:
        return [None] * count
    quantiles: list[float] = uniforms.of(purpose, count).tolist()
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
        # A longer sequence of the same stream begins with the shorter one.
        for gap in -np.log1p(-uniforms.of("arrival", count)[first:]):
            waited += float(gap)
            if waited * scale > horizon_s or len(times) == most:
                return times
            times.append(waited * scale)
        first, count = count, 2 * count
