"""Fits the interaction model: a fit and a held-out score for every K, and the chosen K.

Each fit has a seed of its own and one thread, so results do not depend on the number of processes.
These do not hear Ctrl-C, and end with the process that started them.
"""

import os
import signal
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from threading import Thread, current_thread, main_thread
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from harness.core.errors import HarnessError, InputError, Parameter
from harness.core.freezing import frozen
from harness.core.seeding import resampling
from harness.core.vocabulary import FloatArray, IntArray, Progress, ignore
from harness.model.interaction import DRIVING_GIVEN, PEDESTRIAN_SPEED, VEHICLE_SPEED, WALKING_GIVEN
from harness.model.mixture.conditional import Conditional
from harness.model.mixture.distribution import TruncatedGaussianMixture
from harness.model.mixture.fitting import FitResult, Search, fit_mixture
from harness.model.sample import LABELS, Sample
from harness.studies.defaults import CRITERION, FOLDS, SEED, STARTS, WEIGH, Criterion

MOST_COMPONENTS = 100

RULE_SHARE = 0.10
"""The paper stops adding components when BIC changes by less than this share."""

TARGETS: Mapping[str, tuple[int, tuple[int, ...]]] = MappingProxyType({
    "held_out": (PEDESTRIAN_SPEED, WALKING_GIVEN),
    "held_out_driver": (VEHICLE_SPEED, DRIVING_GIVEN),
})  # fmt: skip
"""What fits are scored by on vehicles that they have not seen: log f(v_p | 1/R, v), by which K is
chosen, and log f(v | 1/R, v_p, 1/T_adv), which the human driver uses."""


class FitSettings(NamedTuple):
    """The settings of the fits of a model.

    Attributes:
        components: every K to fit, ascending.
        choose: the criterion that chooses among several K.
        starts: number of starts of each fit, from four clusterings each.  The best is kept.
        folds: number of folds of vehicles for the held-out scores; 0 or 1 means no scores.
        seed: the seed of the starts and the folds.
        weigh, bounds: how rows become a sample, see ``make_sample`` and ``box_of``.
    """

    components: tuple[int, ...]
    choose: Criterion = CRITERION
    starts: int = STARTS
    folds: int = FOLDS
    seed: int = SEED
    weigh: str = WEIGH
    bounds: tuple[str, ...] = ()


def components_of(text: str) -> tuple[int, ...]:
    """The numbers of components of a text such as 1..20.

    >>> components_of("2..4")
    (2, 3, 4)

    Raises:
        InputError: the text is not accepted.
    """
    first, _, last = text.partition("..")
    low, high = (int(end) if end.isdecimal() else 0 for end in (first, last or first))
    if not 1 <= low <= high <= MOST_COMPONENTS:
        allowed = f"whole numbers from 1 to {MOST_COMPONENTS}, e.g. 10 or 1..20"
        raise InputError(Parameter("components", text), "is not accepted", allowed)
    return tuple(range(low, high + 1))


class HeldOut(NamedTuple):
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


class FitOfK(NamedTuple):
    """The fit with K components, and its scores by ``TARGETS``.

    There are no scores without folds, or if a fold cannot be fitted or has a row of density 0.
    """

    components: int
    fit: FitResult
    scores: Mapping[str, HeldOut]


class Fitted(NamedTuple):
    """All fits by ascending K, the chosen one, by which criterion, the folds, and warnings."""

    candidates: Sequence[FitOfK]
    chosen: FitOfK
    criterion: str
    folds: int
    warnings: Sequence[str]


_Key = tuple[int, int]
"""K, and the number of a fold; −1 is all vehicles."""

_Job = tuple[FloatArray, tuple[int, ...]]
"""The rows' weights, and the key of the starts' seed."""

_Scored = tuple[FitResult, Mapping[str, HeldOut]]
"""A fit, and its scores on the rows of weight 0."""


