"""How an array of numbers describes who comes: fixed uniforms, and a Poisson crowd.

An episode of a flow is a function of a Poisson process: a random number of people, each with an
arrival time and independent uniforms (side, quantile, ...).  As normal scores z = Φ⁻¹(u), with
u = t/window for the arrival, they are N ~ Poisson(Λ) points, each standard normal in m dimensions.
Beside them stand fixed uniforms that every episode has.  A state is one row: the fixed ones first,
then ``places`` places of m numbers each; NaN marks a place where nobody is.  The order of the
places means nothing.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import ndtr, ndtri

from harness.core.encounter import FloatArray

_NEVER = 1e-15
"""More people than there are places for come less often; they are left out."""

_SPARE = 3


@dataclass(frozen=True, slots=True)
class Layout:
    """Sizes of a state.

    Attributes:
        fixed: number of uniforms that every episode has, ≥ 0.
        marks: m, uniforms of each of the crowd, the arrival first; 0 where there is no crowd.
        rate_per_s: of the crowd, > 0 where there is one.
        window_s: within which they arrive, from 0 on, > 0 where there is a crowd.
        entangled: whether somebody's coming may change what others do before they come.
    """

    fixed: int
    marks: int = 0
    rate_per_s: float = 0.0
    window_s: float = 0.0
    entangled: bool = False

    @property
    def mean_count(self) -> float:
        """Λ, the mean number of the crowd."""
        return self.rate_per_s * self.window_s

    @property
    def places(self) -> int:
        """How many of the crowd a state has room for."""
        return _most(self.mean_count) + _SPARE if self.marks else 0

    @property
    def width(self) -> int:
        """Length of a state's row."""
        return self.fixed + self.places * self.marks

    def people(self, z: FloatArray) -> FloatArray:
        """The crowd of every state, a view of shape (n, places, m)."""
        return z[:, self.fixed :].reshape(len(z), self.places, self.marks)

    def arrivals_s(self, z: FloatArray) -> FloatArray:
        """When they arrive, shape (n, places); NaN where nobody is."""
        if not self.marks:
            return np.zeros((len(z), 0))
        arrivals: FloatArray = self.window_s * ndtr(self.people(z)[:, :, 0])
        return arrivals

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Independent nominal states, shape (count, width)."""
        z = rng.standard_normal((count, self.width))
        if self.marks:
            number = np.minimum(rng.poisson(self.mean_count, count), self.places - _SPARE)
            self.people(z)[np.arange(self.places) >= number[:, None]] = np.nan
        return z

    def renewed(self, z: FloatArray, share: FloatArray, rng: np.random.Generator) -> FloatArray:
        """A share of the crowd gone, and as many others come: it leaves the nominal law as it is.

        Independent thinning leaves a Poisson process of rate (1 − share) Λ; another one of rate
        share Λ on top of it makes up for that.

        Args:
            z: states, shape (n, width).
            share: in [0, 1], shape (n, 1).
            rng: draws who goes and who comes.
        """
        if not self.marks:
            return z
        z = z.copy()
        people = self.people(z)
        people[rng.random(people.shape[:2]) < share] = np.nan
        born = rng.poisson(share * self.mean_count)
        free = np.isnan(people[:, :, 0])
        comes = free & (np.cumsum(free, axis=1) <= born)
        newcomers = rng.standard_normal(people.shape)
        people[comes] = newcomers[comes]
        return z

    def joined(self, z: FloatArray, arrival_s: FloatArray, marks: FloatArray) -> FloatArray:
        """The states with one more in each.

        Args:
            z: states, shape (n, width).
            arrival_s: in (0, window), shape (n,).
            marks: normal scores of the other uniforms, shape (n, m − 1).
        """
        z = z.copy()
        people, rows = self.people(z), np.arange(len(z))
        place = np.isnan(people[:, :, 0]).argmax(axis=1)
        people[rows, place, 0] = ndtri(arrival_s / self.window_s)
        people[rows, place, 1:] = marks
        return z

    def without(self, z: FloatArray, place: NDArray[np.intp]) -> FloatArray:
        """The states without whoever is at a place of each, ``place`` of shape (n,)."""
        z = z.copy()
        self.people(z)[np.arange(len(z)), place] = np.nan
        return z


@cache
def _most(mean_count: float) -> int:
    """How many of a Poisson number come at most, but for ``_NEVER``."""
    return int(stats.poisson.isf(_NEVER, mean_count))
