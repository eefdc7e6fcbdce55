"""What the command line prints: the table of a run, the strategies, the checks."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from harness.comparison import (
    CONFIDENCE,
    INDICATIVE_BELOW,
    Interval,
    Proportion,
    Summary,
    zero_bound,
)
from harness.encounter import Arm
from harness.errors import HarnessError
from harness.finish import Run
from harness.measure_tables import CONFLICTS, ConflictRate, conflict_row
from harness.measures import MEASURES
from harness.report.console import make_console, plain, table_of_columns, with_range
from harness.results import versions
from harness.scenario import Scenario
from harness.strategies.parameters import describe, parameters_of
from harness.strategies.registry import available
from harness.summaries import summary_row

_Row = tuple[str, str, str, str, str]
"""Measure, value, interval, key of the paper's value, remark."""

PAPER = {"mu": "0.7044", "cv": "4.54 %", "kappa": "0"}
"""Chen, Zhao, Peng 2017, section III-E; N = 50."""

_PAPER_REMARK = (
    "The paper's column is a reference, not a target: its 2,973 events and fitted parameters were "
    "never published, so the model here is fitted on other trajectories, and Soft-Yield has no "
    "answer for walkers under 0.976 m/s at (30 m, 5 m/s), where Hard-Yield takes over here."
)


def print_run(run: Run) -> None:
    """The results of a finished run, on stdout: one cell in full, or a table over cells."""
    console = make_console()
    if run.study.varied_keys:
        console.print(_table_over_cells(run))
        console.print(_conflicts_over_cells(run))
        for line in _sweep_lines(run):
            console.print(line)
    else:
        _print_cell(console, run.summaries[0], run.conflicts[0], run.study.base)
    console.print(f"Run folder: {run.folder}", soft_wrap=True)


def _print_cell(
    console: Console, summary: Summary, conflicts: Sequence[ConflictRate], scenario: Scenario
) -> None:
    paper = is_the_papers(scenario)
    title = f"{scenario.arms.av} against {scenario.arms.human}, N = {summary.pairs}"
    table = Table(title=title, box=box.SIMPLE_HEAD)
    table.add_column("measure", no_wrap=True)
    for heading in ("value", "95 % interval", *(["paper"] if paper else []), "remark"):
        table.add_column(heading, overflow="fold")
    for name, value, interval, key, remark in (*_measure_rows(summary), *_conflict_rows(conflicts)):
        table.add_row(name, value, interval, *([PAPER.get(key, "")] if paper else []), remark)
    console.print(table)
    for line in (*_crash_lines(summary), *_count_lines(summary)):
        console.print(line)
    if paper:
        console.print(_PAPER_REMARK)


def _table_over_cells(run: Run) -> Table:
    """μ, κ and delay of every cell with their intervals."""
    title = f"{run.study.name}: {len(run.summaries)} cells, 95 % intervals"
    keys = run.study.varied_keys
    headings = [key.split(".")[-1] for key in keys]
    measures = ("N", "μ", "κ AV", "κ human", "delay AV s", "delay human s")
    table = table_of_columns(title, *headings, *measures)
    for cell, summary in zip(run.study.cells, run.summaries, strict=True):
        few = "*" if summary.defined_pairs < INDICATIVE_BELOW["mu"] else ""
        table.add_row(
            *(plain(cell.varied[key]) for key in keys),
            str(summary.pairs),
            with_range(summary.mu, 3) + few,
            with_range(summary.kappa, 4),
            with_range(summary.kappa_human, 4),
            with_range(summary.delay_s, 2),
            with_range(summary.delay_human_s, 2),
        )
    return table


def _sweep_lines(run: Run) -> list[str]:
    lines = []
    if any(summary.defined_pairs < INDICATIVE_BELOW["mu"] for summary in run.summaries):
        lines.append("* indicative: N too small")
    pairs = sum(summary.pairs for summary in run.summaries)
    out = sum(summary.timed_out for summary in run.summaries)
    nobody = sum(summary.met_nobody for summary in run.summaries)
    failed = sum(summary.failed for summary in run.summaries)
    lines.append(
        f"Of {pairs} pairs {out} ({out / pairs:.1%}) timed out, {nobody} ({nobody / pairs:.1%}) "
        f"met nobody, {failed} failed in the engine. Everything else: "
        "summary.csv, measures.csv, conflicts.csv."
    )
    return lines


