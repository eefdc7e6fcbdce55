"""Fits a model again to resampled vehicles of its data, and keeps every finished refit at once."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.encounter import FloatArray
from harness.core.errors import InputError
from harness.core.seeding import resampling
from harness.model.interaction import (
    InteractionModel,
    Refit,
    RefitFile,
    read_refits,
    write_refits,
)
from harness.model.mixture.fitting import fit_mixture
from harness.old.studies.calibration.jobs import fitting_pool
from harness.old.studies.calibration.sample import LABELS, Sample, effective_number
from harness.old.studies.workers.execution import call_each


@dataclass(frozen=True, eq=False)
class RefitSettings:
    """The settings of the refits; ``seed``, ``starts`` and ``tol`` are those of the model's fit."""

    count: int
    seed: int = 1
    starts: int = 3
    tol: float = 1e-7


@dataclass(frozen=True, eq=False)
class RefitJob:
    number: int
    components: int
    sample: Sample
    settings: RefitSettings


Answer = Refit | tuple[str, str, str | None]
"""A refit, or the parts of an error."""


def make_refits(
    path: Path,
    model: InteractionModel,
    sample: Sample,
    rows_sha256: str,
    settings: RefitSettings,
    workers: int = 1,
    progress: Callable[[int, int], None] = lambda _done, _planned: None,
) -> RefitFile:
    """Make the missing refits of a model, each with the model's number of components.

    Each refit draws V − 1 of the V vehicles with replacement, so that the variance between refits
    estimates the variance of the fit without bias where the fit is linear in the vehicles
    (McCarthy and Snowden 1985).  A vehicle that is drawn m times has m times the weight.

    Args:
        path: the file of the refits; it is written after every refit, and its finished refits are
            kept if they were made in the same way.
        model: the fitted model.
        sample: the rows to which it was fitted.
        rows_sha256: hash of the file of rows.
        settings: see there.
        workers: number of processes; the refits do not depend on it.
        progress: called with the numbers of finished and planned refits.

    Raises:
        InputError: see ``check_refits``, or a refit is refused.
    """
    file = _begun(path, model, sample, rows_sha256, settings)
    components = model.mixture.weights.size
    missing = [n for n in range(settings.count) if str(n) not in file.refits]
    progress(settings.count - len(missing), settings.count)
    pool = fitting_pool(min(workers, max(1, len(missing))))
    try:
        jobs = iter([RefitJob(number, components, sample, settings) for number in missing])
        for job, future in call_each(pool, run_refit, lambda: next(jobs, None)):
            answer = future.result()
            if isinstance(answer, tuple):
                raise InputError(f"refit {job.number}: {answer[0]}", *answer[1:])
            file = file.model_copy(update={"refits": {**file.refits, str(job.number): answer}})
            write_refits(path, file)
            progress(len(file.refits), settings.count)
    finally:
        pool.stop()
    write_refits(path, file)
    return file


def recipe_of(model: InteractionModel) -> tuple[str, tuple[FloatArray, FloatArray]]:
    """How the rows of a fitted model were weighed, and the lower and upper bounds of its box."""
    weigh = str(model.provenance.get("weigh", "row")).split(",")[0]
    return weigh, (model.mixture.lower, model.mixture.upper)


def check_refits(sample: Sample, model: InteractionModel | None) -> None:
    """Refuse rows that cannot be resampled, and other rows than those of a model.

    Raises:
        InputError: rows do not identify at least three vehicles, or the card of ``model`` has
            another number of rows.
    """
    if sample.vehicle is None or sample.vehicles is None or sample.vehicles < 3:
        problem = "needs rows that identify at least three vehicles, which are resampled"
        raise InputError("--refits", problem, "rows with source, clip and vehicle")
    rows = None if model is None else model.provenance.get("rows")
    if rows is not None and rows != len(sample.data):
        problem = f"{len(sample.data)} rows lie in the model's box, and its card has {rows}"
        raise InputError("--keep-model", problem, "the rows to which the model was fitted")


def drawn_weights(sample: Sample, settings: RefitSettings, number: int) -> FloatArray:
    """The weights of the rows in one refit, (n,): times the draws of each row's vehicle."""
    assert sample.vehicle is not None
    assert sample.vehicles is not None
    # Refit r is row r of the draws, so more refits keep the first ones.
    size = number + 1, sample.vehicles - 1
    draws = resampling(settings.seed, "refits").integers(0, sample.vehicles, size)[number]
    times = np.bincount(draws, minlength=sample.vehicles)
    weights: FloatArray = sample.weights * times[sample.vehicle]
    return weights


def run_refit(job: RefitJob) -> Answer:
    """Make one refit in a worker; an ``InputError`` is returned, because pickling loses its parts.

    The starts have the model's seed with a key of their own, which no fold has.
    """
    sample, settings = job.sample, job.settings
    weights = drawn_weights(sample, settings, job.number)
    drawn = weights > 0
    key = (job.components, 0, job.number + 1)
    try:
        fit = fit_mixture(
            sample.data[drawn],
            job.components,
            sample.lower,
            sample.upper,
            sample_weight=weights[drawn],
            tol=settings.tol,
            n_init=settings.starts,
            seed=np.random.SeedSequence(settings.seed, spawn_key=key),
            names=LABELS,
        )
    except InputError as error:
        return error.where, error.problem, error.allowed
    return Refit.of(fit.mixture)


def _begun(
    path: Path,
    model: InteractionModel,
    sample: Sample,
    rows_sha256: str,
    settings: RefitSettings,
) -> RefitFile:
    """The file with the refits that are already finished, or a new one."""
    check_refits(sample, model)
    assert sample.vehicle is not None
    assert sample.vehicles is not None
    new = RefitFile(
        model_sha256=model.sha256,
        rows_sha256=rows_sha256,
        seed=settings.seed,
        starts=settings.starts,
        vehicles=sample.vehicles,
        drawn_vehicles=sample.vehicles - 1,
        effective_vehicles=effective_number(
            np.bincount(sample.vehicle, sample.weights).astype(float)
        ),
        wanted=settings.count,
    )
    try:
        before = read_refits(path, model)
    except InputError:
        # A missing, damaged or outdated file is replaced, as the model's file is.
        return new
    if not before.same_recipe(new):
        return new
    kept = {n: refit for n, refit in before.refits.items() if int(n) < settings.count}
    return new.model_copy(update={"refits": kept})
