"""Closed forms for an unsignalized crosswalk: delay and capacity, to compare simulations with.

Flows are per second, times in s, lengths in m.
"""

import math
from collections.abc import Sequence

ROW_WIDTH_M = 8 * 0.3048
"""Width that one pedestrian of a waiting group takes up (HCM: 8 ft)."""

ROW_HEADWAY_S = 2.0
"""Headway between two rows of a waiting group when they start (HCM)."""


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


def critical_headway_s(length_m: float, walking_speed_mps: float, start_up_s: float) -> float:
    """The shortest headway in which a pedestrian can cross, the critical one: t_c = L/S_p + t_s.

    Args:
        length_m: L, kerb to kerb.
        walking_speed_mps: S_p > 0 (HCM's design value: 1.067 m/s).
        start_up_s: t_s, start-up and end clearance (HCM's design value: 3 s).

    Source: HCM 2010, chapter 19 (pedestrian mode).
    """
    return length_m / walking_speed_mps + start_up_s


def group_headway_s(
    flow_per_s: float, pedestrians_per_s: float, headway_s: float, width_m: float
) -> float:
    """The headway that a waiting group needs: t_G = t_c + 2 (N_p − 1).

    N_c = [v_p e^{v_p t_c} + v e^{−v t_c}]/[(v_p + v) e^{(v_p − v) t_c}] pedestrians wait on
    average, in N_p = max(8 ft · N_c/W_c, 1) rows.

    Args:
        flow_per_s: v > 0, vehicles over all lanes.
        pedestrians_per_s: v_p ≥ 0.
        headway_s: t_c of a single pedestrian.
        width_m: W_c, the width of the crosswalk.

    Source: HCM 2010, chapter 19 (pedestrian mode).
    """
    v, walkers, t = flow_per_s, pedestrians_per_s, headway_s
    # Each term is divided by e^{(v_p − v) t} first, so it overflows only if the result does.
    exponents = (v * t, -walkers * t)
    if exponents[0] > 700:
        return math.inf
    people = (walkers * math.exp(exponents[0]) + v * math.exp(exponents[1])) / (walkers + v)
    rows = max(ROW_WIDTH_M * people / width_m, 1.0)
    return t + ROW_HEADWAY_S * (rows - 1)


def hcm_delay_s(
    flow_per_s: float, group_headway_s: float, lanes: int, yield_rate: float = 0.0
) -> float:
    """The HCM's mean delay of pedestrians if a share of drivers yields.

    It is Σ h (i − ½) P(Y_i) + (P_d − Σ P(Y_i)) d_gd over i = 1 … n, with P_b = 1 − e^{−t_G v/N},
    P_d = 1 − (1 − P_b)^N, d_g = (e^{v t_G} − v t_G − 1)/v, d_gd = d_g/P_d, h = N/v and
    n = Int(d_gd/h).  P(Y_i) is the probability that the i-th vehicles yield.

    Args:
        flow_per_s: v > 0, vehicles over all lanes of the stage.
        group_headway_s: t_G.
        lanes: N ≥ 1.
        yield_rate: M_y in [0, 1].

    Source: HCM 2010, chapter 19 (pedestrian mode).

    >>> round(hcm_delay_s(850 / 3600, 8.0, 2, 0.5), 2)
    9.83
    """
    delayed, wait_s, yielding = _delayed(flow_per_s, group_headway_s, lanes, yield_rate)
    headway_s = lanes / flow_per_s
    events = math.inf if math.isinf(wait_s) else float(math.floor(wait_s / headway_s))
    return _with_yielding(delayed, wait_s, yielding, headway_s, events)


def revised_hcm_delay_s(
    flow_per_s: float, group_headway_s: float, lanes: int, yield_rate: float = 0.0
) -> float:
    """The HCM's mean delay of pedestrians, as revised by NCHRP 17-87.

    The formula is that of ``hcm_delay_s`` with the mean of the headways that are too short,
    h = [1/v − (t_G + 1/v) e^{−v t_G}]/(1 − e^{−v t_G}), and n = Int(e^{v t_G}).

    Source: NCHRP Web-Only Document 312 (2022), Guide to Pedestrian Analysis, appendix A, where 850
    vehicles per hour, t_c = 8 s, two lanes and M_y = 0.5 give 4.74 s.

    >>> round(revised_hcm_delay_s(850 / 3600, 8.0, 2, 0.5), 2)
    4.74
    """
    delayed, wait_s, yielding = _delayed(flow_per_s, group_headway_s, lanes, yield_rate)
    blocked = flow_per_s * group_headway_s
    no_gap = -math.expm1(-blocked)
    headway_s = (1 / flow_per_s - (group_headway_s + 1 / flow_per_s) * math.exp(-blocked)) / no_gap
    events = math.floor(math.exp(blocked)) if blocked < 700 else math.inf
    return _with_yielding(delayed, wait_s, yielding, headway_s, events)


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


def plain_priority_capacity_per_s(
    pedestrians_per_s: float, block_s: float, start_up_s: float, saturation_headway_s: float
) -> float:
    """Capacity with d_k = t_0 + k h_s, k = 0, 1, 2 …: λ e^{−λ(τ + t_0)}/(1 − e^{−λ h_s}).

    Without pedestrians it is 1/h_s.  See ``priority_capacity_per_s``.

    >>> round(3600 * plain_priority_capacity_per_s(0.1, 6.0, 0.0, 2.0))
    1090
    """
    rate = pedestrians_per_s
    if rate == 0:
        return 1 / saturation_headway_s
    through = rate * math.exp(-rate * (block_s + start_up_s))
    return through / -math.expm1(-rate * saturation_headway_s)


def _delayed(
    flow_per_s: float, group_headway_s: float, lanes: int, yield_rate: float
) -> tuple[float, float, float]:
    """P_d, d_gd, and the probability that all blocking vehicles yield, given that one blocks."""
    blocked = -math.expm1(-group_headway_s * flow_per_s / lanes)
    delayed = 1 - (1 - blocked) ** lanes
    wait_s = gap_wait_s(flow_per_s, group_headway_s) / delayed
    free = (1 - blocked) ** lanes
    yielding = ((1 - blocked + blocked * yield_rate) ** lanes - free) / delayed
    return delayed, wait_s, yielding


def _with_yielding(
    delayed: float, wait_s: float, yielding: float, headway_s: float, events: float
) -> float:
    """Σ_{i≤n} h (i − ½) P_d s (1 − s)^{i−1} + P_d (1 − s)^n d_gd with s = ``yielding``."""
    if yielding == 0:
        return delayed * wait_s
    if yielding == 1:
        return delayed * headway_s / 2 if events >= 1 else delayed * wait_s
    log_left = events * math.log1p(-yielding)
    left = math.exp(log_left)
    # Σ i s (1 − s)^{i−1} over i ≤ n is (1 − (1 − s)^n)/s − n (1 − s)^n.
    later = events * left if left > 0 else 0.0
    waited = headway_s * ((1 - left) * (1 / yielding - 0.5) - later)
    return delayed * (waited + (left * wait_s if left > 0 else 0.0))
