"""Fits the interaction model: a fit and a held-out score for every K, and the chosen K.

Each fit has a seed of its own and one thread, so results do not depend on the number of processes.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import active_children, get_context, parent_process
from threading import Thread
from typing import Literal, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from harness.core.encounter import FloatArray
from harness.core.errors import InputError
from harness.core.seeding import resampling
from harness.model.interaction import (
    INVERSE_RANGE,
    INVERSE_TIME_ADVANTAGE,
    PEDESTRIAN_SPEED,
    VEHICLE_SPEED,
)
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.mixture.fitting import FitResult, fit_mixture
from harness.model.sample import LABELS, Sample

Choice = Literal["held-out", "bic", "rule"]
Progress = Callable[[int, int], None]

RULE_SHARE = 0.10
"""The paper stops adding components when BIC changes by less than this share."""


@dataclass(frozen=True)
class Settings:
    """The settings of a fit.

    Attributes:
        components: every K to fit, ascending.
        choose: the criterion that chooses among several K.
        starts: number of k-means++ starts of each fit.  The best start is kept.
        folds: number of folds of vehicles for the held-out scores; 0 or 1 means no scores.
        seed: the seed of the starts and the folds.
        tol: a fit stops when its gradient per unit of weight is below this (see ``fit_mixture``).
    """

    components: tuple[int, ...]
    choose: Choice = "held-out"
    starts: int = 3
    folds: int = 5
    seed: int = 1
    tol: float = 1e-7


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

    def as_plain(self) -> dict[str, float | None]:
        """For the card."""
        return {"mean": self.mean, "standard_error": self.standard_error}


class Candidate(NamedTuple):
    """The fit with K components, and its log scores on vehicles that it has not seen.

    ``held_out`` has the scores of f(v_p | 1/R, v), ``driver`` those of f(v | 1/R, v_p, 1/T_adv);
    both are None if there are no folds or one of them could not be fitted.
    """

    components: int
    fit: FitResult
    held_out: HeldOut | None
    driver: HeldOut | None


class Fitted(NamedTuple):
    """All fits by ascending K, the chosen one, by which criterion, the folds, and warnings."""

    candidates: tuple[Candidate, ...]
    chosen: Candidate
    criterion: str
    folds: int
    warnings: tuple[str, ...]


class _Job(NamedTuple):
    """A fit to the rows with these weights, and the rows that it has not seen."""

    sample: Sample
    settings: Settings
    components: int
    weights: FloatArray
    key: tuple[int, ...]
    held: np.ndarray | None = None


class _Answer(NamedTuple):
    """The fit of a job, and what its held-out rows score; or an error's parts."""

    fit: FitResult | None = None
    scores: tuple[HeldOut, HeldOut] | None = None
    refusal: tuple[str, str, str | None] | None = None


def fit(
    sample: Sample,
    settings: Settings,
    workers: int = 1,
    progress: Progress = lambda _done, _planned: None,
) -> Fitted:
    """Fit every K to a sample, score each on vehicles that its fits have not seen, and choose one.

    Args:
        sample: the weighted rows.
        settings: see ``Settings``.
        workers: number of processes.
        progress: called with the numbers of finished and planned fits.

    Raises:
        InputError: the rows do not determine a fit, or the criterion cannot be applied.
    """
    folds = 0
    if settings.folds >= 2 and sample.vehicles and sample.vehicles >= 2:
        folds = min(settings.folds, sample.vehicles)
    _check(sample, settings, folds)
    fold_of_row = np.full(len(sample.data), -1)
    if folds and sample.vehicle is not None:
        fold_of_row = vehicle_folds(sample.vehicle, sample.weights, folds, settings.seed)
    # The slowest first, so that no worker ends late with a long job.
    jobs = [
        _Job(sample, settings, k, sample.weights * ~held, (k, fold + 1), held)
        for k in sorted(settings.components, reverse=True)
        for fold in range(-1, folds)
        for held in [(fold_of_row == fold) & (fold >= 0)]
    ]
    answers = {job.key: answer for job, answer in _carried_out(jobs, workers, progress)}
    warnings, candidates = [], []
    for k in sorted(settings.components):
        answer = answers[k, 0]
        if answer.fit is None:
            raise InputError(*(answer.refusal or ("fit", f"K = {k} failed", None)))
        scores = [answers[k, fold + 1].scores for fold in range(folds)]
        held_out, driver = (_joined([each and each[i] for each in scores]) for i in range(2))
        if folds and held_out is None:
            warnings.append(f"K = {k} has no held-out score: one of its folds could not be fitted.")
        if not answer.fit.converged:
            warnings.append(
                f"The fit with K = {k} did not converge in {answer.fit.n_iter} steps; its gradient "
                f"norm is {answer.fit.gradient_norm:.1g} per unit of weight."
            )
        candidates.append(Candidate(k, answer.fit, held_out, driver))
    chosen, criterion = _choose(candidates, settings, warnings)
    return Fitted(tuple(candidates), chosen, criterion, folds, tuple(warnings))


