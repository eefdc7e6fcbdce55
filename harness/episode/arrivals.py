"""Who comes: the pedestrians of every pair, known before anything runs."""

import math
from statistics import NormalDist

import numpy as np

from harness.encounter import Arrival, Side
from harness.scenario import GapAcceptanceSection, PedestriansSection, Scenario
from harness.seeding import stream

SECONDS_PER_HOUR = 3600.0

_BLOCK = 32


def planned_arrivals(scenario: Scenario, pair: int) -> tuple[Arrival, ...]:
    """Everyone who may come during an episode of this pair, by arrival time.

    A Poisson process of rate λ (paper, section III-B): arrival i is the sum of i + 1 unit
    exponentials, times 3600/λ, so λ only stretches the time axis and sweeps over it share their
    randomness.  With ``first_at_trigger`` pedestrian 0 is at the kerb at t = 0 and the others
    follow from there.  Side, quantile and critical gap of pedestrian i are the i-th draws of their
    own streams.  Timed pedestrians are there from the trigger on, in every pair alike; they have
    the first indices.

    Args:
        scenario: gives flow, bounds, shares, seed and horizon (``timeout_s``).
        pair: index of the pair; both arms and all cells get the same pedestrians.

    Returns:
        Arrivals at times in [0, timeout_s], at most ``max_count`` of them and the timed ones.
    """
    pedestrians, experiment = scenario.pedestrians, scenario.experiment
    times = _arrival_times(pedestrians, experiment.seed, pair, experiment.timeout_s)
    count = len(times)
    from_near = stream(experiment.seed, "side", pair).random(count) < pedestrians.near_side_share
    quantiles = stream(experiment.seed, "quantile", pair).random(count)
    gaps = _critical_gaps(pedestrians, experiment.seed, pair, count)
    timed = [
        Arrival(index, 0.0, side, None, path=path)
        for index, (side, path) in enumerate(scenario.timed_walks())
    ]
    drawn = [
        Arrival(index, time, Side.NEAR if near else Side.FAR, float(quantile), gap)
        for index, (time, near, quantile, gap) in enumerate(
            zip(times, from_near, quantiles, gaps, strict=True), len(timed)
        )
    ]
    return (*timed, *drawn)


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


def _critical_gaps(
    pedestrians: PedestriansSection, seed: int, pair: int, count: int
) -> list[float] | list[None]:
    if pedestrians.behaviour != "gap_acceptance":
        return [None] * count
    # numpy draws from [0, 1); 0 has no quantile.
    drawn = np.maximum(stream(seed, "critical_gap", pair).random(count), 2.0**-54)
    return [critical_gap_s(float(uniform), pedestrians.gap_acceptance) for uniform in drawn]


def _arrival_times(
    pedestrians: PedestriansSection, seed: int, pair: int, horizon_s: float
) -> list[float]:
    most = pedestrians.max_count
    times: list[float] = []
    if pedestrians.first_at_trigger and most != 0:
        times.append(0.0)
    if pedestrians.flow_per_hour == 0 or len(times) == most:
        return times
    scale = SECONDS_PER_HOUR / pedestrians.flow_per_hour
    generator = stream(seed, "arrival", pair)
    waited = 0.0
    # The first draw belongs to pedestrian 0, whether or not he was placed at the trigger.
    skip = len(times)
    while True:
        for gap in -np.log1p(-generator.random(_BLOCK)):
            if skip:
                skip -= 1
                continue
            waited += float(gap)
            if waited * scale > horizon_s or len(times) == most:
                return times
            times.append(waited * scale)
