"""Compares the strategies of a sweep from its run folder: pair by pair, within each group.

Nothing is simulated.  The arithmetic is in ``harness.comparison``; what is comparable with what,
in ``harness.review.strategy_groups``.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from harness.comparison import (
    Limits,
    allowed_interval,
    holm,
    mcnemar,
    paired_difference,
    proportion,
    swept_value,
)
from harness.encounter import FloatArray
from harness.errors import InputError
from harness.results.manifest import options_of, recall_study
from harness.results.reading import read_finished_manifest, read_table
from harness.results.summaries import confidence_of, pair_columns
from harness.review.comparisons import (
    ComparedCell,
    Comparison,
    GroupResult,
    RunComparison,
    SweepResult,
)
from harness.review.strategy_groups import (
    ParameterSweep,
    StrategyCell,
    StrategyGroup,
    parameter_sweeps,
    strategy_groups,
)
from harness.seeding import resampling

Progress = Callable[[int, int], None]
"""(steps done, steps planned)."""


def compare(
    run: Path,
    mu0: float | None = None,
    kappa0: float | None = None,
    progress: Progress = lambda _done, _planned: None,
) -> RunComparison:
    """Compare every two cells of a run that differ in the AV's strategy alone.

    Args:
        run: a finished run of several cells.
        mu0: limit of μ for the allowed interval; default: the scenario's ``limits.mu0``.
        kappa0: limit of κ; default: the scenario's ``limits.kappa0``.
        progress: told how far it is.

    Raises:
        InputError: no finished run, limits that are none, or nothing to compare.
    """
    document = read_finished_manifest(run)
    study = recall_study(document)
    groups = strategy_groups(study)
    if all(len(group.cells) == 1 for group in groups):
        raise InputError(
            str(run),
            "has no two cells that differ in the AV's strategy alone",
            "a sweep over arms.av or over parameters of its strategy",
        )
    confidence = confidence_of(study, options_of(document))
    limits = [_limits(group, mu0, kappa0) for group in groups]
    steps = _Steps(sum(math.comb(len(group.cells), 2) for group in groups), progress)
    results = [
        _compare_group(run, group, limit, confidence, steps)
        for group, limit in zip(groups, limits, strict=True)
    ]
    return RunComparison(run, study.name, confidence, _as_one_family(results))


def allowed_values(
    run: Path, group: StrategyGroup, limits: Limits, confidence: float
) -> tuple[SweepResult, ...]:
    """Which values of every parameter swept in a group are allowed, without comparing its cells.

    Args:
        run: a finished run.
        group: of its cells.
        limits: μ0 and κ0.
        confidence: of all bounds of one sweep together.
    """
    columns = [_read(run, member) for member in group.cells]
    seed = group.cells[0].cell.scenario.experiment.seed
    sweeps = parameter_sweeps(group)
    return tuple(_judge(sweep, columns, limits, seed, 1 - confidence) for sweep in sweeps)


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


@dataclass(frozen=True)
class _Columns:
    """What of a cell is kept in memory, one entry for each pair."""

    tau: FloatArray
    tau_timeout: FloatArray
    delay_s: FloatArray
    crashed: np.ndarray
    ran: np.ndarray
    timed_out: int

    def first(self, pairs: int) -> "_Columns":
        """Of the first pairs alone."""
        return replace(
            self,
            tau=self.tau[:pairs],
            tau_timeout=self.tau_timeout[:pairs],
            delay_s=self.delay_s[:pairs],
            crashed=self.crashed[:pairs],
            ran=self.ran[:pairs],
        )


def _compare_group(
    run: Path, group: StrategyGroup, limits: Limits | None, confidence: float, steps: _Steps
) -> GroupResult:
    seed = group.cells[0].cell.scenario.experiment.seed
    columns = [_read(run, member) for member in group.cells]
    comparisons = []
    for a, b in combinations(range(len(columns)), 2):
        comparisons.append(_compare(a, b, columns, seed, confidence))
        steps.one_more()
    level = 1 - confidence
    sweeps = [] if limits is None else parameter_sweeps(group)
    return GroupResult(
        group,
        level,
        tuple(_cell(*both, confidence) for both in zip(group.cells, columns, strict=True)),
        tuple(comparisons),
        tuple(_judge(sweep, columns, limits, seed, level) for sweep in sweeps if limits),
    )


def _read(run: Path, member: StrategyCell) -> _Columns:
    pairs = pair_columns(read_table(run, "episodes", member.cell.number))
    timeout_s = member.cell.scenario.experiment.timeout_s
    return _Columns(
        tau=pairs.tau,
        tau_timeout=pairs.tau_with_timeouts(timeout_s),
        delay_s=pairs.delay_s[0],
        crashed=pairs.crashed[0],
        ran=~pairs.failed[0],
        timed_out=int(pairs.any_timed_out.sum()),
    )


def _compare(a: int, b: int, columns: list[_Columns], seed: int, confidence: float) -> Comparison:
    # With --until cells end at different numbers of pairs: pair i is entry i in all of them.
    common = min(len(columns[a].tau), len(columns[b].tau))
    first, second = columns[a].first(common), columns[b].first(common)
    # The same resampling for every two cells: none depends on what else was compared.
    rng = resampling(seed, "comparison")
    crashes = mcnemar(first.crashed, second.crashed, first.ran, second.ran)
    return Comparison(
        a=a,
        b=b,
        defined_in_both=_count(first.tau - second.tau),
        mu_difference=paired_difference(first.tau, second.tau, rng, confidence),
        mu_timeout_difference=_mean(first.tau_timeout - second.tau_timeout),
        crossed_in_both=_count(first.delay_s - second.delay_s),
        delay_difference_s=paired_difference(first.delay_s, second.delay_s, rng, confidence),
        crashes=crashes,
        p_holm=crashes.p,
    )


def _judge(
    sweep: ParameterSweep, columns: list[_Columns], limits: Limits, seed: int, level: float
) -> SweepResult:
    swept = [
        swept_value(
            columns[cell].tau,
            columns[cell].crashed,
            columns[cell].ran,
            resampling(seed, "comparison"),
            len(sweep.cells),
            level,
        )
        for cell in sweep.cells
    ]
    return SweepResult(sweep, limits, allowed_interval(swept, limits, level))


def _cell(strategy: StrategyCell, columns: _Columns, confidence: float) -> ComparedCell:
    return ComparedCell(
        strategy=strategy,
        pairs=len(columns.tau),
        defined_pairs=_count(columns.tau),
        timed_out=columns.timed_out,
        mu=_mean(columns.tau),
        mu_timeout=_mean(columns.tau_timeout),
        kappa=proportion(int(columns.crashed.sum()), int(columns.ran.sum()), confidence),
        delay_s=_mean(columns.delay_s),
    )


def _count(values: FloatArray) -> int:
    return int(np.count_nonzero(~np.isnan(values)))


def _mean(values: FloatArray) -> float | None:
    """Over the defined ones."""
    return float(np.nanmean(values)) if _count(values) else None