def refits(
    sample: Sample,
    components: int,
    count: int,
    settings: Settings,
    workers: int = 1,
    progress: Progress = lambda _done, _planned: None,
) -> list[TruncatedGaussianMixture]:
    """Fits of K components to resampled vehicles.

    Each draws V − 1 of the V vehicles with replacement, so that the variance between refits
    estimates the variance of the fit without bias where the fit is linear in the vehicles
    (McCarthy and Snowden 1985).  A vehicle that is drawn m times has m times the weight.  Refit r
    is the same however many there are.

    Raises:
        InputError: the rows do not identify three vehicles, or a refit is refused.
    """
    vehicle, vehicles = check_refits(sample)
    size = count, vehicles - 1
    drawn = resampling(settings.seed, "refits").integers(0, vehicles, size)
    jobs = [
        _Job(sample, settings, components, sample.weights * times[vehicle], (components, 0, r))
        for r, each in enumerate(drawn, 1)
        for times in [np.bincount(each, minlength=vehicles)]
    ]
    found = {job.key[-1]: answer for job, answer in _carried_out(jobs, workers, progress)}
    for number, answer in found.items():
        if answer.refusal is not None:
            raise InputError(f"refit {number}: {answer.refusal[0]}", *answer.refusal[1:])
    return [fitted.mixture for _, answer in sorted(found.items()) if (fitted := answer.fit)]


def check_refits(sample: Sample) -> tuple[np.ndarray, int]:
    """The vehicle of each row, and their number, if there are enough of them to be resampled.

    Raises:
        InputError: there are fewer than three, or rows do not identify them.
    """
    if sample.vehicle is None or sample.vehicles is None or sample.vehicles < 3:
        problem = "needs rows that identify at least three vehicles, which are resampled"
        raise InputError("--refits", problem, "rows with source, clip and vehicle")
    return sample.vehicle, sample.vehicles


def _carried_out(
    jobs: Sequence[_Job], workers: int, progress: Progress
) -> list[tuple[_Job, _Answer]]:
    """The jobs with their answers; if it is interrupted, its processes end."""
    progress(0, len(jobs))
    if workers == 1 or len(jobs) == 1:
        done = []
        for job in jobs:
            done.append((job, _run(job)))
            progress(len(done), len(jobs))
        return done
    pool = ProcessPoolExecutor(min(workers, len(jobs)), get_context("spawn"), _end_with_parent)
    try:
        waiting: dict[Future[_Answer], _Job] = {pool.submit(_run, job): job for job in jobs}
        done = []
        for future in as_completed(waiting):
            done.append((waiting[future], future.result()))
            progress(len(done), len(jobs))
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in active_children():
            child.kill()
        raise
    pool.shutdown()
    return done


def _end_with_parent() -> None:
    """Let this process end as soon as its parent has ended."""
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def _run(job: _Job) -> _Answer:
    """Fit in one thread, since the number of threads changes last digits.

    An ``InputError`` is returned, because pickling would lose its parts.
    """
    sample, settings, used = job.sample, job.settings, job.weights > 0
    seed = np.random.SeedSequence(settings.seed, spawn_key=job.key)
    try:
        with threadpool_limits(1):
            found = fit_mixture(
                sample.data[used],
                job.components,
                sample.lower,
                sample.upper,
                sample_weight=job.weights[used],
                tol=settings.tol,
                n_init=settings.starts,
                seed=seed,
                names=LABELS,
            )
            if (
                job.held is None
                or not job.held.any()
                or sample.vehicle is None
                or sample.vehicles is None
            ):
                return _Answer(found)
            rows, weights = sample.data[job.held], sample.weights[job.held]
            group = (weights, sample.vehicle[job.held], sample.vehicles)
            walking = _by_vehicle(walking_log_scores(found.mixture, rows), *group)
            return _Answer(
                found, (walking, _by_vehicle(driving_log_scores(found.mixture, rows), *group))
            )
    except InputError as error:
        return _Answer(refusal=(error.where, error.problem, error.allowed))


def walking_log_scores(mixture: TruncatedGaussianMixture, data: FloatArray) -> FloatArray:
    """log f(v_p | 1/R, v), the density of walking speeds, of rows (n, 4): (n,), in nats."""
    given = (INVERSE_RANGE, VEHICLE_SPEED)
    conditional = mixture.conditional(PEDESTRIAN_SPEED, given)
    return conditional.logpdf(data[:, PEDESTRIAN_SPEED], data[:, list(given)])


def driving_log_scores(mixture: TruncatedGaussianMixture, data: FloatArray) -> FloatArray:
    """log f(v | 1/R, v_p, 1/T_adv), the drivers' density, of rows (n, 4): (n,), in nats."""
    given = (INVERSE_RANGE, PEDESTRIAN_SPEED, INVERSE_TIME_ADVANTAGE)
    conditional = mixture.conditional(VEHICLE_SPEED, given)
    return conditional.logpdf(data[:, VEHICLE_SPEED], data[:, list(given)])


def _by_vehicle(
    scores: FloatArray, weights: FloatArray, vehicle: np.ndarray, count: int
) -> HeldOut:
    return HeldOut(
        np.bincount(vehicle, scores * weights, minlength=count).astype(float),
        np.bincount(vehicle, weights, minlength=count).astype(float),
    )