def run_document(run: Run) -> dict[str, Any]:
    """What ``--json`` prints."""
    return {
        "folder": str(run.folder),
        "cells": [
            {
                "varied": cell.varied,
                "summary": summary_row(summary),
                "conflicts": [conflict_row(rate) for rate in rates],
                "indicative": [
                    name
                    for name, limit in INDICATIVE_BELOW.items()
                    if summary.defined_pairs < limit
                ],
            }
            for cell, summary, rates in zip(
                run.study.cells, run.summaries, run.conflicts, strict=True
            )
        ],
        "failures": [
            {"cell": cell, "pair": pair, "arm": arm, "reason": why}
            for cell, pair, arm, why in run.failures
        ],
    }


def is_the_papers(scenario: Scenario) -> bool:
    """Whether the paper's Table II and arms are what runs here (any N, seed and model)."""
    ego, pedestrians = scenario.ego, scenario.pedestrians
    return (
        (ego.trigger_range_m, scenario.crossing.length_m, ego.initial_speed_mps) == (30, 9, 5)
        and (scenario.arms.av, scenario.arms.human) == ("soft_yield", "human_gmm")
        and pedestrians.first_at_trigger
        and pedestrians.max_count == 1
    )


def print_strategies() -> None:
    """Every strategy with what it does and its parameters."""
    console = Console(highlight=False)
    for name, factory in available().items():
        summary = (factory.__doc__ or "no description").strip().splitlines()[0]
        console.print(f"{name}: {summary}", markup=False)
        for parameter in parameters_of(factory):
            default = "no default" if parameter.required else f"{parameter.default!r}"
            kind = describe(parameter.annotation)
            console.print(f"    {parameter.name} = {default}  ({kind})", markup=False)


def print_checks() -> bool:
    """Check the installation step by step; returns whether everything works."""
    console = Console(highlight=False, soft_wrap=True)
    for name, version in versions().items():
        console.print(f"{name:8s} {version}")
    for title, check in (
        ("SUMO's netconvert builds a network", _check_network),
        ("one pair runs in SUMO", _check_episode),
    ):
        try:
            check()
        except (HarnessError, ImportError, OSError) as error:
            console.print(f"FAILED   {title}: {error}")
            return False
        console.print(f"ok       {title}")
    return True


def _check_network() -> None:
    from harness.network import CrossingGeometry, build_network

    with tempfile.TemporaryDirectory() as folder:
        build_network(CrossingGeometry(length_m=10.0), Path(folder), "doctor")


def _check_episode() -> None:
    from harness.experiment import run_study
    from harness.options import Options
    from harness.scenario import Setting, read_scenario_file
    from harness.study import single_cell

    study = single_cell(read_scenario_file("cctc", [Setting("experiment.pairs", 1)]))
    with tempfile.TemporaryDirectory() as folder:
        run = run_study(study, Options(), out=Path(folder) / "run")
    if run.failures:
        raise HarnessError(run.failures[0][-1])


def _measure_rows(summary: Summary) -> list[_Row]:
    n = summary.defined_pairs
    return [
        (
            "μ   mean of τ",
            _number(summary.mu.value),
            _range(summary.mu),
            "mu",
            _indicative(n, "mu"),
        ),
        ("μ   without fallbacks", _number(summary.mu_without_fallback), "", "", ""),
        (
            "μ   time-outs counted",
            _number(summary.mu_timeout),
            "",
            "",
            "",
        ),
        (
            "c_v spread of τ",
            _percent(summary.cv.value),
            _range(summary.cv, percent=True),
            "cv",
            _indicative(n, "cv"),
        ),
        (
            "κ   crash rate, AV",
            _percent(summary.kappa.value),
            _range(summary.kappa, percent=True),
            "kappa",
            "",
        ),
        ("κ   with the front", _percent(summary.kappa_front), "", "", ""),
        (
            "κ   avoidable, AV / human",
            *_both(summary.kappa_avoidable, summary.kappa_avoidable_human),
            "",
            "by full braking at once",
        ),
        (
            "κ   crash rate, human",
            _percent(summary.kappa_human.value),
            _range(summary.kappa_human, percent=True),
            "",
            "",
        ),
        ("delay AV, s", _seconds(summary.delay_s.value), _range(summary.delay_s), "", ""),
        (
            "delay human, s",
            _seconds(summary.delay_human_s.value),
            _range(summary.delay_human_s),
            "",
            "",
        ),
        (
            "stops, AV / human",
            f"{_seconds(summary.stops)} / {_seconds(summary.stops_human)}",
            "",
            "",
            "per episode",
        ),
        (
            "stopped s, AV / human",
            f"{_seconds(summary.stopped_s)} / {_seconds(summary.stopped_human_s)}",
            "",
            "",
            "per episode",
        ),
    ]


