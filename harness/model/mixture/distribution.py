"""Weights, locations and scale matrices in; a truncated Gaussian mixture out."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from harness.core.errors import InputError
from harness.core.vocabulary import BoolArray, FloatArray
from harness.model.mixture.boxes import box_probability, moments

SMALLEST_MASS = 1e-6
"""Smaller masses inside the box have too few digits."""

_MOST_VARIABLES = 4
"""Probabilities of boxes are known up to this dimension."""
_MOST_DRAWS = 1_000_000
"""Number of points that are drawn at once, which limits the memory."""


class TruncatedGaussianMixture:
    """Density Σ π_k N(x; m_k, S_k) / α_k inside a box, 0 outside.

    α_k is the mass of the untruncated component k inside the box, so π_k is the weight of the
    truncated component.  Locations m_k and scale matrices S_k are those before truncation: m_k is
    not the mean of the truncated component, and may lie outside the box.  With infinite bounds this
    is an ordinary Gaussian mixture.  The object is immutable; its arrays are read-only.

    Args:
        weights: (K,), > 0, with a sum of 1 within 1e-6; they are divided by their sum.
        locations: (K, d), d from 1 to 4.
        scale_matrices: (K, d, d), symmetric positive definite.
        lower, upper: (d,), lower < upper, may be infinite.

    Attributes:
        weights, locations, scale_matrices, lower, upper: copies of the arguments.
        masses: α_k, (K,) in [``SMALLEST_MASS``, 1].

    Raises:
        InputError: an argument is invalid, or a component has hardly any mass inside the box.
    """

    def __init__(
        self,
        weights: ArrayLike,
        locations: ArrayLike,
        scale_matrices: ArrayLike,
        lower: ArrayLike,
        upper: ArrayLike,
    ) -> None:
        self.weights = _numbers("weights", weights)
        self.locations = _numbers("locations", locations)
        self.scale_matrices = _numbers("scale_matrices", scale_matrices)
        self.lower, self.upper = _numbers("lower", lower), _numbers("upper", upper)
        self._check()
        self.weights = self.weights / self.weights.sum()
        self.scale_matrices = 0.5 * (self.scale_matrices + self.scale_matrices.transpose(0, 2, 1))
        try:
            self._factors = np.linalg.cholesky(self.scale_matrices)
        except np.linalg.LinAlgError:
            worst = np.linalg.eigvalsh(self.scale_matrices).min(axis=1).argmin()
            raise _refusal("scale_matrices", f"number {worst} is not positive definite") from None
        away = self.lower - self.locations, self.upper - self.locations
        self.masses = box_probability(self.scale_matrices, *away)
        for k in np.flatnonzero(~(self.masses >= SMALLEST_MASS)):
            problem = f"component {k} has no mass inside the box"
            raise _refusal("locations", problem, f"nearer to the box: a mass of {SMALLEST_MASS:g}")
        for array in vars(self).values():
            array.setflags(write=False)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse every change of an object that is complete."""
        if "masses" in vars(self):
            raise AttributeError(f"a {type(self).__name__} is immutable")
        super().__setattr__(name, value)

    def __setstate__(self, state: dict[str, FloatArray]) -> None:
        """Make the arrays of a copy read-only, also of one in another process."""
        vars(self).update({name: each for name, each in state.items() if name != "_moments"})
        for array in vars(self).values():
            array.setflags(write=False)

    def _check(self) -> None:
        """Raise if the shapes or values do not belong together."""
        count, dimension = self.locations.shape if self.locations.ndim == 2 else (0, 0)
        if not (count and 1 <= dimension <= _MOST_VARIABLES):
            allowed = f"(K, d), K ≥ 1, d from 1 to {_MOST_VARIABLES}"
            raise _refusal("locations", f"shape {self.locations.shape}", allowed)
        shapes = {"weights": (count,), "scale_matrices": (count, dimension, dimension)}
        for name, shape in (shapes | dict.fromkeys(("lower", "upper"), (dimension,))).items():
            if (actual := getattr(self, name).shape) != shape:
                raise _refusal(name, f"shape {actual}", f"shape {shape}")
        for name in ("weights", "locations", "scale_matrices"):
            if not np.isfinite(getattr(self, name)).all():
                raise _refusal(name, "values that are not finite", "finite numbers")
        least, total = self.weights.min(), self.weights.sum()
        if least <= 0.0 or abs(total - 1.0) > 1e-6:
            problem = f"smallest {least:.6g}, sum {total:.9g}"
            raise _refusal("weights", problem, "positive numbers that sum to 1 within 1e-6")
        for k, matrix in enumerate(self.scale_matrices):
            if np.abs(matrix - matrix.T).max() > 1e-8 * np.abs(matrix).max():
                raise _refusal("scale_matrices", f"number {k} is not symmetric")
        for i in np.flatnonzero(~(self.lower < self.upper)):
            problem = f"variable {i} has bounds {self.lower[i]:g} and {self.upper[i]:g}"
            raise _refusal("lower", problem, "lower < upper")

    def logpdf(self, x: ArrayLike) -> FloatArray:
        """Log density at x (n, d), (n,); −inf outside the box."""
        points = np.asarray(x, dtype=np.float64)
        dimension = self.lower.size
        if points.ndim != 2 or points.shape[1] != dimension:
            raise _refusal("points", f"shape {points.shape}", f"(n, {dimension})")
        away = points.T - self.locations[:, :, None]
        squares = (np.linalg.solve(self._factors, away) ** 2).sum(axis=1)
        diagonals = np.diagonal(self._factors, axis1=1, axis2=2)
        constant = np.log(self.weights / self.masses) - np.log(diagonals).sum(axis=1)
        constant -= 0.5 * dimension * np.log(2.0 * np.pi)
        return np.where(self._inside(points), log_sum(constant[:, None] - 0.5 * squares), -np.inf)

    def sample(self, n: int, rng: np.random.Generator) -> FloatArray:
        """n independent draws, (n, d), all inside the box, in random order.

        Normal vectors of each component are drawn until enough are inside the box, which takes
        long for a component with a small mass.
        """
        dimension, accepted = self.lower.size, list[FloatArray]()
        for k, missing in enumerate(rng.multinomial(n, self.weights)):
            while missing > 0:
                # A tenth more than needed on average, and 16: few components need a second time.
                tries = min(int(missing / self.masses[k] * 1.1) + 16, _MOST_DRAWS)
                z = rng.standard_normal((tries, dimension))
                rows = self.locations[k] + z @ self._factors[k].T
                accepted.append(rows[self._inside(rows)][:missing])
                missing -= len(accepted[-1])
        every = np.concatenate([np.empty((0, dimension)), *accepted])
        return np.asarray(every[rng.permutation(n)])

    def _inside(self, points: FloatArray) -> BoolArray:
        return np.asarray(((points >= self.lower) & (points <= self.upper)).all(axis=1))

    def mean(self) -> FloatArray:
        """Mean of the truncated mixture, (d,)."""
        return np.asarray(self.weights @ self._moments[0])

    def covariance(self) -> FloatArray:
        """Covariance of the truncated mixture, (d, d)."""
        means, covariances = self._moments
        away = means - self.mean()
        spread = covariances + away[:, :, None] * away[:, None, :]
        return np.asarray(np.einsum("k,kij->ij", self.weights, spread))

    @cached_property
    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """Means (K, d) and covariances (K, d, d) of the truncated components."""
        return moments(self.locations, self.scale_matrices, self.lower, self.upper)[1:]


def log_sum(terms: FloatArray) -> FloatArray:
    """The logarithm of the sum over the first axis of numbers with these logarithms."""
    largest = terms.max(axis=0)
    return np.asarray(largest + np.log(np.exp(terms - largest).sum(axis=0)))


def _numbers(name: str, values: ArrayLike) -> FloatArray:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise _refusal(name, "not an array of numbers") from None


def _refusal(name: str, problem: str, allowed: str | None = None) -> InputError:
    return InputError(f"mixture: {name}", problem, allowed)
