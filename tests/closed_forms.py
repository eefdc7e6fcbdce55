"""Closed forms for an unsignalized crosswalk: delay and capacity, to compare simulations with.

Flows are per second, times in s, lengths in m.
"""

import math
from collections.abc import Sequence

from scipy import stats


def gap_wait_s(flow_per_s: float, critical_gap_s: float) -> float:
    """Mean wait for a gap of at least t in a Poisson stream: (e^{qt} − qt − 1)/q.

    It holds for pedestrians who wait for a gap in free traffic.  It also holds for a single vehicle
    that yields to all pedestrians, if each blocks it for t.  The share without delay is e^{−qt}.

    Args:
        flow_per_s: q ≥ 0, arrivals per second.
        critical_gap_s: t ≥ 0.

    Returns:
        Seconds, ≥ 0; infinite if it exceeds the largest number.

    Source: Adams (1936), Road traffic considered as a random series; Tanner (1951).

    >>> round(gap_wait_s(300 / 3600, 4.1), 2)
    0.79
    """
    blocked = flow_per_s * critical_gap_s
    if blocked < 1e-6:
        return flow_per_s * critical_gap_s**2 / 2
    if blocked > 700:
        return math.inf
    return (math.expm1(blocked) - blocked) / flow_per_s


def priority_capacity_per_s(
    pedestrians_per_s: float, block_s: float, commit_after_s: Sequence[float]
) -> float:
    """Capacity of a lane that yields to all pedestrians: λ e^{−λτ} Σ_k e^{−λ d_k}, in vehicles/s.

    Intervals without pedestrians begin at the rate λ e^{−λτ}.  The k-th queued vehicle can no
    longer stop d_k after the beginning, and passes if no pedestrian arrives before that.

    Args:
        pedestrians_per_s: λ > 0.
        block_s: τ, the time for which each pedestrian blocks the lane.
        commit_after_s: d_1 ≤ d_2 ≤ …, for as many vehicles as contribute to the sum.

    Derivation: arrivals are Poisson, so a free interval is exponential with mean 1/λ.
    """
    rate = pedestrians_per_s
    return rate * math.exp(-rate * block_s) * sum(math.exp(-rate * d) for d in commit_after_s)


def lognormal(mean: float, std: float):
    """SciPy's lognormal with these two moments."""
    of = 1 + std**2 / mean**2
    return stats.lognorm(s=math.sqrt(math.log(of)), scale=mean / math.sqrt(of))
