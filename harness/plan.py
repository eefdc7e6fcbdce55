"""What a run will do, before it does it: the pedestrians of every pair."""

import numpy as np

from harness.encounter import Arrival, Side
from harness.scenario import PedestriansSection, Scenario
from harness.seeding import stream

SECONDS_PER_HOUR = 3600.0

_BLOCK = 32


def planned_arrivals(scenario: Scenario, pair: int) -> tuple[Arrival, ...]:
    """Everyone who may come during an episode of this pair, by arrival time.

    A Poisson process of rate λ (paper, section III-B): arrival i is the sum of i + 1 unit
    exponentials, times 3600/λ, so λ only stretches the time axis and sweeps over it share their
    randomness.  With ``first_at_trigger`` pedestrian 0 is at the kerb at t = 0 and the others
    follow from there.  Side and quantile of pedestrian i are the i-th draws of their own streams.

    Args:
        scenario: gives flow, bounds, shares, seed and horizon (``timeout_s``).
        pair: index of the pair; both arms and all cells get the same pedestrians.

    Returns:
        Arrivals at times in [0, timeout_s], at most ``max_count`` of them.
    """
    pedestrians, experiment = scenario.pedestrians, scenario.experiment
    times = _arrival_times(pedestrians, experiment.seed, pair, experiment.timeout_s)
    count = len(times)
    from_near = stream(experiment.seed, "side", pair).random(count) < pedestrians.near_side_share
    quantiles = stream(experiment.seed, "quantile", pair).random(count)
    return tuple(
        Arrival(index, time, Side.NEAR if near else Side.FAR, float(quantile))
        for index, (time, near, quantile) in enumerate(
            zip(times, from_near, quantiles, strict=True)
        )
    )


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
