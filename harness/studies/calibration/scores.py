"""Held-out scores: how well a model fitted on some vehicles foretells walkers before others."""

from dataclasses import dataclass

import numpy as np

from harness.core.encounter import FloatArray
from harness.model.interaction import (
    INVERSE_RANGE,
    INVERSE_TIME_ADVANTAGE,
    PEDESTRIAN_SPEED,
    VEHICLE_SPEED,
)
from harness.model.mixture import TruncatedGaussianMixture


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Scores of rows that the fit had not seen, summed by vehicle.

    Attributes:
        totals: (J,) weighted sum of the log scores of vehicle j's rows.
        weights: (J,) sum of the weights of those rows.
    """

    totals: FloatArray
    weights: FloatArray

    @property
    def mean(self) -> float:
        """Weighted mean log score per encounter, in nats."""
        return float(self.totals.sum() / self.weights.sum())

    @property
    def standard_error(self) -> float | None:
        """The standard error of ``mean``, over vehicles; None below two vehicles.

        The vehicles are the independent units: with e_j = totals_j − mean · weights_j it is
        √(J/(J−1) Σ e_j²) / Σ weights_j, the usual one of a ratio of sums over clusters
        (Cochran, Sampling Techniques, section 6.4).
        """
        count = self.totals.size
        if count < 2:
            return None
        errors = self.totals - self.mean * self.weights
        return float(np.sqrt(count / (count - 1) * (errors @ errors)) / self.weights.sum())

    def less(self, other: "HeldOut") -> "HeldOut":
        """The difference to another model's scores on the same rows, vehicle by vehicle."""
        return HeldOut(self.totals - other.totals, self.weights)


def walking_log_scores(mixture: TruncatedGaussianMixture, data: FloatArray) -> FloatArray:
    """log f(v_p | 1/R, v) of rows (n, 4), (n,): the reading ``marginal``, as pedestrians use it."""
    given = (INVERSE_RANGE, VEHICLE_SPEED)
    conditional = mixture.conditional(PEDESTRIAN_SPEED, given)
    return conditional.logpdf(data[:, PEDESTRIAN_SPEED], data[:, list(given)])


def driving_log_scores(mixture: TruncatedGaussianMixture, data: FloatArray) -> FloatArray:
    """log f(v | 1/R, v_p, 1/T_adv) of rows (n, 4), (n,): as the human driver uses the model."""
    given = (INVERSE_RANGE, PEDESTRIAN_SPEED, INVERSE_TIME_ADVANTAGE)
    conditional = mixture.conditional(VEHICLE_SPEED, given)
    return conditional.logpdf(data[:, VEHICLE_SPEED], data[:, list(given)])


def by_vehicle(scores: FloatArray, weights: FloatArray, vehicle: np.ndarray, count: int) -> HeldOut:
    """Scores of rows (n,) summed by vehicle; ``count`` vehicles in all."""
    return HeldOut(
        np.bincount(vehicle, scores * weights, minlength=count).astype(float),
        np.bincount(vehicle, weights, minlength=count).astype(float),
    )


def vehicle_folds(vehicle: np.ndarray, weights: FloatArray, folds: int, seed: int) -> np.ndarray:
    """Fold of every row (n,), whole vehicles together, the folds' weights nearly equal.

    Vehicles are taken by falling weight (equal ones in an order drawn from ``seed``), each into
    the fold that is lightest so far.

    Args:
        vehicle: (n,) index of each row's vehicle.
        weights: (n,).
        folds: number of folds, at most the number of vehicles.
        seed: of the order.
    """
    mass = np.bincount(vehicle, weights)
    order = np.random.default_rng((seed, 1)).permutation(mass.size)
    order = order[np.argsort(-mass[order], kind="stable")]
    filled = np.zeros(folds)
    fold_of = np.empty(mass.size, dtype=np.intp)
    for index in order:
        fold_of[index] = int(np.argmin(filled))
        filled[fold_of[index]] += mass[index]
    return np.asarray(fold_of[vehicle])
