"""The fits of a calibration, each a job of its own with its own seed, in processes of one thread.

So the numbers are the same however many processes there are.
"""

from dataclasses import dataclass

import numpy as np

from harness.core.errors import InputError
from harness.model.mixture import FitResult, fit_mixture
from harness.studies.calibration.choice import Choice
from harness.studies.calibration.sample import LABELS, Sample
from harness.studies.calibration.scores import (
    HeldOut,
    by_vehicle,
    driving_log_scores,
    walking_log_scores,
)
from harness.studies.workers.pool import LocalPool

_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True)
class Settings:
    """How to fit.

    Attributes:
        components: every K to fit, ascending.
        choose: how one of them is chosen; a single K is taken as given.
        starts: k-means++ starts of every fit, the best kept.
        folds: of vehicles, for the held-out scores; 0 or 1 leaves them out.
        seed: of starts and folds.
        tol: a fit stops where the gradient per unit of weight is below this (see `fit_mixture`).
    """

    components: tuple[int, ...]
    choose: Choice = "held-out"
    starts: int = 3
    folds: int = 5
    seed: int = 1
    tol: float = 1e-7


@dataclass(frozen=True)
class Job:
    """One fit: to all rows (fold None), or to those outside a fold."""

    components: int
    fold: int | None


@dataclass(frozen=True, eq=False)
class Answer:
    """A fit to all rows, the scores of a fold, or why there is none."""

    fit: FitResult | None = None
    walking: HeldOut | None = None
    driving: HeldOut | None = None
    refusal: tuple[str, str, str | None] | None = None


@dataclass(frozen=True, eq=False)
class Shared:
    """The data that all jobs have in common."""

    sample: Sample
    settings: Settings
    fold_of: np.ndarray | None


def fitting_pool(workers: int) -> LocalPool:
    """Fresh processes with one BLAS thread: another number changes the last digits of a fit."""
    return LocalPool(workers, imports=__name__, environment=_ONE_THREAD)


def jobs_of(settings: Settings, folds: int) -> list[Job]:
    """The slowest first, so that no worker is left with one at the end."""
    falling = sorted(settings.components, reverse=True)
    return [Job(k, fold) for k in falling for fold in (None, *range(folds))]


def run_job(task: tuple[Job, Shared]) -> Answer:
    """One fit in a worker; a refusal comes back as words, an exception would lose its parts."""
    try:
        return _fit(*task)
    except InputError as error:
        return Answer(refusal=(error.where, error.problem, error.allowed))


def _fit(job: Job, shared: Shared) -> Answer:
    sample, settings = shared.sample, shared.settings
    held = np.zeros(sample.weights.size, dtype=bool)
    if job.fold is not None and shared.fold_of is not None:
        held = shared.fold_of == job.fold
    fit = fit_mixture(
        sample.data[~held],
        job.components,
        sample.lower,
        sample.upper,
        sample_weight=sample.weights[~held],
        tol=settings.tol,
        n_init=settings.starts,
        seed=np.random.SeedSequence(
            settings.seed, spawn_key=(job.components, 0 if job.fold is None else job.fold + 1)
        ),
        names=LABELS,
    )
    if job.fold is None or sample.vehicle is None or sample.vehicles is None:
        return Answer(fit=fit)
    rows, weights = sample.data[held], sample.weights[held]
    group = (weights, sample.vehicle[held], sample.vehicles)
    return Answer(
        walking=by_vehicle(walking_log_scores(fit.mixture, rows), *group),
        driving=by_vehicle(driving_log_scores(fit.mixture, rows), *group),
    )
