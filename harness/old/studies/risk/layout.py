"""Represents the random inputs of an episode, its state, as an array of normal scores.

The pedestrians of a flow are a Poisson process.  Their number is random, and each has an arrival
time and independent uniforms (side, quantile, ...).  Their normal scores are z = Φ⁻¹(u), with
u = t/window for the arrival.  So a crowd is N ~ Poisson(Λ) points, each standard normal in m
dimensions.  Every episode also has fixed uniforms.  A state is one row: the fixed uniforms, then
``places`` places of m numbers each.  NaN marks an empty place.  The order of places is arbitrary.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import ndtr, ndtri

from harness.core.encounter import FloatArray

_NEVER = 1e-15
"""Maximum probability that a pedestrian is left out because every place is taken."""

_SPARE = 3
"""Number of places for pedestrians whom the sampling adds to a drawn crowd."""


@dataclass(frozen=True, slots=True)
class Layout:
    """The sizes of a state.

    Attributes:
        fixed: number of uniforms that every episode has, ≥ 0.
        marks: m, the number of uniforms of a pedestrian in the crowd, including the arrival; 0
            without a crowd.
        rate_per_s: the crowd's arrival rate, > 0 if there is a crowd.
        window_s: the crowd arrives between 0 and this time in s, > 0 if there is a crowd.
    """

    fixed: int
    marks: int = 0
    rate_per_s: float = 0.0
    window_s: float = 0.0

    @property
    def mean_count(self) -> float:
        """Λ, the mean number of pedestrians in the crowd."""
        return self.rate_per_s * self.window_s

    @property
    def places(self) -> int:
        """Number of the crowd's places in a state."""
        return _most(self.mean_count) + _SPARE if self.marks else 0

    @property
    def width(self) -> int:
        """Length of a state."""
        return self.fixed + self.places * self.marks

    def people(self, z: FloatArray) -> FloatArray:
        """Return the crowd of every state as a view of shape (n, places, m)."""
        return z[:, self.fixed :].reshape(len(z), self.places, self.marks)

    def arrivals_s(self, z: FloatArray) -> FloatArray:
        """Return the crowd's arrival times in s, shape (n, places); NaN at empty places."""
        if not self.marks:
            return np.zeros((len(z), 0))
        arrivals: FloatArray = self.window_s * ndtr(self.people(z)[:, :, 0])
        return arrivals

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw independent nominal states, shape (count, width)."""
        z = rng.standard_normal((count, self.width))
        if self.marks:
            number = np.minimum(rng.poisson(self.mean_count, count), self.places - _SPARE)
            self.people(z)[np.arange(self.places) >= number[:, None]] = np.nan
        return z

    def joined(
        self, z: FloatArray, arrival_s: FloatArray, marks: FloatArray
    ) -> tuple[FloatArray, NDArray[np.intp]]:
        """Return the states with one more pedestrian each, and the place of this pedestrian.

        Args:
            z: states, shape (n, width).
            arrival_s: arrival time of the new pedestrian in (0, window), shape (n,).
            marks: normal scores of the new pedestrian's other uniforms, shape (n, m − 1).
        """
        z = z.copy()
        people, rows = self.people(z), np.arange(len(z))
        place = np.isnan(people[:, :, 0]).argmax(axis=1)
        people[rows, place, 0] = ndtri(arrival_s / self.window_s)
        people[rows, place, 1:] = marks
        return z, place

    def without(self, z: FloatArray, place: NDArray[np.intp]) -> FloatArray:
        """Return the states without the pedestrian at each state's ``place``, shape (n,)."""
        z = z.copy()
        self.people(z)[np.arange(len(z)), place] = np.nan
        return z


@cache
def _most(mean_count: float) -> int:
    """Return the number that a Poisson variable exceeds with at most probability ``_NEVER``."""
    return int(stats.poisson.isf(_NEVER, mean_count))
