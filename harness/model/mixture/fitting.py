"""Weighted rows inside a box in; the fitted truncated Gaussian mixture out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from harness.core.errors import InputError
from harness.core.freezing import frozen
from harness.core.seeding import stream
from harness.core.vocabulary import FloatArray
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.mixture.likelihood import Coordinates, Evaluation, Likelihood
from harness.model.mixture.normals import Normals, clustered_normals

_WHERE = "fit"
"""The place in messages."""
_COLLINEAR = 1e-10
"""Columns are collinear if an eigenvalue of their correlation matrix is below this."""
_EQUAL = 0.1
"""Each start gives every component this share of an equal weight."""
_LOOSE_TOL = 1e-4
"""The climbs from all starts end at this gradient; only the best one goes on."""
_CLIMBS = 4
"""A start climbs from so many clusterings, because most climbs end at a lower local maximum."""
_FIRST_STEPS = 30
"""Quasi-Newton steps before the first new reference of the coordinates."""
_FAR: Mapping[str, Any] = {"method": "BFGS", "options": {}}
"""BFGS needs the fewest evaluations far from a maximum.  Near it, L-BFGS needs as many, and has no
matrix of all parameters to update."""
_NEAR: Mapping[str, Any] = {
    "method": "L-BFGS-B",
    "options": {"maxcor": 30, "ftol": 0.0, "maxfun": np.inf},
}


class Search(NamedTuple):
    """How the maximum is searched for.

    Attributes:
        seed, key: seed of the starts, ≥ 0, and the numbers of this fit among those of the seed.
        starts: number of starts.  Each climbs from four clusterings until the gradient is below
            1e-4; of all, the one with the highest penalised likelihood goes on.
        tol: the fit stops when the result's ``gradient_norm`` is below this.
        max_iter: maximum number of steps of each climb.
    """

    seed: int
    key: tuple[int, ...] = ()
    starts: int = 5
    tol: float = 1e-7
    max_iter: int = 1000


@dataclass(frozen=True)
class FitResult:
    """The result of a fit.

    Attributes:
        mixture: the truncated mixture, in the units of the data.
        converged: whether ``gradient_norm`` is below ``tol``.
        gradient_norm: largest component of the final gradient of the penalised log-likelihood, per
            unit of weight, in ``Coordinates``.
        n_iter: number of steps of the last climb.
        log_likelihood: final weighted log-likelihood without the penalty.
        bic: −2 log_likelihood + p log n with p = K − 1 + K d + K d (d + 1)/2; n is the sum of the
            weights.
    """

    mixture: TruncatedGaussianMixture
    converged: bool
    gradient_norm: float
    n_iter: int
    log_likelihood: float
    bic: float


def fit_mixture(
    data: ArrayLike,
    n_components: int,
    lower: ArrayLike,
    upper: ArrayLike,
    search: Search,
    sample_weight: ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> FitResult:
    """The truncated Gaussian mixture of maximum penalised likelihood, by BFGS and L-BFGS.

    The fit maximises Σ w_i log f(x_i) + Σ log α_k, where α_k is the mass of component k inside
    the box.  Without this penalty a location could diverge, with a mass that tends to 0.  Scale
    matrices have no eigenvalue below ``SCALE_FLOOR``, in columns of unit spread.

    The same seed gives the same numbers on one machine with the same versions.

    Args:
        data: (n, d) finite rows inside the box, d from 1 to 4; values on a bound are inside.
        n_components: K ≥ 1.
        lower, upper: (d,), may be infinite.
        search: how the maximum is searched for.
        sample_weight: (n,) ≥ 0; by default 1.  The sum counts as the number of rows.
        names: names of the columns, for messages.

    Raises:
        InputError: there are fewer rows than components, columns are constant or collinear, or no
            start has a finite likelihood.
    """
    rows = np.array(data, dtype=np.float64)
    labels = list(names) if names is not None else [f"column {i}" for i in range(rows.shape[1])]
    low, high = np.array(lower, dtype=np.float64), np.array(upper, dtype=np.float64)
    weights = np.ones(len(rows)) if sample_weight is None else np.array(sample_weight, np.float64)
    rows, weights = rows[weights > 0.0], weights[weights > 0.0]
    if len(rows) < n_components:
        problem = f"{len(rows)} rows for {n_components} components"
        raise InputError(_WHERE, problem, "at least one row each")
    # Imported here, because episodes load this package without fitting.
    from threadpoolctl import threadpool_limits

    # Several threads would change the last digits of each step. With matrices this small they would
    # also be slower: on a busy machine by a factor of ten, because they wait for each other.
    with threadpool_limits(1, user_api="blas"):
        centre, spread = _standards(rows, weights, labels)
        rows = (rows - centre) / spread
        likelihood = Likelihood(rows, weights, (low - centre) / spread, (high - centre) / spread)
        best = _best_climb(likelihood, rows, n_components, search)
    fitted, (count, dimension) = best.end.normals, best.end.normals.locations.shape
    scales = fitted.scales * spread[:, None] * spread
    mixture = TruncatedGaussianMixture(
        fitted.weights, centre + spread * fitted.locations, scales, low, high
    )
    parameters = count - 1 + count * dimension + count * dimension * (dimension + 1) // 2
    log_likelihood = best.end.log_likelihood - likelihood.total * float(np.log(spread).sum())
    return FitResult(
        mixture=mixture,
        converged=best.gradient_norm < search.tol,
        gradient_norm=best.gradient_norm,
        n_iter=best.steps,
        log_likelihood=log_likelihood,
        bic=-2.0 * log_likelihood + parameters * float(np.log(likelihood.total)),
    )


class Climb(NamedTuple):
    """The end of a climb, the gradient there per unit of weight, and the number of steps."""

    end: Evaluation
    gradient_norm: float
    steps: int


def _best_climb(likelihood: Likelihood, rows: FloatArray, components: int, search: Search) -> Climb:
    """The highest climb from all starts, which went on to the top."""
    begun: list[Climb] = []
    # One component has the same start each time.
    for i in range(_CLIMBS * search.starts if components > 1 else 1):
        rng = stream(search.seed, "start_of_fit", *search.key, i)
        first = clustered_normals(rows, likelihood.weights, components, rng)
        mixed = (first.weights + _EQUAL / components) / (1.0 + _EQUAL)
        first = first._replace(weights=frozen(mixed))
        begun += climb(likelihood, first, max(search.tol, _LOOSE_TOL), search.max_iter)
    best = max(begun, key=lambda start: start.end.objective, default=None)
    if best is None:
        raise InputError(_WHERE, "no start has a finite likelihood", "fewer components")
    (best,) = climb(likelihood, best.end.normals, search.tol, search.max_iter, _NEAR)
    return best


def climb(
    likelihood: Likelihood, first: Normals, tol: float, max_iter: int, by: Mapping[str, Any] = _FAR
) -> list[Climb]:
    """Climb until the gradient is nearly 0; empty if the start has no finite likelihood.

    The coordinates get a new reference whenever the quasi-Newton method ends.  Near the maximum its
    line search may fail for rounding; then a step along the gradient is taken, unless the gradient
    doubles.
    """
    # Imported here, because episodes load this package without fitting.
    from scipy import optimize

    at = likelihood.at(first)
    steps, more, least = 0, _FIRST_STEPS, np.inf
    while at is not None:
        coordinates = Coordinates(likelihood, at)
        gradient, norm = coordinates.gradient()
        if norm < tol or norm > 2.0 * least or steps >= max_iter:
            return [Climb(at, norm, steps)]
        found = optimize.minimize(
            coordinates.below,
            np.zeros(coordinates.size),
            jac=True,
            method=by["method"],
            options=by["options"]
            | {"gtol": tol * likelihood.total, "maxiter": min(more, max_iter - steps)},
        )
        z, least = (found.x, np.inf) if found.nit else (gradient, norm)
        at = likelihood.at(coordinates.normals(z))
        steps, more = steps + max(found.nit, 1), max_iter
    return []


def _standards(
    rows: FloatArray, weights: FloatArray, labels: list[str]
) -> tuple[FloatArray, FloatArray]:
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
