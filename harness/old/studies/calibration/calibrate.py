"""Takes a weighted sample and returns a fit and held-out score for every K, and the chosen K."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.errors import InputError
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.mixture.fitting import FitResult, fit_mixture
from harness.old.studies.calibration.choice import by_bic, by_held_out, by_rule
from harness.old.studies.calibration.jobs import (
    Answer,
    Job,
    Settings,
    Shared,
    fitting_pool,
    jobs_of,
    run_job,
)
from harness.old.studies.calibration.sample import LABELS, Sample
from harness.old.studies.calibration.scores import (
    HeldOut,
    vehicle_folds,
)
from harness.old.studies.workers.execution import call_each

Progress = Callable[[int], None]


@dataclass(frozen=True, eq=False)
class Candidate:
    """The fit with one number of components.

    Attributes:
        components: K.
        mixture: the fit to all rows.
        log_likelihood: the weighted log-likelihood of this fit, in nats.
        bic: BIC of this fit, where n is the sum of the weights.
        converged, gradient_norm, steps: diagnostics of the best start.
        held_out: log scores of f(v_p | 1/R, v) by vehicle; None if there are no folds or a fold
            could not be fitted.  The criterion ``held-out`` compares their mean.
        held_out_driver: log scores of f(v | 1/R, v_p, 1/T_adv) by vehicle, for information.
    """

    components: int
    mixture: TruncatedGaussianMixture
    log_likelihood: float
    bic: float
    converged: bool
    gradient_norm: float
    steps: int
    held_out: HeldOut | None
    held_out_driver: HeldOut | None

    @property
    def parameters(self) -> int:
        """Number of free parameters: K − 1 weights, 4 K locations, 10 K scales."""
        return 15 * self.components - 1


@dataclass(frozen=True, eq=False)
class Calibration:
    """All fits and the chosen one.

    Attributes:
        candidates: the fits by ascending K.
        chosen: the candidate that becomes the model.
        criterion: the criterion of the choice: ``bic``, ``rule``, ``held-out`` or ``given``.
        folds: number of folds; 0 without held-out scores.
        warnings: sentences for the model's card.
    """

    candidates: tuple[Candidate, ...]
    chosen: Candidate
    criterion: str
    folds: int
    warnings: tuple[str, ...]


def calibrate(
    sample: Sample, settings: Settings, workers: int = 1, progress: Progress | None = None
) -> Calibration:
    """Fit every K to the sample and choose one.

    Args:
        sample: the weighted rows inside the box.
        settings: the settings of the fits and the choice.
        workers: number of processes; the result does not depend on it.
        progress: called with the number of finished fits; ``job_count`` is their total.

    Raises:
        InputError: there are fewer rows than components, a column is constant, columns are
            collinear, or the criterion cannot be applied.
        HarnessError: a worker process died during a fit.
    """
    _check(sample, settings)
    folds = fold_count(sample, settings)
    jobs = jobs_of(settings, folds)
    shared = Shared(sample, settings, _folds(sample, settings, folds))
    results: dict[Job, Answer] = {}
    pool = fitting_pool(min(workers, len(jobs)))
    try:
        tasks = iter([(job, shared) for job in jobs])
        for (job, _), future in call_each(pool, run_job, lambda: next(tasks, None)):
            results[job] = future.result()
            if progress:
                progress(len(results))
    finally:
        pool.stop()
    return _conclude(settings, folds, results)


def job_count(sample: Sample, settings: Settings) -> int:
    """Return the number of fits that ``calibrate`` makes."""
    return len(settings.components) * (1 + fold_count(sample, settings))


def fold_count(sample: Sample, settings: Settings) -> int:
    """Return the number of folds; 0 if vehicles are not identified or fewer than two."""
    if settings.folds < 2 or not sample.vehicles or sample.vehicles < 2:
        return 0
    return min(settings.folds, sample.vehicles)


def _check(sample: Sample, settings: Settings) -> None:
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
        if settings.choose == "held-out" and not fold_count(sample, settings):
            by_held_out({})
        if settings.choose == "rule":
            by_rule(dict.fromkeys(settings.components, 0.0))


def _folds(sample: Sample, settings: Settings, folds: int) -> np.ndarray | None:
    if sample.vehicle is None or not folds:
        return None
    return vehicle_folds(sample.vehicle, sample.weights, folds, settings.seed)


def _conclude(settings: Settings, folds: int, results: dict[Job, Answer]) -> Calibration:
    warnings: list[str] = []
    candidates = []
    for k in sorted(settings.components):
        answer = results[Job(k, None)]
        if answer.fit is None:
            raise InputError(*(answer.refusal or ("fit", f"K = {k} failed", None)))
        fold_answers = [results[Job(k, fold)] for fold in range(folds)]
        held_out = _joined([answer.walking for answer in fold_answers])
        if folds and held_out is None:
            warnings.append(f"K = {k} has no held-out score: one of its folds could not be fitted.")
        if not answer.fit.converged:
            warnings.append(
                f"The fit with K = {k} did not converge in {answer.fit.n_iter} steps; its gradient "
                f"norm is {answer.fit.gradient_norm:.1g} per unit of weight."
            )
        driving = _joined([answer.driving for answer in fold_answers])
        candidates.append(_candidate(k, answer.fit, held_out, driving))
    chosen, criterion = _choose(candidates, settings, warnings)
    return Calibration(tuple(candidates), chosen, criterion, folds, tuple(warnings))


def _candidate(
    k: int, fit: FitResult, held_out: HeldOut | None, driving: HeldOut | None
) -> Candidate:
    # Arrays that came from another process are writable; a new mixture makes them read-only.
    sent = fit.mixture
    mixture = TruncatedGaussianMixture(
        sent.weights, sent.locations, sent.scale_matrices, sent.lower, sent.upper
    )
    return Candidate(
        components=k,
        mixture=mixture,
        log_likelihood=fit.log_likelihood,
        bic=fit.bic,
        converged=fit.converged,
        gradient_norm=fit.gradient_norm,
        steps=fit.n_iter,
        held_out=held_out,
        held_out_driver=driving,
    )


def _joined(scores: Sequence[HeldOut | None]) -> HeldOut | None:
    """Return the scores of all folds together.  Every vehicle is in exactly one fold."""
    parts = [part for part in scores if part is not None]
    if not parts or len(parts) < len(scores):
        return None
    joined = HeldOut(
        np.sum([part.totals for part in parts], axis=0),
        np.sum([part.weights for part in parts], axis=0),
    )
    # A row with density 0 makes the mean infinite, so the fit cannot be compared.
    return joined if np.isfinite(joined.mean) else None


def _choose(
    candidates: list[Candidate], settings: Settings, warnings: list[str]
) -> tuple[Candidate, str]:
    by_k = {candidate.components: candidate for candidate in candidates}
    if len(by_k) == 1:
        return candidates[0], "given"
    bic = {k: candidate.bic for k, candidate in by_k.items()}
    if settings.choose == "bic":
        k = by_bic(bic)
    elif settings.choose == "rule":
        rule_k = by_rule(bic)
        if rule_k is None:
            warnings.append("No fitted K meets the paper's rule: every gain in BIC is above 10 %.")
        k = max(by_k) if rule_k is None else rule_k
    else:
        k = by_held_out({k: c.held_out for k, c in by_k.items() if c.held_out is not None})
    if k == max(by_k):
        warnings.append(f"K = {k} is the largest fitted K; a larger K may be better.")
    return by_k[k], settings.choose
