"""Fitting a truncated Gaussian mixture to rows inside a box."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.core.errors import InputError
from harness.model.mixture.climbing import Climb, climb, start
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.mixture.em import Problem

Array = NDArray[np.float64]

_WHERE = "fit"
# A column that the others predict to this share of its variance adds nothing but rounding.
_COLLINEAR = 1e-10


@dataclass(frozen=True)
class FitResult:
    """The result of a fit.

    Attributes:
        mixture: the truncated mixture, in the units of the data.
        converged: whether `gradient_norm` is below `tol`.
        gradient_norm: largest component of the gradient of the penalised log-likelihood at the end,
            per unit of weight, in units of each component's own information (see `Coordinates`).
        n_iter: steps taken from the start that was kept.
        log_likelihoods: (n_iter + 1,), the penalised log-likelihood after each step, in the units
            of the data; never falls.
        log_likelihood: final log-likelihood without the penalty, weighted.
        bic: −2 log_likelihood + p log n, p = K − 1 + K d + K d (d + 1)/2, n the sum of weights.
    """

    mixture: TruncatedGaussianMixture
    converged: bool
    gradient_norm: float
    n_iter: int
    log_likelihoods: Array
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
    """Maximum penalised likelihood: EM for truncated Gaussians (Lee and Scott 2012), then BFGS.

    Maximises Σ w_i log f(x_i) + λ Σ log α_k with α_k the mass of component k inside the box:
    without the prior a location can run away from the box for ever, its mass going to 0. Scale
    matrices whose smallest eigenvalue, with all columns at unit spread, is under `scale_floor`
    are not allowed: rows that repeat would make a component singular.

    The same seed gives the same numbers on one machine and one set of versions.

    Args:
        data: (n, d) finite rows inside the box, d from 1 to 4; values on a bound are inside.
        n_components: K ≥ 1.
        lower, upper: (d,), may be infinite.
        seed: of the starts; an integer or a SeedSequence.
        sample_weight: (n,) ≥ 0; 1 each when not given. Their sum counts as the number of rows.
        tol: stop where `gradient_norm` is below this.
        n_init: number of k-means++ starts; the highest penalised likelihood is kept.
        max_iter: most steps from each start.
        mass_penalty: λ ≥ 0.
        scale_floor: ≥ 0.
        names: of the columns, for messages.

    Returns:
        A `FitResult`; see there.

    Raises:
        InputError: fewer rows than components; constant or collinear columns; no start that works.
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
    # Imported here: episodes load this package too and fit nothing.
    from threadpoolctl import threadpool_limits

    # More threads would change the last digits of each step, and on matrices of this size they
    # wait for each other: on a busy machine ten times as long as one takes.
    with threadpool_limits(1, user_api="blas"):
        centre, spread = _standards(rows, weights, labels)
        rows = (rows - centre) / spread
        bounds = (low - centre) / spread, (high - centre) / spread
        problem = Problem(rows, weights, *bounds, mass_penalty, scale_floor)
        best = _highest(problem, rows, n_components, root, n_init, tol, max_iter)
    return _result(best, centre, spread, low, high, problem.total)


def _highest(
    problem: Problem,
    rows: Array,
    n_components: int,
    root: np.random.SeedSequence,
    n_init: int,
    tol: float,
    max_iter: int,
) -> Climb:
    """The climb with the highest end."""
    best: Climb | None = None
    # Children made by hand, so that a SeedSequence can be used again with the same result.
    for i in range(n_init):
        child = np.random.SeedSequence(root.entropy, spawn_key=(*root.spawn_key, i))
        first = start(rows, problem.weights, n_components, np.random.default_rng(child))
        found = climb(problem, first, tol, max_iter)
        if found is not None and (best is None or found.best.objective > best.best.objective):
            best = found
    if best is None:
        raise InputError(_WHERE, "no start has a finite likelihood", "fewer components")
    return best


def _result(
    climbed: Climb, centre: Array, spread: Array, lower: Array, upper: Array, total: float
) -> FitResult:
    """The end of a climb in the units of the data."""
    found = climbed.best.parameters
    count, dimension = found.locations.shape
    mixture = TruncatedGaussianMixture(
        found.weights,
        centre + spread * found.locations,
        found.scales * spread[:, None] * spread,
        lower,
        upper,
    )
    units = total * float(np.log(spread).sum())
    log_likelihood = climbed.best.log_likelihood - units
    parameters = count - 1 + count * dimension + count * dimension * (dimension + 1) // 2
    trace = climbed.trace - units
    trace.setflags(write=False)
    return FitResult(
        mixture=mixture,
        converged=climbed.converged,
        gradient_norm=climbed.gradient_norm,
        n_iter=trace.size - 1,
        log_likelihoods=trace,
        log_likelihood=log_likelihood,
        bic=-2.0 * log_likelihood + parameters * float(np.log(total)),
    )


def _standards(rows: Array, weights: Array, labels: list[str]) -> tuple[Array, Array]:
    """Mean and spread of each column; columns without information are refused."""
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
            "columns that are no linear combination of the others",
        )
    return centre, spread
