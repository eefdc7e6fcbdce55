"""Formulas of the decisions of pedestrians at the kerb; crowd.py applies them.

Pedestrians with behaviour ``threshold`` decide by the threshold-distribution model of Pekkanen et
al. 2022 (Computational Brain & Behavior 5), with one term more: the time that the pedestrian needs
to reach the vehicle's lane.  All others obey the kerb rule.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from statistics import NormalDist
from typing import NamedTuple, Protocol

from harness.core.vocabulary import ROUNDING, STANDING_MPS, Vehicle
from harness.scenario.pedestrians import ThresholdSection

REFERENCE_MPS = 50 / 3.6
"""The speed at which the weight of the distance changes nothing."""


class Approaching(Protocol):
    """A vehicle that approaches the crosswalk, in its state at the beginning of the step."""

    @property
    def x_m(self) -> float:
        """Position of the front bumper along the road."""

    @property
    def speed_mps(self) -> float:
        """Its speed."""

    @property
    def acceleration_mps2(self) -> float:
        """Its acceleration."""

    @property
    def begun(self) -> bool:
        """Whether a strategy may drive it already."""

    @property
    def passed_at_m(self) -> float:
        """``x_m`` at which its rear has left the crosswalk."""

    @property
    def passed(self) -> bool:
        """Whether its rear has left the crosswalk."""

    @property
    def vehicle(self) -> Vehicle:
        """Its constants."""


class KerbLane:
    """A lane as pedestrians see it: y of its centre and of its two edges, and its vehicles.

    Args:
        centre_m, width_m: where it is.
        length_m: length of the crosswalk, beyond which no lane is.
    """

    def __init__(self, centre_m: float, width_m: float, length_m: float) -> None:
        half_m = width_m / 2
        self.centre_m = centre_m
        self.edges_m = max(centre_m - half_m, 0.0), min(centre_m + half_m, length_m)
        self.coming: Sequence[Approaching] = ()
        """The vehicles, the first one first."""

    def ahead(self, elapsed_s: float) -> Iterator[tuple[float, float, Approaching]]:
        """x, speed and object of the vehicles not yet past, ``elapsed_s`` into the step, in order.

        It ends with the first vehicle that no strategy drives yet.
        """
        for each in self.coming:
            gain = each.acceleration_mps2
            x_m = each.x_m + each.speed_mps * elapsed_s + gain * elapsed_s**2 / 2
            if x_m < each.passed_at_m:
                yield x_m, each.speed_mps + gain * elapsed_s, each
                if not each.begun:
                    return

    def first(self, elapsed_s: float) -> tuple[float, float, Approaching] | None:
        """The first of the vehicles that are not yet past."""
        return next(self.ahead(elapsed_s), None)


def must_wait(to_edge_m: float, speed_mps: float, acceleration_mps2: float, wait_s: float) -> bool:
    """The kerb rule: whether a pedestrian waits for this vehicle.

    They wait while the vehicle is on the crosswalk.  They also wait while its front, at its present
    speed, would reach the near edge within ``wait_s``, unless it stands, or stops before the edge
    at its present deceleration.  The near edge is ``to_edge_m`` ahead of the front; the distance is
    negative once the front is past it.
    """
    if to_edge_m <= ROUNDING:
        return True
    if to_edge_m > speed_mps * wait_s + ROUNDING:
        return False
    return speed_mps**2 > -2 * acceleration_mps2 * (to_edge_m + ROUNDING)


class Threat(NamedTuple):
    """A lane's next vehicle, its τ_eff in s, and the lane's edges (y in m)."""

    time_s: float
    vehicle: Approaching
    edges_m: tuple[float, float]


def effective_time_s(
    distance_m: float, speed_mps: float, acceleration_mps2: float, weights: ThresholdSection
) -> float:
    """τ_eff of a vehicle, in s: its time to arrival as people judge it.

    τ_eff = τ + c_d (D/(50 km/h) − τ) + c_b (τ̇ + 1), with τ = D/v and τ̇ = −1 − D a/v².  It is
    infinite if the vehicle stands (below 0.1 m/s).

    Args:
        distance_m: D, from the front to the crosswalk's centre line.
        speed_mps: v, ≥ 0.
        acceleration_mps2: a; negative if the vehicle slows down.
        weights: c_d and c_b.
    """
    if speed_mps < STANDING_MPS:
        return math.inf
    time_s = distance_m / speed_mps
    nearer_s = distance_m / REFERENCE_MPS - time_s
    slowing = -distance_m * acceleration_mps2 / speed_mps**2
    return time_s + weights.distance_weight * nearer_s + weights.slowing_weight_s * slowing


def threats(lanes: Iterable[KerbLane], elapsed_s: float, weights: ThresholdSection) -> list[Threat]:
    """The next vehicle of each lane whose time to arrival is at least ``passed_s``."""
    coming = []
    for lane in lanes:
        for x_m, speed_mps, vehicle in lane.ahead(elapsed_s):
            if -x_m >= weights.passed_s * speed_mps - ROUNDING:
                time_s = effective_time_s(-x_m, speed_mps, vehicle.acceleration_mps2, weights)
                coming.append(Threat(time_s, vehicle, lane.edges_m))
                break
    return coming


def blocking(
    coming: list[Threat], threshold_s: float, kerb_m: float, speed_mps: float
) -> Approaching | None:
    """The vehicle for which a pedestrian at a kerb does not decide to go; None if they decide.

    They decide if for every lane τ_eff, less the time in which they reach the lane's nearer edge,
    exceeds their threshold.

    Args:
        coming: the next vehicle of each lane.
        threshold_s: their threshold θ.
        kerb_m: y of their kerb.
        speed_mps: the speed at which they would walk, > 0; infinite to leave out the walk.
    """
    least_s, nearest = math.inf, None
    for time_s, vehicle, edges_m in coming:
        to_lane_m = min(abs(edge_m - kerb_m) for edge_m in edges_m)
        margin_s = time_s - to_lane_m / speed_mps
        if margin_s < least_s:
            least_s, nearest = margin_s, vehicle
    return nearest if least_s <= threshold_s else None


def lognormal_s(uniform: float, log_mean: float, log_sd: float) -> float:
    """The time at a quantile in (0, 1), where ln t ~ N(``log_mean``, ``log_sd``²)."""
    return math.exp(log_mean + log_sd * NormalDist().inv_cdf(uniform))
