"""The curve on which (v_p, 1/T_adv) lies for given R, v and L, and a coordinate along it.

With a = R/v and w = 1/T_adv, T_adv = |a − L/v_p| ties w to v_p.  Writing r = |a v_p/L − 1|, how far
v_p is from the hole at L/a relative to it,

    v_p = (L/a)(1 ± r),    w = (1/r ± 1)/a,    + beyond the hole (faster), − before it.

Neither v_p nor w serves as a coordinate: next to the hole w takes all its values while v_p stands
still, far from it the other way round.  The coordinate here is

    c = v_p/σ_v ∓ w/σ_w + constant = ±(B r − A/r),    A = 1/(a σ_w),    B = L/(a σ_v),

which grows with v_p on either side and moves at the pace of whichever of v_p and w is moving, in
units of their spreads σ.  One square root solves it for r, and the Jacobian of the reading
``curve`` loses its steep rise towards the hole:  (w²/v_p) dv_p = w/(a √(c² + 4AB)) dc.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.encounter import FloatArray

# Side of the hole on which each of the three stretches lies.
SIDES = np.array([-1.0, -1.0, 1.0])
# Chance of the sign of T_adv on each: only one is open below L v/(2R), as L > 0.
CHANCES = np.array([1.0, 0.5, 0.5])


class Place(NamedTuple):
    """v_p and w at some coordinates, and the factor w/(a √(c² + 4AB)) of the density in c."""

    speed: FloatArray
    inverse_time: FloatArray
    factor: FloatArray


class CurvePath:
    """The curves of n pedestrians inside the box, in three stretches of growing v_p.

    Slower than L v/(2R); from there to the hole; beyond the hole.

    Args:
        arrival_s: R/v > 0, (n,).
        lateral_m: L, (n,); where L ≤ 0 no stretch is open.
        speeds, inverse_times: bounds of v_p and of w; only w's lower one may be 0.
        spreads: σ_v, σ_w.

    Attributes:
        begin, end: coordinates (3, n) of the stretches' ends, begin ≤ end.
        open: (3, n), False for a stretch outside the box; its ends are equal and mean nothing.
        jump_over: what c beyond the hole is raised by, (n,), for one coordinate without a gap.
    """

    def __init__(
        self,
        arrival_s: FloatArray,
        lateral_m: FloatArray,
        speeds: tuple[float, float],
        inverse_times: tuple[float, float],
        spreads: tuple[float, float],
    ) -> None:
        self._speeds, self._inverse_times = speeds, inverse_times
        self._arrival, self._lateral = arrival_s, lateral_m
        self._a, self._b = 1.0 / (arrival_s * spreads[1]), lateral_m / (arrival_s * spreads[0])
        # In the time to walk, t = L/v_p, which falls as v_p grows.
        longest, shortest = lateral_m / speeds[0], lateral_m / speeds[1]
        nearest = 1.0 / inverse_times[1]
        furthest = 1.0 / inverse_times[0] if inverse_times[0] > 0 else np.inf
        first = np.minimum(longest, arrival_s + furthest)
        hole = np.maximum(shortest, arrival_s + nearest)
        jump = np.maximum(np.minimum(2.0 * arrival_s, first), hole)
        from_t = np.stack((first, jump, np.minimum(longest, arrival_s - nearest)))
        to_t = np.stack((jump, hole, np.maximum(shortest, arrival_s - furthest)))
        self.open = (from_t > to_t) & (lateral_m > 0)
        somewhere = arrival_s * np.array([[2.0], [2.0], [0.5]])
        self.begin = self._coordinate(arrival_s / np.where(self.open, from_t, somewhere) - 1.0)
        self.end = self._coordinate(arrival_s / np.where(self.open, to_t, somewhere) - 1.0)
        slower = self.open[0] | self.open[1]
        rim = np.where(self.open[1], self.end[1], self.end[0])
        self._rim = np.where(slower, rim, -np.inf)
        self._far_rim = np.where(self.open[2], self.begin[2], np.inf)
        self.jump_over = np.where(slower & self.open[2], rim - self.begin[2], 0.0)

    def at(self, c: FloatArray, side: FloatArray, rows: NDArray[np.intp]) -> Place:
        """The place at coordinates c (…, m), on a side of the hole (m,), of m of the n curves."""
        arrival, a, b = self._arrival.take(rows), self._a.take(rows), self._b.take(rows)
        root = np.square(c)
        root += 4.0 * a * b
        np.sqrt(root, out=root)
        speed = c * side
        inverse = root - speed
        inverse *= 0.5 / a
        inverse += side
        inverse /= arrival
        speed += root
        speed *= side * 0.5 / b
        speed += 1.0
        speed *= self._lateral.take(rows) / arrival
        root *= arrival
        return Place(speed, inverse, np.divide(inverse, root, out=root))

    def speed(self, s: FloatArray) -> FloatArray:
        """v_p at coordinates s (n,) without the gap, never outside its bounds by rounding."""
        beyond = (s > self._rim) & self.open[2]
        c = np.where(beyond, s - self.jump_over, s)
        place = self.at(c, np.where(beyond, 1.0, -1.0), np.arange(s.size))
        return np.clip(place.speed, *self._speeds)

    def coordinate(self, speed: FloatArray) -> FloatArray:
        """s at v_p (n,), without the gap: in the hole that of its rim; infinite where closed."""
        signed = speed * self._arrival / self._lateral - 1.0
        c = self._coordinate(np.where(signed == 0.0, 1.0, signed))
        beyond = np.maximum(c, self._far_rim) + self.jump_over
        result: FloatArray = np.where(signed > 0.0, beyond, np.minimum(c, self._rim))
        return result

    def jacobian(self, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """w and the factor s w²/v_p of the density in v_p, (n,); in the hole or outside the box
        the factor is 0 and w a bound."""
        apart = np.abs(self._arrival - self._lateral / np.maximum(speed, self._speeds[0]))
        w = 1.0 / np.maximum(apart, 1e-12)
        lower, upper = self._inverse_times
        inside = (w >= lower) & (w <= upper)
        inside &= (speed >= self._speeds[0]) & (speed <= self._speeds[1])
        w = np.clip(w, lower, upper)
        chance = np.where(speed * self._arrival > 0.5 * self._lateral, 0.5, 1.0)
        return w, np.where(inside, chance * w * w / np.where(inside, speed, 1.0), 0.0)

    def _coordinate(self, signed: FloatArray) -> FloatArray:
        """c where a v_p/L − 1 = ±r is given, (…, n)."""
        c: FloatArray = self._b * signed - self._a / signed
        return c
