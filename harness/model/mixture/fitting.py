"""Takes weighted rows inside a box and returns the fitted truncated Gaussian mixture."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.core.errors import InputError
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.mixture.likelihood import Coordinates, Evaluation, Likelihood
from harness.model.mixture.normals import Normals, clustered_normals

Array = NDArray[np.float64]

_WHERE = "fit"
# Columns are collinear if an eigenvalue of their correlation matrix is below this.
_COLLINEAR = 1e-10
# Each start gives every component this share of an equal weight.
_EQUAL = 0.1
# The climbs from all starts end at this gradient; only the best one goes on.
_LOOSE_TOL = 1e-4
# Quasi-Newton steps before the first new reference of the coordinates.
_FIRST_STEPS = 30


@dataclass(frozen=True)
class FitResult:
    """The result of a fit.

    Attributes:
        mixture: the truncated mixture, in the units of the data.
        converged: whether `gradient_norm` is below `tol`.
        gradient_norm: largest component of the final gradient of the penalised log-likelihood, per
            unit of weight, in `Coordinates`.
        n_iter: number of steps of the last climb.
        penalised: final penalised log-likelihood, in the units of the data.
        log_likelihood: final weighted log-likelihood without the penalty.
        bic: −2 log_likelihood + p log n with p = K − 1 + K d + K d (d + 1)/2; n is the sum of the
            weights.
    """

    mixture: TruncatedGaussianMixture
    converged: bool
    gradient_norm: float
    n_iter: int
    penalised: float
    log_likelihood: float
    bic: float


def fit_mixture(
    data: ArrayLike,
    n_components: int,
    lower: ArrayLike,
    upper: ArrayLike,
    *,
    seed: int | np.random.SeedSequence,
    sample_weight: ArrayLike | None = None,
    tol: float = 1e-7,
    n_init: int = 5,
    max_iter: int = 1000,
    mass_penalty: float = 1.0,
    scale_floor: float = 1e-4,
    names: Sequence[str] | None = None,
) -> FitResult:
    """The truncated Gaussian mixture of maximum penalised likelihood, by BFGS.

    The fit maximises Σ w_i log f(x_i) + λ Σ log α_k, where α_k is the mass of component k inside
    the box. Without the penalty a location could diverge, with a mass that tends to 0. Scale
    matrices have no eigenvalue below `scale_floor`, in columns of unit spread. Otherwise repeated
    rows could make a component singular.

    The same seed gives the same numbers on one machine with the same versions.

    Args:
        data: (n, d) finite rows inside the box, d from 1 to 4; values on a bound are inside.
        n_components: K ≥ 1.
        lower, upper: (d,), may be infinite.
        seed: seed of the starts; an integer or a SeedSequence.
        sample_weight: (n,) ≥ 0; by default 1. The sum counts as the number of rows.
        tol: the fit stops when `gradient_norm` is below this.
        n_init: number of starts from clusters. All climb until their gradient is below 1e-4; the
            one with the highest penalised likelihood goes on.
        max_iter: maximum number of steps of each climb.
        mass_penalty: λ ≥ 0.
        scale_floor: smallest eigenvalue, ≥ 0.
        names: names of the columns, for messages.

    Raises:
        InputError: there are fewer rows than components, columns are constant or collinear, or no
            start has a finite likelihood.
    """
    rows = np.array(data, dtype=np.float64)
    labels = list(names) if names is not None else [f"column {i}" for i in range(rows.shape[1])]
    low, high = np.array(lower, dtype=np.float64), np.array(upper, dtype=np.float64)
    weights = np.ones(rows.shape[0])
    if sample_weight is not None:
        weights = np.array(sample_weight, dtype=np.float64)
    rows, weights = rows[weights > 0.0], weights[weights > 0.0]
    if rows.shape[0] < n_components:
        raise InputError(
            _WHERE, f"{rows.shape[0]} rows for {n_components} components", "at least one row each"
        )
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    # Imported here, because episodes load this package without fitting.
    from threadpoolctl import threadpool_limits

    # Several threads would change the last digits of each step. With matrices this small they would
    # also be slower: on a busy machine by a factor of ten, because they wait for each other.
    with threadpool_limits(1, user_api="blas"):
        centre, spread = _standards(rows, weights, labels)
        rows = (rows - centre) / spread
        bounds = (low - centre) / spread, (high - centre) / spread
        likelihood = Likelihood(rows, weights, *bounds, mass_penalty, scale_floor)
        best: Climb | None = None
        # ``SeedSequence.spawn`` would change the caller's sequence, so a second fit would differ.
        for i in range(n_init):
            child = np.random.SeedSequence(root.entropy, spawn_key=(*root.spawn_key, i))
            rng = np.random.default_rng(child)
            first = clustered_normals(rows, weights, n_components, rng)
            mixed = (first.weights + _EQUAL / n_components) / (1.0 + _EQUAL)
            first = first._replace(weights=mixed)
            begun = climb(likelihood, first, max(tol, _LOOSE_TOL), max_iter)
            if begun and (best is None or begun.end.objective > best.end.objective):
                best = begun
        if best is not None:
            best = climb(likelihood, best.end.normals, tol, max_iter)
    if best is None:
        raise InputError(_WHERE, "no start has a finite likelihood", "fewer components")
    count, dimension = best.end.normals.locations.shape
    mixture = TruncatedGaussianMixture(
        best.end.normals.weights,
        centre + spread * best.end.normals.locations,
        best.end.normals.scales * spread[:, None] * spread,
        low,
        high,
    )
    units = likelihood.total * float(np.log(spread).sum())
    parameters = count - 1 + count * dimension + count * dimension * (dimension + 1) // 2
    log_likelihood = best.end.log_likelihood - units
    return FitResult(
        mixture=mixture,
        converged=best.gradient_norm < tol,
        gradient_norm=best.gradient_norm,
        n_iter=best.steps,
        penalised=best.end.objective - units,
        log_likelihood=log_likelihood,
        bic=-2.0 * log_likelihood + parameters * float(np.log(likelihood.total)),
    )


class Climb(NamedTuple):
    """The end of a climb, the gradient there per unit of weight, and the number of steps."""

    end: Evaluation
    gradient_norm: float
    steps: int


def climb(likelihood: Likelihood, first: Normals, tol: float, max_iter: int) -> Climb | None:
    """Climb by BFGS until the gradient is nearly 0; None if the start has no finite likelihood.

    The coordinates get a new reference whenever BFGS ends. Near the maximum its line search may
    fail for rounding; then a step along the gradient is taken, unless the gradient doubles.
    """
    # Imported here, because episodes load this package without fitting.
    from scipy import optimize

    at, steps, more, least = likelihood.at(first), 0, _FIRST_STEPS, np.inf
    while at is not None:
        coordinates = Coordinates(likelihood, at)
        norm = coordinates.gradient_norm(at) / likelihood.total
        if norm < tol or norm > 2.0 * least or steps >= max_iter:
            return Climb(at, norm, steps)

        below = partial(_below, likelihood, coordinates)
        z = np.zeros(coordinates.size)
        found = optimize.minimize(
            below,
            z,
            jac=True,
            method="BFGS",
            options={"gtol": tol * likelihood.total, "maxiter": min(more, max_iter - steps)},
        )
        z, least = found.x, np.inf
        if not found.nit:
            z, least = coordinates.gradient(z, at), norm
        at = likelihood.at(coordinates.normals(z))
        steps, more = steps + max(found.nit, 1), max_iter
    return None


def _below(likelihood: Likelihood, coordinates: Coordinates, z: Array) -> tuple[float, Array]:
    """Minus the objective and its gradient at z; infinite where it cannot be computed."""
    here = likelihood.at(coordinates.normals(z))
    if here is None:
        return np.inf, np.zeros_like(z)
    return -here.objective, -coordinates.gradient(z, here)


def _standards(rows: Array, weights: Array, labels: list[str]) -> tuple[Array, Array]:
    """Mean and spread of each column; constant and collinear columns raise an error."""
    share = weights / weights.sum()
    centre = share @ rows
    spread = np.sqrt(share @ (rows - centre) ** 2)
    size = np.abs(rows).max(axis=0, initial=0.0)
    for i in np.flatnonzero(spread <= 1e-12 * size):
        raise InputError(
            f"{_WHERE}: {labels[i]}",
            f"constant: all {rows.shape[0]} rows are {rows[0, i]:g}",
            "a column that varies",
        )
    standard = (rows - centre) / spread
    correlations = (standard * share[:, None]).T @ standard
    values, vectors = np.linalg.eigh(correlations)
    if values[0] < _COLLINEAR:
        involved = [labels[i] for i in np.flatnonzero(np.abs(vectors[:, 0]) > 1e-3)]
        raise InputError(
            f"{_WHERE}: {involved[-1]}",
            f"collinear with {', '.join(involved[:-1])} in all {rows.shape[0]} rows",
            "columns that are not linear combinations of others",
        )
    return centre, spread