def fit(
    sample: Sample,
    settings: FitSettings,
    executor: Executor | None = None,
    progress: Progress = ignore,
) -> Fitted:
    """Fit every K to a sample, score each on vehicles that its fits have not seen, and choose one.

    Args:
        sample: the weighted rows.
        settings: see ``FitSettings``.
        executor: carries out the fits; None: this process.
        progress: called with the numbers of finished and planned fits.

    Raises:
        InputError: the rows do not determine a fit, or the criterion cannot be applied.
        HarnessError: a worker died.
    """
    folds = 0 if sample.vehicles is None else min(settings.folds, sample.vehicles)
    folds = folds if folds > 1 else 0
    _check(sample, settings, folds)
    fold_of_row = np.zeros(len(sample.data), dtype=np.int64)
    if sample.vehicle is not None and folds:
        fold_of_row = vehicle_folds(sample.vehicle, sample.weights, folds, settings.seed)
    # The slowest first, so that no worker ends late with a long fit.
    jobs = {
        (k, fold): (sample.weights * (fold_of_row != fold), (k, fold + 1))
        for k in sorted(settings.components, reverse=True)
        for fold in range(-1, folds)
    }
    answers = _carried_out(sample, settings, jobs, executor, progress)
    warnings, candidates = [], []
    for k in sorted(settings.components):
        if isinstance(whole := answers[k, -1], InputError):
            raise whole
        found, _ = whole
        parts = [answers[k, fold] for fold in range(folds)]
        scores = _joined([{} if isinstance(part, InputError) else part[1] for part in parts])
        if folds and not scores:
            warnings.append(f"K = {k} has no held-out score: one of its folds could not be fitted.")
        if not found.converged:
            warnings.append(
                f"The fit with K = {k} did not converge in {found.n_iter} steps; its gradient "
                f"norm is {found.gradient_norm:.1g} per unit of weight."
            )
        candidates.append(FitOfK(k, found, frozen(scores)))
    chosen, criterion = _choose(candidates, settings, warnings)
    return Fitted(tuple(candidates), chosen, criterion, folds, tuple(warnings))


def _carried_out(
    sample: Sample,
    settings: FitSettings,
    jobs: Mapping[_Key, _Job],
    executor: Executor | None,
    progress: Progress,
) -> dict[_Key, _Scored | InputError]:
    """The fits of jobs, or why they are refused."""
    progress(0, len(jobs))
    calls = {key: partial(fit_weighted, sample, settings, *job) for key, job in jobs.items()}
    results: Iterable[tuple[_Key, Callable[[], _Scored]]] = calls.items()
    if executor is not None:
        waiting = {executor.submit(call): key for key, call in calls.items()}
        results = ((waiting[future], future.result) for future in as_completed(waiting))
    answers: dict[_Key, _Scored | InputError] = {}
    for key, result in results:
        try:
            answers[key] = result()
        except InputError as error:
            answers[key] = error
        except BrokenExecutor as error:
            raise HarnessError(f"a worker died during a fit ({error})") from None
        progress(len(answers), len(jobs))
    return answers


def fit_weighted(
    sample: Sample, settings: FitSettings, weights: FloatArray, key: tuple[int, ...]
) -> tuple[FitResult, Mapping[str, HeldOut]]:
    """Fit the rows of weight above 0, and score those of weight 0.

    Args:
        sample, settings: see ``fit``.
        weights: (n,) the rows' weights.
        key: K, and the rest of the key of the starts' seed.
    """
    used = weights > 0
    found = fit_mixture(
        sample.data[used],
        key[0],
        sample.lower,
        sample.upper,
        Search(settings.seed, key, settings.starts),
        weights[used],
        LABELS,
    )
    if used.all() or sample.vehicle is None:
        return found, {}
    vehicle, held, scores = sample.vehicle[~used], sample.weights[~used], {}
    vehicles = int(sample.vehicle.max()) + 1
    for name in TARGETS:
        logs = log_scores(found.mixture, sample.data[~used], name)
        sums = [np.bincount(vehicle, of, vehicles) for of in (logs * held, held)]
        scores[name] = HeldOut(*frozen(np.array(sums, dtype=float)))
    return found, scores


def log_scores(mixture: TruncatedGaussianMixture, data: FloatArray, target: str) -> FloatArray:
    """The log density, by a name of ``TARGETS``, of rows (n, 4): (n,), in nats."""
    variable, given = TARGETS[target]
    return Conditional(mixture, variable, given).logpdf(data[:, variable], data[:, list(given)])


def vehicle_folds(vehicle: IntArray, weights: FloatArray, folds: int, seed: int) -> IntArray:
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
    order = resampling(seed, "folds").permutation(mass.size)
    filled, fold_of = np.zeros(folds), np.empty(mass.size, dtype=np.intp)
    for index in order[np.argsort(-mass[order], kind="stable")]:
        fold_of[index] = int(np.argmin(filled))
        filled[fold_of[index]] += mass[index]
    return np.asarray(fold_of[vehicle])


def _check(sample: Sample, settings: FitSettings, folds: int) -> None:
    """Raise errors that every fit would raise, before any process starts."""
    most, rows = max(settings.components), len(sample.data)
    if rows < most:
        raise InputError("rows", f"{rows} rows for {most} components", "at least one row each")
    fit_weighted(sample, settings._replace(starts=1), sample.weights, (1, 0))
    if len(settings.components) > 1:
        if settings.choose == "held-out" and not folds:
            raise _no_scores()
        if settings.choose == "rule":
            _refuse_gaps(settings.components)


