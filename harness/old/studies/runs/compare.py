"""Compares the strategies of a sweep, or of several runs, pair by pair within each group.

Nothing is simulated.  ``harness.old.statistics`` does the arithmetic, ``strategy_groups`` finds
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
from harness.old.statistics import (
    ComparedColumns,
    Limits,
    PairColumns,
    allowed_interval,
    holm,
    mcnemar,
    swept_value,
)
from harness.old.store.over_model import refits_of
from harness.old.store.summaries import repeated
from harness.old.studies.runs.comparisons import (
    LEVEL,
    Comparison,
    GroupResult,
    RunComparison,
    SweepResult,
)
from harness.old.studies.runs.opening import opened_run
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.same_pairs import check_same_pairs, names_of
from harness.old.studies.runs.strategy_groups import (
    ParameterSweep,
    StrategyGroup,
    groups_over,
    parameter_sweeps,
)

Progress = Callable[[int, int], None]
"""Receives the numbers of done and planned steps."""


def compare(
    *runs: RunData | str | Path,
    mu0: float | None = None,
    kappa0: float | None = None,
    progress: Progress = lambda _done, _planned: None,
) -> RunComparison:
    """Compare every two cells that differ only in the AV's strategy, in one run or in several.

    Separate runs are compared over the pairs that they have in common.

    Args:
        runs: finished runs or their folders: one run with several cells, or several runs with the
            same seed, pedestrians, ego and reference.
        mu0: limit of μ, under which values of a swept parameter are allowed; give both or neither.
        kappa0: limit of κ.
        progress: called with the numbers of done and planned comparisons.

    Raises:
        InputError: a run is not finished, a limit is out of range, no two cells can be compared,
            or the reference arm did not meet the same people in all runs.
    """
    if not runs:
        raise InputError("compare", "no run given", "one run or several")
    opened = [opened_run(run) for run in runs]
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
    limits = _limits(mu0, kappa0)
    if limits is not None and not any(map(parameter_sweeps, groups)):
        raise InputError("--mu0, --kappa0", "no parameter is swept", "a sweep over a parameter")
    steps = _Steps(sum(math.comb(len(group.cells), 2) for group in groups), progress)
    results = [_compare_group(opened, group, limits, steps) for group in groups]
    paths = tuple(run.path for run in opened)
    return RunComparison(paths, opened[0].name, _as_one_family(results))


def _columns_of(runs: Sequence[RunData], group: StrategyGroup) -> list[PairColumns]:
    """Return the columns of every member of a group."""
    return [runs[member.run].pair_columns_of(member.cell.number) for member in group.cells]


def _limits(mu0: float | None, kappa0: float | None) -> Limits | None:
    if mu0 is not None and not 0 < mu0 < math.inf:
        raise InputError("--mu0", f"{mu0:g} is not accepted", "above 0")
    if kappa0 is not None and not 0 < kappa0 <= 1:
        raise InputError("--kappa0", f"{kappa0:g} is not accepted", "above 0, at most 1")
    if mu0 is None and kappa0 is None:
        return None
    if mu0 is None or kappa0 is None:
        missing = "--mu0" if mu0 is None else "--kappa0"
        raise InputError(missing, "is missing", "both limits or neither")
    return Limits(mu0, kappa0)


class _Steps:
    """Counts the finished comparisons."""

    def __init__(self, planned: int, progress: Progress) -> None:
        self._done, self._planned, self._progress = 0, planned, progress

    def one_more(self) -> None:
        self._done += 1
        self._progress(self._done, self._planned)


def _as_one_family(results: list[GroupResult]) -> tuple[GroupResult, ...]:
    """Adjust the p values by Holm, in one family for the crashes and one for times and misses."""
    items = [item for result in results for item in result.comparisons]
    crashes = holm([item.crashes.p for item in items])
    times = [item.time_ratio_difference.p for item in items]
    both = holm([*times, *(item.misses.p for item in items)])
    adjusted = iter(
        replace(item, p_holm=p, time_ratio_p_holm=time, misses_p_holm=missed)
        for item, p, time, missed in zip(
            items, crashes, both[: len(items)], both[len(items) :], strict=True
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
    steps: _Steps,
) -> GroupResult:
    seed = group.cells[0].cell.scenario.experiment.seed
    columns = _columns_of(runs, group)
    over_refits = group.cells[0].cell.scenario.model.over_refits
    refits = refits_of(runs[group.cells[0].run].manifest) if over_refits else None
    comparisons = []
    for a, b in combinations(range(len(columns)), 2):
        comparisons.append(_compare(a, b, group, columns, seed, refits))
        steps.one_more()
    sweeps = [] if limits is None else parameter_sweeps(group)
    summaries = [{result.cell.number: result.summary for result in run.results} for run in runs]
    return GroupResult(
        group,
        tuple(summaries[member.run][member.cell.number] for member in group.cells),
        tuple(comparisons),
        tuple(_judge(sweep, group, columns, limits) for sweep in sweeps if limits),
    )


def _compare(
    a: int,
    b: int,
    group: StrategyGroup,
    columns: list[PairColumns],
    seed: int,
    refits: JsonObject | None,
) -> Comparison:
    # Runs may have different numbers of pairs; pair i is entry i in every cell.
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
) -> SweepResult:
    """Judge a parameter's values with bounds that hold for all of them simultaneously."""
    seed = group.cells[0].cell.scenario.experiment.seed
    swept = [
        swept_value(
            columns[cell].tau_all,
            columns[cell].av_missed,
            columns[cell].av_tried,
            _count(columns[cell].tau_all[columns[cell].met_someone]),
            resampling(seed, "comparison"),
            len(sweep.cells),
            LEVEL,
            repeated=repeated(columns[cell], group.cells[cell].cell.scenario)[0],
        )
        for cell in sweep.cells
    ]
    return SweepResult(sweep, limits, allowed_interval(swept, limits, LEVEL))


def _count(values: FloatArray) -> int:
    return int(np.count_nonzero(~np.isnan(values)))
