"""Takes a mixture fitted on some vehicles and returns its log scores on other vehicles' rows."""

from dataclasses import dataclass

import numpy as np

from harness.core.encounter import FloatArray
from harness.model.interaction import (
    INVERSE_RANGE,
    INVERSE_TIME_ADVANTAGE,
    PEDESTRIAN_SPEED,
    VEHICLE_SPEED,
)
from harness.model.mixture.distribution import TruncatedGaussianMixture


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Scores of rows that were not used in the fit, summed by vehicle.

    Attributes:
        totals: (J,) weighted sum of the log scores of vehicle j's rows, in nats.
        weights: (J,) sum of the weights of vehicle j's rows.
    """

    totals: FloatArray
    weights: FloatArray

    @property
    def mean(self) -> float:
        """Weighted mean log score per encounter, in nats."""
        return float(self.totals.sum() / self.weights.sum())

    @property
    def standard_error(self) -> float | None:
        """The standard error of ``mean`` in nats; None below two vehicles.

        It is √(J/(J−1) Σ e_j²) / Σ weights_j with e_j = totals_j − mean · weights_j, because the
        vehicles are the independent units (Cochran, Sampling Techniques, section 6.4).
        """
        count = self.totals.size
        if count < 2:
            return None
        errors = self.totals - self.mean * self.weights
        return float(np.sqrt(count / (count - 1) * (errors @ errors)) / self.weights.sum())

    def less(self, other: "HeldOut") -> "HeldOut":
        """Return these scores minus another model's scores on the same rows, by vehicle."""
        return HeldOut(self.totals - other.totals, self.weights)


def walking_log_scores(mixture: TruncatedGaussianMixture, data: FloatArray) -> FloatArray:
    """Return log f(v_p | 1/R, v), the density of walking speeds, of rows (n, 4): (n,), in nats."""
    given = (INVERSE_RANGE, VEHICLE_SPEED)
    conditional = mixture.conditional(PEDESTRIAN_SPEED, given)
    return conditional.logpdf(data[:, PEDESTRIAN_SPEED], data[:, list(given)])


def driving_log_scores(mixture: TruncatedGaussianMixture, data: FloatArray) -> FloatArray:
    """Return log f(v | 1/R, v_p, 1/T_adv), the drivers' density, of rows (n, 4): (n,), in nats."""
    given = (INVERSE_RANGE, PEDESTRIAN_SPEED, INVERSE_TIME_ADVANTAGE)
    conditional = mixture.conditional(VEHICLE_SPEED, given)
    return conditional.logpdf(data[:, VEHICLE_SPEED], data[:, list(given)])


def by_vehicle(scores: FloatArray, weights: FloatArray, vehicle: np.ndarray, count: int) -> HeldOut:
    """Sum the rows' weighted scores (n,) by vehicle, for ``count`` vehicles."""
    return HeldOut(
        np.bincount(vehicle, scores * weights, minlength=count).astype(float),
        np.bincount(vehicle, weights, minlength=count).astype(float),
    )


def vehicle_folds(vehicle: np.ndarray, weights: FloatArray, folds: int, seed: int) -> np.ndarray:
    """Return the fold of every row, (n,).

    All rows of a vehicle are in one fold.  The folds' weights are nearly equal: vehicles are taken
    by descending weight, and each goes into the lightest fold so far.

    Args:
        vehicle: (n,) index of each row's vehicle.
        weights: (n,) weight of each row.
        folds: number of folds, at most the number of vehicles.
        seed: the seed of the order of vehicles with equal weight.
    """
    mass = np.bincount(vehicle, weights)
    order = np.random.default_rng((seed, 1)).permutation(mass.size)
    order = order[np.argsort(-mass[order], kind="stable")]
    filled = np.zeros(folds)
    vehicle_fold = np.empty(mass.size, dtype=np.intp)
    for index in order:
        vehicle_fold[index] = int(np.argmin(filled))
        filled[vehicle_fold[index]] += mass[index]
    return np.asarray(vehicle_fold[vehicle])