def _conflict_rows(rates: Sequence[ConflictRate]) -> list[_Row]:
    """A row for each kind of conflict."""
    return [
        (f"{_condition(av)}, AV / human", *_both(av.rate, human.rate), "", "conflict rate")
        for av, human in _both_arms(rates)
    ]


def _conflicts_over_cells(run: Run) -> Table:
    """Avoidable crashes and conflicts of every cell, without their intervals."""
    title = "% of episodes, AV / human: avoidable crashes; conflicts, crashes included"
    keys = run.study.varied_keys
    kinds = [f"{_shown(av)} conflicts" for av, _ in _both_arms(run.conflicts[0])]
    headings = (key.split(".")[-1] for key in keys)
    table = table_of_columns(title, *headings, "κ avoidable", *kinds)
    for cell, summary, rates in zip(run.study.cells, run.summaries, run.conflicts, strict=True):
        both = [(summary.kappa_avoidable, summary.kappa_avoidable_human)]
        both += [(av.rate, human.rate) for av, human in _both_arms(rates)]
        shares = [_both(av, human)[0].removesuffix(" %") for av, human in both]
        table.add_row(*(plain(cell.varied[key]) for key in keys), *shares)
    return table


def _both_arms(rates: Sequence[ConflictRate]) -> list[tuple[ConflictRate, ConflictRate]]:
    """The AV's and the human's rate of each kind of conflict."""
    av, human = ([rate for rate in rates if rate.arm is arm] for arm in (Arm.AV, Arm.HUMAN))
    return list(zip(av, human, strict=True))


def _condition(rate: ConflictRate) -> str:
    """Which values of which measure are a conflict."""
    conflict = next(entry for entry in CONFLICTS if entry.name == rate.conflict)
    unit = next(measure.unit for measure in MEASURES if measure.column == conflict.column)
    return f"{_shown(rate)} {'>' if conflict.above else '<'} {rate.threshold:g} {unit}"


def _shown(rate: ConflictRate) -> str:
    name = rate.conflict.replace("_", " ")
    return name if " " in name else name.upper()


def _both(av: Proportion, human: Proportion) -> tuple[str, str]:
    """Two shares and their intervals in per cent."""
    values = [
        "undefined" if share.value is None else f"{100 * share.value:.1f}" for share in (av, human)
    ]
    ranges = [
        "undefined"
        if share.low is None or share.high is None
        else f"{100 * share.low:.1f} … {100 * share.high:.1f}"
        for share in (av, human)
    ]
    return f"{' / '.join(values)} %", f"{' / '.join(ranges)} %"


def _crash_lines(summary: Summary) -> list[str]:
    return [
        f"No crash of the {who} in {kappa.trials} episodes: κ below {zero_bound(kappa.trials):.1%} "
        f"with {CONFIDENCE:.0%} confidence, one-sided ({kappa.high:.1%} two-sided)."
        for who, kappa in (("AV", summary.kappa), ("human", summary.kappa_human))
        if kappa.trials and kappa.successes == 0
    ]


def _count_lines(summary: Summary) -> list[str]:
    return [
        f"τ = AV time / human time is defined in {summary.defined_pairs} of {summary.pairs} pairs; "
        f"timed out: {summary.timed_out}; failed in the engine: {summary.failed}; "
        f"met nobody: {summary.met_nobody}.",
        f"The AV fell back to Hard-Yield in {summary.fallbacks} of {summary.pairs} episodes.",
    ]


def _indicative(n: int, key: str) -> str:
    return "indicative: N too small" if n < INDICATIVE_BELOW[key] else ""


def _number(value: float | None) -> str:
    return "undefined" if value is None else f"{value:.4f}"


def _seconds(value: float | None) -> str:
    return "undefined" if value is None else f"{value:.2f}"


def _percent(value: float | None) -> str:
    return "undefined" if value is None else f"{100 * value:.2f} %"


def _range(interval: Interval, percent: bool = False) -> str:
    if interval.low is None or interval.high is None:
        return "undefined"
    if percent:
        return f"{100 * interval.low:.2f} … {100 * interval.high:.2f} %"
    return f"{interval.low:.4f} … {interval.high:.4f}"
