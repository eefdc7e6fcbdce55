"""Compares the strategies of a sweep, or of several runs, pair by pair within each group.

Nothing is simulated.  ``harness.statistics`` does the arithmetic, ``strategy_groups`` finds
comparable cells, and ``same_pairs`` checks that several runs met the same pedestrians.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations, islice
from pathlib import Path

import numpy as np

from harness.core.documents import JsonObject
from harness.core.encounter import FloatArray
from harness.core.errors import InputError
from harness.core.seeding import resampling
from harness.statistics import (
    AllowedInterval,
    ComparedColumns,
    Limits,
    PairColumns,
    allowed_interval,
    holm,
    mcnemar,
    swept_value,
)
from harness.statistics.limits import JudgedLimit, Limit
from harness.store.kinds import limits_of
from harness.store.over_model import refits_of
from harness.store.summaries import repeated
from harness.studies.runs.comparisons import Comparison, GroupResult, RunComparison, SweepResult
from harness.studies.runs.opening import finished_run
from harness.studies.runs.run_data import RunData
from harness.studies.runs.same_pairs import check_same_pairs, names_of
from harness.studies.runs.strategy_groups import (
    ParameterSweep,
    StrategyGroup,
    groups_over,
    parameter_sweeps,
)
from harness.studies.runs.under_limits import judged_limits, judged_together

Progress = Callable[[int, int], None]
"""Receives the numbers of done and planned steps."""


def compare(
    *runs: RunData | str | Path,
    mu0: float | None = None,
    kappa0: float | None = None,
    progress: Progress = lambda _done, _planned: None,
) -> RunComparison:
    """Compare every two cells that differ only in the AV's strategy, in one run or in several.

    Separate runs are compared over the pairs that they have in common.  The first scenario's
    ``limits.subject_to`` applies to all cells.

    Args:
        runs: finished runs or their folders: one run with several cells, or several runs with the
            same seed, pedestrians, ego and reference.
        mu0: limit of μ; default: the first scenario's ``limits.mu0``.
        kappa0: limit of κ; default: the first scenario's ``limits.kappa0``.
        progress: called with the numbers of done and planned comparisons.

    Raises:
        InputError: a run is not finished, a limit is out of range, no two cells can be compared,
            or the reference arm did not meet the same people in all runs.
    """
    if not runs:
        raise InputError("compare", "no run given", "one run or several")
    opened = [finished_run(run) for run in runs]
    for run in opened:
        if not run.kind.compared:
            problem = f"is a run of {run.kind.name}, which has no pairs of episodes to compare"
            allowed = f"a run without {run.kind.section}; `harness compare` compares the AV's arms"
            raise InputError(str(run.path), problem, allowed)
    several = len(opened) > 1
    names = names_of(opened) if several else [""]
    groups = groups_over([run.study for run in opened], names)
    if several:
        check_same_pairs(opened, groups)
    elif all(len(group.cells) == 1 for group in groups):
        raise InputError(
            str(opened[0].path),
            "has no two cells that differ only in the AV's strategy",
            "a sweep over arms.av or over parameters of its strategy, or a second run",
        )
    confidence = max(run.confidence for run in opened)
    limits = [_limits(group, mu0, kappa0) for group in groups]
    others = [limits_of(group.cells[0].cell.scenario) for group in groups]
    steps = _Steps(sum(math.comb(len(group.cells), 2) for group in groups), progress)
    results = [
        _compare_group(opened, group, limit, more, confidence, steps)
        for group, limit, more in zip(groups, limits, others, strict=True)
    ]
    paths = tuple(run.path for run in opened)
    return RunComparison(paths, opened[0].name, confidence, _as_one_family(results))


def allowed_values(run: RunData, group: StrategyGroup, limits: Limits) -> tuple[SweepResult, ...]:
    """Return the allowed values of every parameter that a group sweeps.

    Args:
        run: a finished run.
        group: a group of its cells.
        limits: μ0 and κ0.
    """
    columns = _columns_of([run], group)
    level = 1 - run.confidence
    return tuple(_judge(sweep, group, columns, limits, level) for sweep in parameter_sweeps(group))


def _columns_of(runs: Sequence[RunData], group: StrategyGroup) -> list[PairColumns]:
    """Return the columns of every member of a group."""
    return [runs[member.run].pair_columns_of(member.cell.number) for member in group.cells]


def _limits(group: StrategyGroup, mu0: float | None, kappa0: float | None) -> Limits | None:
    defaults = group.cells[0].cell.scenario.limits
    if mu0 is not None and not 0 < mu0 < math.inf:
        raise InputError("--mu0", f"{mu0:g} is not accepted", "above 0")
    if kappa0 is not None and not 0 < kappa0 <= 1:
        raise InputError("--kappa0", f"{kappa0:g} is not accepted", "above 0, at most 1")
    mu0, kappa0 = mu0 or defaults.mu0, kappa0 or defaults.kappa0
    if mu0 is None and kappa0 is None:
        return None
    if mu0 is None or kappa0 is None:
        missing = "mu0" if mu0 is None else "kappa0"
        raise InputError(
            f"limits.{missing}", "is missing", f"both limits: --{missing}, or in the scenario"
        )
    return Limits(mu0, kappa0)


class _Steps:
    """Counts the finished comparisons."""

    def __init__(self, planned: int, progress: Progress) -> None:
        self._done, self._planned, self._progress = 0, planned, progress

    def one_more(self) -> None:
        self._done += 1
        self._progress(self._done, self._planned)


def _as_one_family(results: list[GroupResult]) -> tuple[GroupResult, ...]:
    """Adjust the p values by Holm, in one family for the crashes and one for the front."""
    items = [item for result in results for item in result.comparisons]
    crashes = holm([item.crashes.p for item in items])
    times = [item.time_ratio_difference.p for item in items]
    front = holm([*times, *(item.misses.p for item in items)])
    adjusted = iter(
        replace(item, p_holm=p, time_ratio_p_holm=time, misses_p_holm=missed)
        for item, p, time, missed in zip(
            items, crashes, front[: len(items)], front[len(items) :], strict=True
        )
    )
    return tuple(
        replace(result, comparisons=tuple(islice(adjusted, len(result.comparisons))))
        for result in results
    )


def _compare_group(
    runs: Sequence[RunData],
    group: StrategyGroup,
    limits: Limits | None,
    others: Sequence[Limit],
    confidence: float,
    steps: _Steps,
) -> GroupResult:
    seed = group.cells[0].cell.scenario.experiment.seed
    columns = _columns_of(runs, group)
    over_refits = group.cells[0].cell.scenario.model.over_refits
    refits = refits_of(runs[group.cells[0].run].manifest) if over_refits else None
    comparisons = []
    for a, b in combinations(range(len(columns)), 2):
        comparisons.append(_compare(a, b, group, columns, seed, confidence, refits))
        steps.one_more()
    level = 1 - confidence
    sweeps = [] if limits is None else parameter_sweeps(group)
    summaries = [{result.cell.number: result.summary for result in run.results} for run in runs]
    return GroupResult(
        group,
        level,
        tuple(summaries[member.run][member.cell.number] for member in group.cells),
        tuple(comparisons),
        tuple(_judge(sweep, group, columns, limits, level) for sweep in sweeps if limits),
        _under_limits(runs, group, columns, limits, others) if limits or others else (),
        limits is not None,
    )


def _under_limits(
    runs: Sequence[RunData],
    group: StrategyGroup,
    columns: list[PairColumns],
    limits: Limits | None,
    others: Sequence[Limit],
) -> tuple[tuple[JudgedLimit, ...], ...]:
    """Judge each cell of a group under μ0 and κ0, and under its other limits."""
    together: list[tuple[JudgedLimit, ...]] = [()] * len(columns)
    if limits is not None:
        level = 1 - max(run.confidence for run in runs)
        found = _judged(range(len(columns)), group, columns, limits, level)
        together = [judged_together(each, limits) for each in found.judgements]
    return tuple(
        (*first, *judged_limits(runs[member.run], member.cell, others))
        for first, member in zip(together, group.cells, strict=True)
    )


def _compare(
    a: int,
    b: int,
    group: StrategyGroup,
    columns: list[PairColumns],
    seed: int,
    confidence: float,
    refits: JsonObject | None,
) -> Comparison:
    # With --until, cells have different numbers of pairs; pair i is entry i in every cell.
    common = min(len(columns[a].tau), len(columns[b].tau))
    first, second = (columns[cell].where(slice(common)) for cell in (a, b))
    scenario = group.cells[a].cell.scenario
    timeout_s = scenario.experiment.timeout_s
    compared = ComparedColumns(
        first,
        second,
        timeout_s,
        scenario.vehicle().free_pass_time_s(scenario.crosswalk()),
        # Every comparison uses the same stream, so no result depends on the other comparisons.
        resampling(seed, "comparison"),
        confidence,
    )
    times_a, times_b = (cell.times_counted(timeout_s)[0] for cell in (first, second))
    saved, mu, delay = compared.time_ratio(), compared.mu(), compared.delay()
    over = {}
    if refits is not None:
        usual = {"time_ratio_difference": saved, "mu_difference": mu, "delay_difference_s": delay}
        used = refits["count"], refits["effective_vehicles"]
        over = {key: compared.over_model(key, of, *used) for key, of in usual.items()}
    misses = mcnemar(first.av_missed, second.av_missed, first.av_tried, second.av_tried)
    crashes = mcnemar(first.crashed[0], second.crashed[0], ~first.failed[0], ~second.failed[0])
    return Comparison(
        a=a,
        b=b,
        defined_in_both=_count(first.tau - second.tau),
        mu_difference=mu,
        mu_worst_difference=compared.mu_worst(),
        pairs_in_both=common,
        crossed_in_both=_count(first.delay_s[0] - second.delay_s[0]),
        delay_difference_s=delay,
        crashes=crashes,
        p_holm=crashes.p,
        time_ratio_difference=saved,
        time_ratio_p_holm=saved.p,
        counted_in_both=_count(times_a - times_b),
        counted_in_one=int((np.isnan(times_a) ^ np.isnan(times_b)).sum()),
        delay_worst_difference_s=compared.delay_worst(),
        misses=misses,
        misses_p_holm=misses.p,
        over_model=over,
    )


def _judge(
    sweep: ParameterSweep,
    group: StrategyGroup,
    columns: list[PairColumns],
    limits: Limits,
    level: float,
) -> SweepResult:
    return SweepResult(sweep, limits, _judged(sweep.cells, group, columns, limits, level))


def _judged(
    cells: Sequence[int],
    group: StrategyGroup,
    columns: list[PairColumns],
    limits: Limits,
    level: float,
) -> AllowedInterval:
    """Judge cells of a group with bounds that hold for all of them simultaneously."""
    seed = group.cells[0].cell.scenario.experiment.seed
    swept = [
        swept_value(
            columns[cell].tau_all,
            columns[cell].av_missed,
            columns[cell].av_tried,
            _count(columns[cell].tau_all[columns[cell].met_someone]),
            resampling(seed, "comparison"),
            len(cells),
            level,
            repeated=repeated(columns[cell], group.cells[cell].cell.scenario)[0],
        )
        for cell in cells
    ]
    return allowed_interval(swept, limits, level)


def _count(values: FloatArray) -> int:
    return int(np.count_nonzero(~np.isnan(values)))