def vehicle_folds(vehicle: np.ndarray, weights: FloatArray, folds: int, seed: int) -> np.ndarray:
    """The fold of every row, (n,); all rows of a vehicle are in one fold.

    The folds' weights are nearly equal: vehicles are taken by descending weight, and each goes into
    the lightest fold so far.

    Args:
        vehicle: (n,) index of each row's vehicle.
        weights: (n,) weight of each row.
        folds: number of folds, at most the number of vehicles.
        seed: the seed of the order of vehicles with equal weight.
    """
    mass = np.bincount(vehicle, weights)
    order = np.random.default_rng((seed, 1)).permutation(mass.size)
    order = order[np.argsort(-mass[order], kind="stable")]
    filled, fold_of = np.zeros(folds), np.empty(mass.size, dtype=np.intp)
    for index in order:
        fold_of[index] = int(np.argmin(filled))
        filled[fold_of[index]] += mass[index]
    return np.asarray(fold_of[vehicle])


def _check(sample: Sample, settings: Settings, folds: int) -> None:
    """Raise errors that every fit would raise, before any process starts."""
    if not settings.components or min(settings.components) < 1:
        raise InputError("--components", f"{settings.components}", "1 or more")
    most, rows = max(settings.components), int((sample.weights > 0).sum())
    if rows < most:
        raise InputError("rows", f"{rows} rows for {most} components", "at least one row each")
    fit_mixture(
        sample.data,
        1,
        sample.lower,
        sample.upper,
        sample_weight=sample.weights,
        n_init=1,
        max_iter=1,
        seed=settings.seed,
        names=LABELS,
    )
    if len(settings.components) > 1:
        if settings.choose == "held-out" and not folds:
            by_held_out({})
        if settings.choose == "rule":
            by_rule(dict.fromkeys(settings.components, 0.0))


def _joined(scores: Sequence[HeldOut | None]) -> HeldOut | None:
    """The scores of all folds together; every vehicle is in exactly one fold."""
    parts = [part for part in scores if part is not None]
    if not parts or len(parts) < len(scores):
        return None
    totals, weights = (
        np.sum([getattr(each, name) for each in parts], axis=0) for name in ("totals", "weights")
    )
    joined = HeldOut(totals, weights)
    # A row with density 0 makes the mean infinite, so the fit cannot be compared.
    return joined if np.isfinite(joined.mean) else None


def _choose(
    candidates: Sequence[Candidate], settings: Settings, warnings: list[str]
) -> tuple[Candidate, str]:
    by_k = {candidate.components: candidate for candidate in candidates}
    if len(by_k) == 1:
        return candidates[0], "given"
    bic = {k: candidate.fit.bic for k, candidate in by_k.items()}
    if settings.choose == "bic":
        k = min(bic, key=lambda k: (bic[k], k))
    elif settings.choose == "rule":
        reached = by_rule(bic)
        if reached is None:
            warnings.append("No fitted K meets the paper's rule: every gain in BIC is above 10 %.")
        k = max(by_k) if reached is None else reached
    else:
        k = by_held_out({k: c.held_out for k, c in by_k.items() if c.held_out is not None})
    if k == max(by_k):
        warnings.append(f"K = {k} is the largest fitted K; a larger K may be better.")
    return by_k[k], settings.choose


def by_held_out(scores: Mapping[int, HeldOut]) -> int:
    """The K with the highest mean held-out score, or the smallest such K.

    Raises:
        InputError: ``scores`` is empty.
    """
    if not scores:
        allowed = "rows with identifiers of at least two vehicles and --folds of 2 or more"
        raise InputError("--choose held-out", "there are no held-out scores", allowed)
    return min(scores, key=lambda k: (-scores[k].mean, k))


def by_rule(bic: Mapping[int, float]) -> int | None:
    """The smallest K with BIC_K − BIC_{K+1} < 0.1 (BIC_1 − BIC_2); None if no fitted K meets it.

    The paper takes the K beyond which BIC changes by less than 10 %.  That share depends on the
    units of the data, because a change of units adds a constant to every BIC.  This rule therefore
    compares the gain of the next component with the gain of the second component.

    Raises:
        InputError: the fitted K are not 1, 2, … without gaps up to at least 3.
    """
    last = max(bic)
    if last < 3 or sorted(bic) != list(range(1, last + 1)):
        problem = "needs every K from 1 to at least 3"
        raise InputError("--choose rule", problem, "e.g. --components 1..20")
    least = RULE_SHARE * (bic[1] - bic[2])
    return next((k for k in range(1, last) if bic[k] - bic[k + 1] < least), None)


def relative_gain(bic: Mapping[int, float]) -> dict[int, float]:
    """(BIC_{K−1} − BIC_K) / (BIC_1 − BIC_2) for every K with a fitted K − 1."""
    if not {1, 2} <= set(bic) or bic[1] == bic[2]:
        return {}
    return {k: (bic[k - 1] - bic[k]) / (bic[1] - bic[2]) for k in sorted(bic) if k - 1 in bic}