def _joined(scores: Sequence[Mapping[str, HeldOut]]) -> Mapping[str, HeldOut]:
    """The scores of all folds together; every vehicle is in exactly one fold."""
    if not scores or not all(scores):
        return {}
    sums = {name: np.sum([score[name] for score in scores], axis=0) for name in TARGETS}
    joined = {name: HeldOut(*frozen(each)) for name, each in sums.items()}
    return joined if all(np.isfinite(score.mean) for score in joined.values()) else {}


def _choose(
    candidates: Sequence[FitOfK], settings: FitSettings, warnings: list[str]
) -> tuple[FitOfK, str]:
    """The candidate that the settings choose, and by which rule; ``warnings`` may grow."""
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
        k = by_held_out({k: c.scores["held_out"] for k, c in by_k.items() if c.scores})
    if k == max(by_k):
        warnings.append(f"K = {k} is the largest fitted K; a larger K may be better.")
    return by_k[k], settings.choose


def by_held_out(scores: Mapping[int, HeldOut]) -> int:
    """The K with the highest mean held-out score, or the smallest such K.

    Raises:
        InputError: ``scores`` is empty.
    """
    if not scores:
        raise _no_scores()
    return min(scores, key=lambda k: (-scores[k].mean, k))


def _no_scores() -> InputError:
    allowed = "rows with identifiers of at least two vehicles, and 2 or more folds"
    return InputError(Parameter("choose", "held-out"), "there are no held-out scores", allowed)


def by_rule(bic: Mapping[int, float]) -> int | None:
    """The smallest K with BIC_K − BIC_{K+1} < 0.1 (BIC_1 − BIC_2); None if no fitted K meets it.

    The paper takes the K beyond which BIC changes by less than 10 %.  That share depends on the
    units of the data, because a change of units adds a constant to every BIC.  This rule therefore
    compares the gain of the next component with the gain of the second component.

    Raises:
        InputError: the fitted K are not 1, 2, … without gaps up to at least 3.
    """
    _refuse_gaps(bic)
    least = RULE_SHARE * (bic[1] - bic[2])
    return next((k for k in range(1, len(bic)) if bic[k] - bic[k + 1] < least), None)


def _refuse_gaps(components: Collection[int]) -> None:
    if len(components) < 3 or {*components} != {*range(1, len(components) + 1)}:
        problem = "needs every K from 1 to at least 3"
        raise InputError(Parameter("choose", "rule"), problem, "e.g. 1..20 components")


def relative_gain(bic: Mapping[int, float]) -> dict[int, float]:
    """(BIC_{K−1} − BIC_K) / (BIC_1 − BIC_2) for every K with a fitted K − 1.

    It is undefined unless the second component is a gain.
    """
    if not {1, 2} <= set(bic) or bic[1] <= bic[2]:
        return {}
    return {k: (bic[k - 1] - bic[k]) / (bic[1] - bic[2]) for k in sorted(bic) if k - 1 in bic}


class _Processes(ProcessPoolExecutor):
    """Processes that do not hear Ctrl-C."""

    def submit(self, fn: Any, /, *arguments: Any, **options: Any) -> "Future[Any]":
        """Submit a call; a process that starts here inherits the blocked signal.

        An interruption waits until it has started: half a start would print a traceback.
        """
        came: list[int] = []
        # Python handles signals in the main thread, and only there may their handlers be changed.
        numbers = (signal.SIGINT, signal.SIGTERM) if current_thread() is main_thread() else ()
        noting = [(of, signal.signal(of, lambda number, _: came.append(number))) for of in numbers]
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(fn, *arguments, **options)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            for number, handler in noting:
                signal.signal(number, handler)
            if came:
                signal.raise_signal(came[0])


@contextmanager
def processes(workers: int) -> Iterator[Executor | None]:
    """Yield an executor of so many processes, which end at once on an exception; None for one."""
    if workers == 1:
        yield None
        return
    resource_tracker.ensure_running()  # it would unblock the signal
    context = get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    with theirs, ours:
        pool = _Processes(workers, context, _end_with, (theirs,))
        try:
            yield pool
        except BaseException:
            ours.close()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        pool.shutdown()


def _end_with(pipe: Connection) -> None:
    """End this process when the other end of a pipe is closed, by its parent or with it."""

    def watch() -> None:
        pipe.poll(None)
        os._exit(1)

    Thread(target=watch, daemon=True).start()
