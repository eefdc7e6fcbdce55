"""Climbing the penalised likelihood: EM with Anderson acceleration, from k-means++ starts.

Sources: Anderson (1965); Walker and Ni (2011); Arthur and Vassilvitskii (2007).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.mixture.em import Evaluation, Parameters, Problem

Array = NDArray[np.float64]

_MEMORY = 10
_PATIENCE = 15
_SHORTENINGS = 12
_CLUSTER_ROUNDS = 10
_CLUSTER_ROWS = 20_000
_FIRST_EIGENVALUE = 1e-3


@dataclass(frozen=True)
class Climb:
    """Where one start ended: the evaluation, the objective after every step, and how."""

    best: Evaluation
    trace: Array
    converged: bool


def start(rows: Array, weights: Array, count: int, rng: np.random.Generator) -> Parameters:
    """Clusters of standardised rows (n, d) by k-means from a k-means++ seeding."""
    if rows.shape[0] > _CLUSTER_ROWS:
        chosen = rng.choice(rows.shape[0], _CLUSTER_ROWS, replace=False)
        rows, weights = rows[chosen], weights[chosen]
    centres = _seeds(rows, weights, count, rng)
    for _ in range(_CLUSTER_ROUNDS):
        member = np.zeros((rows.shape[0], count))
        member[np.arange(rows.shape[0]), _distances(rows, centres).argmin(axis=1)] = 1.0
        sizes = weights @ member
        moved = ((member * weights[:, None]).T @ rows) / np.maximum(sizes, 1e-300)[:, None]
        centres = np.where(sizes[:, None] > 0.0, moved, centres)
    scales = np.empty((count, rows.shape[1], rows.shape[1]))
    for k in range(count):
        share = weights * member[:, k]
        away = rows - centres[k]
        # A cluster of a few rows borrows from the spread of all rows.
        lent = rows.shape[1] + 1.0
        scales[k] = (away.T * share) @ away + lent * np.diag((weights @ rows**2) / weights.sum())
        scales[k] /= sizes[k] + lent
    scales += _FIRST_EIGENVALUE * np.eye(rows.shape[1])
    sizes = sizes + weights.sum() / (10.0 * count)
    return Parameters(sizes / sizes.sum(), centres, scales)


def _seeds(rows: Array, weights: Array, count: int, rng: np.random.Generator) -> Array:
    """Rows drawn one by one with chances by squared distance to those drawn before."""
    chance = weights
    centres = []
    nearest = np.full(rows.shape[0], np.inf)
    for _ in range(count):
        reached = np.cumsum(chance)
        if not reached[-1] > 0.0:
            # Fewer distinct rows than components.
            reached = np.cumsum(weights)
        drawn = np.searchsorted(reached, rng.random() * reached[-1], side="right")
        centres.append(rows[min(int(drawn), rows.shape[0] - 1)])
        nearest = np.minimum(nearest, ((rows - centres[-1]) ** 2).sum(axis=1))
        chance = weights * nearest
    return np.array(centres)


def _distances(rows: Array, centres: Array) -> Array:
    """Squared distances (n, K), less the same number in each row."""
    squares: Array = (centres**2).sum(axis=1) - 2.0 * rows @ centres.T
    return squares


def climb(problem: Problem, first: Parameters, tol: float, max_iter: int) -> Climb | None:
    """EM steps from `first` until two in a row gain less than tol per unit of weight.

    Every accepted step raises the penalised likelihood: an accelerated step that does not is
    dropped for the plain one, and in a plain one that does not, the components to blame go on
    with shorter steps. None if nothing can be computed at `first`.
    """
    at = problem.evaluate(problem.allowed(first))
    if at is None:
        return None
    history, lengths, since = _History(), np.full(at.counts.size, np.inf), 0
    trace = [at.objective]
    small = 0
    for _ in range(max_iter):
        plain = problem.step(at, lengths)
        faster = history.proposal(at.parameters, plain)
        following = None if faster is None else _accepted(problem, at, problem.allowed(faster))
        if following is None:
            history.forget()
            following = _accepted(problem, at, plain)
        if following is None:
            history, since = _History(), 0
            lengths = _shortened(problem, at, lengths)
            following = _accepted(problem, at, problem.step(at, lengths))
        if following is None:
            following = _accepted(problem, at, problem.step(at, problem.exact_lengths(at)))
        if following is None:
            return Climb(at, np.array(trace), True)
        gain = (following.objective - at.objective) / problem.total
        at, since = following, since + 1
        trace.append(at.objective)
        small = small + 1 if gain < tol else 0
        if small == 2:
            return Climb(at, np.array(trace), True)
        if since == _PATIENCE and np.isfinite(lengths).any():
            # Further on, longer steps may work again.
            history, since = _History(), 0
            lengths = np.where(lengths < 0.5, 2.0 * lengths, np.inf)
    return Climb(at, np.array(trace), False)


def _accepted(problem: Problem, at: Evaluation, wanted: Parameters) -> Evaluation | None:
    """The evaluation at the wanted parameters if it is no lower than the present one."""
    found = problem.evaluate(wanted)
    return found if found is not None and found.objective >= at.objective else None


def _shortened(problem: Problem, at: Evaluation, lengths: Array) -> Array:
    """Lengths at which no component's expected log-likelihood drops; at least EM's own."""
    exact = problem.exact_lengths(at)
    for _ in range(_SHORTENINGS):
        blamed = problem.dropped(at, problem.step(at, lengths)) & (lengths > exact)
        if not blamed.any():
            break
        shorter = np.where(np.isinf(lengths), 0.5, 0.3 * lengths)
        lengths = np.where(blamed, np.maximum(shorter, exact), lengths)
    return lengths


class _History:
    """Anderson acceleration over the last few steps, in unconstrained coordinates."""

    def __init__(self) -> None:
        self._points: list[Array] = []
        self._steps: list[Array] = []

    def forget(self) -> None:
        """Start again from the last step: the ones before it misled."""
        del self._points[:-1], self._steps[:-1]

    def proposal(self, at: Parameters, plain: Parameters) -> Parameters | None:
        """Parameters extrapolated from this and earlier steps; None at the first one."""
        point, image = _coordinates(at), _coordinates(plain)
        self._points.append(point)
        self._steps.append(image - point)
        del self._points[: -_MEMORY - 1], self._steps[: -_MEMORY - 1]
        if len(self._points) < 2:
            return None
        steps = np.diff(np.array(self._steps), axis=0).T
        points = np.diff(np.array(self._points), axis=0).T
        # Nearly repeated directions would blow up the solution into steps that lose height.
        shares = np.linalg.lstsq(steps, self._steps[-1], rcond=1e-2)[0]
        return _from_coordinates(image - (points + steps) @ shares, at.locations.shape)


def _coordinates(parameters: Parameters) -> Array:
    """Log weights, locations, Cholesky factors with the log of their diagonal, in one vector."""
    factors = np.linalg.cholesky(parameters.scales)
    steps = np.arange(factors.shape[1])
    factors[:, steps, steps] = np.log(factors[:, steps, steps])
    low = np.tril_indices(factors.shape[1])
    parts = (np.log(parameters.weights), parameters.locations.ravel(), factors[:, *low].ravel())
    return np.concatenate(parts)


def _from_coordinates(vector: Array, shape: tuple[int, ...]) -> Parameters | None:
    """The inverse of `_coordinates`, or None where it overflows."""
    count, dimension = shape
    low = np.tril_indices(dimension)
    factors = np.zeros((count, dimension, dimension))
    factors[:, *low] = vector[count * (1 + dimension) :].reshape(count, -1)
    steps = np.arange(dimension)
    logs = factors[:, steps, steps]
    if not np.isfinite(vector).all() or np.abs(logs).max() > 50.0:
        return None
    factors[:, steps, steps] = np.exp(logs)
    weights = np.exp(vector[:count] - vector[:count].max())
    locations = vector[count : count * (1 + dimension)].reshape(shape)
    scales = factors @ np.swapaxes(factors, 1, 2)
    return Parameters(weights / weights.sum(), locations, scales)
