"""Takes a sample and returns one fit.

Each job has its own seed and runs in one thread, so results do not depend on the number of
processes.
"""

from dataclasses import dataclass

import numpy as np

from harness.core.errors import InputError
from harness.model.mixture.fitting import FitResult, fit_mixture
from harness.old.studies.calibration.choice import Choice
from harness.old.studies.calibration.sample import LABELS, Sample
from harness.old.studies.calibration.scores import (
    HeldOut,
    by_vehicle,
    driving_log_scores,
    walking_log_scores,
)
from harness.old.studies.workers.pool import LocalPool

_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True)
class Settings:
    """The settings of a calibration.

    Attributes:
        components: every K to fit, ascending.
        choose: the criterion that chooses among several K.
        starts: number of k-means++ starts per fit.  The fit keeps the best start.
        folds: number of folds of vehicles for the held-out scores; 0 or 1 means no scores.
        seed: the seed of the starts and the folds.
        tol: a fit stops when its gradient per unit of weight is below this (see `fit_mixture`).
    """

    components: tuple[int, ...]
    choose: Choice = "held-out"
    starts: int = 3
    folds: int = 5
    seed: int = 1
    tol: float = 1e-7


@dataclass(frozen=True)
class Job:
    """One fit to all rows (``fold`` is None) or to the rows outside a fold."""

    components: int
    fold: int | None


@dataclass(frozen=True, eq=False)
class Answer:
    """The result of a job: the fit to all rows, the scores of a fold, or an error's parts."""

    fit: FitResult | None = None
    walking: HeldOut | None = None
    driving: HeldOut | None = None
    refusal: tuple[str, str, str | None] | None = None


@dataclass(frozen=True, eq=False)
class Shared:
    """The data that all jobs share; ``row_folds`` is the fold of every row."""

    sample: Sample
    settings: Settings
    row_folds: np.ndarray | None


def fitting_pool(workers: int) -> LocalPool:
    """Start processes with one BLAS thread, because the number of threads changes last digits."""
    return LocalPool(workers, imports=__name__, environment=_ONE_THREAD)


def jobs_of(settings: Settings, folds: int) -> list[Job]:
    """Return all jobs, the slowest first, so that no worker ends late with a long job."""
    descending = sorted(settings.components, reverse=True)
    return [Job(k, fold) for k in descending for fold in (None, *range(folds))]


def run_job(task: tuple[Job, Shared]) -> Answer:
    """Run one fit in a worker.

    An ``InputError`` is returned and not raised, because pickling would lose its parts.
    """
    try:
        return _fit(*task)
    except InputError as error:
        return Answer(refusal=(error.where, error.problem, error.allowed))


def _fit(job: Job, shared: Shared) -> Answer:
    sample, settings = shared.sample, shared.settings
    held = np.zeros(sample.weights.size, dtype=bool)
    if job.fold is not None and shared.row_folds is not None:
        held = shared.row_folds == job.fold
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
