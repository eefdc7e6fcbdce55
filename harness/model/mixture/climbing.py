"""Takes rows and a start and returns the parameters of the highest penalised likelihood.

EM converges fast at first and slowly at the end. Its moments also give the exact gradient, with
which BFGS converges fast at the end. Sources: Jamshidian and Jennrich (1997); Nocedal and Wright
(2006), chapters 3 and 6.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.model.mixture.clusters import k_means
from harness.model.mixture.coordinates import Coordinates
from harness.model.mixture.em import Evaluation, Parameters, Problem

Array = NDArray[np.float64]

_FIRST_STEPS = 15
_CLUSTER_ROUNDS = 10
_CLUSTER_ROWS = 20_000
_FIRST_EIGENVALUE = 1e-3


@dataclass(frozen=True)
class Climb:
    """The result of a climb: the last evaluation and the objective after every step.

    `gradient_norm` is `Coordinates.gradient_norm` per unit of weight.
    """

    best: Evaluation
    trace: Array
    gradient_norm: float
    converged: bool


def start(rows: Array, weights: Array, count: int, rng: np.random.Generator) -> Parameters:
    """The starting parameters, from k-means clusters of standardised rows (n, d)."""
    if rows.shape[0] > _CLUSTER_ROWS:
        chosen = rng.choice(rows.shape[0], _CLUSTER_ROWS, replace=False)
        rows, weights = rows[chosen], weights[chosen]
    centres, cluster = k_means(rows, weights, count, _CLUSTER_ROUNDS, rng)
    member = np.eye(count)[cluster]
    sizes = weights @ member
    scales = np.empty((count, rows.shape[1], rows.shape[1]))
    for k in range(count):
        share = weights * member[:, k]
        away = rows - centres[k]
        # The spread of all rows is a prior, which matters for clusters with few rows.
        prior = rows.shape[1] + 1.0
        scales[k] = (away.T * share) @ away + prior * np.diag((weights @ rows**2) / weights.sum())
        scales[k] /= sizes[k] + prior
    scales += _FIRST_EIGENVALUE * np.eye(rows.shape[1])
    sizes = sizes + weights.sum() / (10.0 * count)
    return Parameters(sizes / sizes.sum(), centres, scales)


def climb(problem: Problem, first: Parameters, tol: float, max_iter: int) -> Climb | None:
    """Take a few EM steps from `first`, then quasi-Newton steps until the gradient is nearly 0.

    Every accepted step raises the penalised likelihood. The climb has converged only if the largest
    component of the gradient per unit of weight is below tol. It also ends if neither method finds
    a step. The result is None if the likelihood at `first` cannot be computed.
    """
    at = problem.evaluate(problem.allowed(first))
    if at is None:
        return None
    path = _Path(problem, at, max_iter)
    for _ in range(_FIRST_STEPS):
        if path.full or not path.em_step():
            break
    steps = 0
    while path.gradient_norm >= tol and not path.full and steps < len(path.trace):
        steps = len(path.trace)
        _quasi_newton(path, tol)
        path.em_step()
    return Climb(path.at, np.array(path.trace), path.gradient_norm, path.gradient_norm < tol)


class _Path:
    """The state of a climb and the gain of each of its steps."""

    def __init__(self, problem: Problem, at: Evaluation, max_iter: int) -> None:
        self.problem, self.at = problem, at
        self.trace = [at.objective]
        self._most = max_iter + 1

    @property
    def full(self) -> bool:
        """Whether no steps are left."""
        return len(self.trace) >= self._most

    @property
    def gradient_norm(self) -> float:
        return Coordinates(self.problem, self.at).gradient_norm(self.at) / self.problem.total

    def go(self, at: Evaluation) -> None:
        self.at = at
        self.trace.append(at.objective)

    def em_step(self) -> bool:
        """Take a step of EM if it raises the objective."""
        if self.full:
            return False
        evaluation = self.problem.evaluate(self.problem.step(self.at))
        if evaluation is None or evaluation.objective <= self.at.objective:
            return False
        self.go(evaluation)
        return True


def _quasi_newton(path: _Path, tol: float) -> None:
    """BFGS until no component of the gradient exceeds tol per unit of weight."""
    # Imported here, because episodes load this package without fitting.
    from scipy import optimize

    coordinates = Coordinates(path.problem, path.at)
    evaluated: dict[bytes, Evaluation] = {}

    def below(z: Array) -> tuple[float, Array]:
        evaluation = path.problem.evaluate(coordinates.parameters(z))
        if evaluation is None:
            return np.inf, np.zeros_like(z)
        evaluated[z.tobytes()] = evaluation
        return -evaluation.objective, -coordinates.gradient(z, evaluation)

    def accepted(intermediate_result: optimize.OptimizeResult) -> None:
        path.go(evaluated[intermediate_result.x.tobytes()])
        evaluated.clear()
        if path.full:
            raise StopIteration

    at, gtol = np.zeros(coordinates.size), tol * path.problem.total
    optimize.minimize(below, at, jac=True, method="BFGS", callback=accepted, options={"gtol": gtol})
