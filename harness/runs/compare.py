"""Compares the strategies of a sweep from its run folder: pair by pair, within each group.

Nothing is simulated.  The arithmetic is in ``harness.comparison``; what is comparable with what,
in ``harness.runs.strategy_groups``.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from harness.comparison import (
    Limits,
    PairColumns,
    allowed_interval,
    holm,
    mcnemar,
    paired_difference,
    swept_value,
)
from harness.encounter import FloatArray
from harness.errors import InputError
from harness.runs.comparisons import Comparison, GroupResult, RunComparison, SweepResult
from harness.runs.run_data import RunData, finished_run
from harness.runs.strategy_groups import (
    ParameterSweep,
    StrategyGroup,
    parameter_sweeps,
    strategy_groups,
)
from harness.seeding import resampling

Progress = Callable[[int, int], None]
"""(steps done, steps planned)."""


def compare(
    run: RunData | str | Path,
    mu0: float | None = None,
    kappa0: float | None = None,
    progress: Progress = lambda _done, _planned: None,
) -> RunComparison:
    """Compare every two cells of a run that differ in the AV's strategy alone.

    Args:
        run: a finished run of several cells, or its folder.
        mu0: limit of μ for the allowed interval; default: the scenario's ``limits.mu0``.
        kappa0: limit of κ; default: the scenario's ``limits.kappa0``.
        progress: told (comparisons done, comparisons planned).

    Raises:
        InputError: the run is not finished, a limit is out of range, or no two cells of it can be
            compared.
    """
    data = run if isinstance(run, RunData) else finished_run(run)
    groups = strategy_groups(data.study)
    if all(len(group.cells) == 1 for group in groups):
        raise InputError(
            str(data.path),
            "has no two cells that differ in the AV's strategy alone",
            "a sweep over arms.av or over parameters of its strategy",
        )
    limits = [_limits(group, mu0, kappa0) for group in groups]
    steps = _Steps(sum(math.comb(len(group.cells), 2) for group in groups), progress)
    results = [
        _compare_group(data, group, limit, steps)
        for group, limit in zip(groups, limits, strict=True)
    ]
    return RunComparison(data.path, data.name, data.confidence, _as_one_family(results))


def allowed_values(run: RunData, group: StrategyGroup, limits: Limits) -> tuple[SweepResult, ...]:
    """Which values of every parameter swept in a group are allowed, without comparing its cells.

    Args:
        run: a finished run.
        group: some of its cells.
        limits: μ0 and κ0.
    """
    columns = [run.pair_columns_of(member.cell.number) for member in group.cells]
    seed = group.cells[0].cell.scenario.experiment.seed
    level = 1 - run.confidence
    return tuple(_judge(sweep, columns, limits, seed, level) for sweep in parameter_sweeps(group))


def _limits(group: StrategyGroup, mu0: float | None, kappa0: float | None) -> Limits | None:
    given = group.cells[0].cell.scenario.limits
    if mu0 is not None and not 0 < mu0 < math.inf:
        raise InputError("--mu0", f"{mu0:g} is not accepted", "above 0")
    if kappa0 is not None and not 0 < kappa0 <= 1:
        raise InputError("--kappa0", f"{kappa0:g} is not accepted", "above 0, at most 1")
    mu0, kappa0 = mu0 or given.mu0, kappa0 or given.kappa0
    if mu0 is None and kappa0 is None:
        return None
    if mu0 is None or kappa0 is None:
        missing = "mu0" if mu0 is None else "kappa0"
        raise InputError(
            f"limits.{missing}", "is missing", f"both limits: --{missing}, or in the scenario"
        )
    return Limits(mu0, kappa0)


class _Steps:
    """Counts what is done."""

    def __init__(self, planned: int, progress: Progress) -> None:
        self._done, self._planned, self._progress = 0, planned, progress

    def one_more(self) -> None:
        self._done += 1
        self._progress(self._done, self._planned)


def _as_one_family(results: list[GroupResult]) -> tuple[GroupResult, ...]:
    """With every McNemar test of the run adjusted within the family of all of them."""
    tests = [comparison.crashes.p for result in results for comparison in result.comparisons]
    adjusted = iter(holm(tests))
    return tuple(
        replace(
            result,
            comparisons=tuple(replace(item, p_holm=next(adjusted)) for item in result.comparisons),
        )
        for result in results
    )


def _compare_group(
    run: RunData, group: StrategyGroup, limits: Limits | None, steps: _Steps
) -> GroupResult:
    seed = group.cells[0].cell.scenario.experiment.seed
    columns = [run.pair_columns_of(member.cell.number) for member in group.cells]
    comparisons = []
    for a, b in combinations(range(len(columns)), 2):
        comparisons.append(_compare(a, b, group, columns, seed, run.confidence))
        steps.one_more()
    level = 1 - run.confidence
    sweeps = [] if limits is None else parameter_sweeps(group)
    summaries = {result.cell.number: result.summary for result in run.results}
    return GroupResult(
        group,
        level,
        tuple(summaries[member.cell.number] for member in group.cells),
        tuple(comparisons),
        tuple(_judge(sweep, columns, limits, seed, level) for sweep in sweeps if limits),
    )


def _compare(
    a: int,
    b: int,
    group: StrategyGroup,
    columns: list[PairColumns],
    seed: int,
    confidence: float,
) -> Comparison:
    # With --until cells end at different numbers of pairs: pair i is entry i in all of them.
    common = min(len(columns[a].tau), len(columns[b].tau))
    first, second = (columns[of].where(slice(common)) for of in (a, b))
    scenario = group.cells[a].cell.scenario
    free_pass_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    worst = [of.tau_worst(scenario.experiment.timeout_s, free_pass_s) for of in (first, second)]
    # The same resampling for every two cells: none depends on what else was compared.
    rng = resampling(seed, "comparison")
    crashes = mcnemar(first.crashed[0], second.crashed[0], ~first.failed[0], ~second.failed[0])
    return Comparison(
        a=a,
        b=b,
        defined_in_both=_count(first.tau - second.tau),
        mu_difference=paired_difference(first.tau, second.tau, rng, confidence),
        mu_worst_difference=_mean(worst[0] - worst[1]),
        crossed_in_both=_count(first.delay_s[0] - second.delay_s[0]),
        delay_difference_s=paired_difference(first.delay_s[0], second.delay_s[0], rng, confidence),
        crashes=crashes,
        p_holm=crashes.p,
    )


def _judge(
    sweep: ParameterSweep, columns: list[PairColumns], limits: Limits, seed: int, level: float
) -> SweepResult:
    swept = [
        swept_value(
            columns[cell].tau,
            columns[cell].crashed[0],
            ~columns[cell].failed[0],
            resampling(seed, "comparison"),
            len(sweep.cells),
            level,
        )
        for cell in sweep.cells
    ]
    return SweepResult(sweep, limits, allowed_interval(swept, limits, level))


def _count(values: FloatArray) -> int:
    return int(np.count_nonzero(~np.isnan(values)))


def _mean(values: FloatArray) -> float | None:
    """Over the defined ones."""
    return float(np.nanmean(values)) if _count(values) else None
