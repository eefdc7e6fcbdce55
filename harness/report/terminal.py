"""What the command line prints of a run, and its JSON document."""

import shlex
from collections.abc import Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from harness.batch.finish import Run
from harness.comparison import INDICATIVE_BELOW, Summary
from harness.report.console import make_console, plain, table_of_columns, with_range
from harness.report.words import (
    PAPER,
    PAPER_REMARK,
    both_arms,
    both_shares,
    conflict_name,
    conflict_rows,
    count_lines,
    crash_lines,
    indicative,
    is_the_papers,
    measure_rows,
    sweep_lines,
)
from harness.results.measure_tables import ConflictRate, conflict_row
from harness.results.summaries import summary_row
from harness.scenario import Scenario


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
    command = f"harness report {shlex.quote(str(run.folder))}"
    console.print(f"See it: {command}", soft_wrap=True)


def _print_cell(
    console: Console, summary: Summary, conflicts: Sequence[ConflictRate], scenario: Scenario
) -> None:
    paper = is_the_papers(scenario)
    title = f"{scenario.arms.av} against {scenario.arms.human}, N = {summary.pairs}"
    table = Table(title=title, box=box.SIMPLE_HEAD)
    table.add_column("measure", no_wrap=True)
    for heading in ("value", "95 % interval", *(["paper"] if paper else []), "remark"):
        table.add_column(heading, overflow="fold")
    for name, value, interval, key, remark in (*measure_rows(summary), *conflict_rows(conflicts)):
        table.add_row(name, value, interval, *([PAPER.get(key, "")] if paper else []), remark)
    console.print(table)
    for line in (*crash_lines(summary), *count_lines(summary)):
        console.print(line)
    if paper:
        console.print(PAPER_REMARK)


def _table_over_cells(run: Run) -> Table:
    """μ, κ and delay of every cell with their intervals."""
    title = f"{run.study.name}: {len(run.summaries)} cells, 95 % intervals"
    keys = run.study.varied_keys
    headings = [key.split(".")[-1] for key in keys]
    measures = ("N", "μ", "κ AV", "κ human", "delay AV s", "delay human s")
    table = table_of_columns(title, *headings, *measures)
    for cell, summary in zip(run.study.cells, run.summaries, strict=True):
        n = summary.defined_pairs
        table.add_row(
            *(plain(cell.varied[key]) for key in keys),
            str(summary.pairs),
            with_range(summary.mu, 3) + _star(n, "mu"),
            with_range(summary.kappa, 4),
            with_range(summary.kappa_human, 4),
            with_range(summary.delay_s, 2) + _star(n, "delay_s"),
            with_range(summary.delay_human_s, 2) + _star(n, "delay_human_s"),
        )
    return table


def _star(n: int, key: str) -> str:
    return "*" if indicative(n, key) else ""


def _sweep_lines(run: Run) -> list[str]:
    lines = []
    shown = ("mu", "delay_s", "delay_human_s")
    if any(indicative(summary.defined_pairs, key) for summary in run.summaries for key in shown):
        lines.append("* indicative: N too small")
    lines += sweep_lines(run.summaries)
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
                    name for name in INDICATIVE_BELOW if indicative(summary.defined_pairs, name)
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


def _conflicts_over_cells(run: Run) -> Table:
    """Avoidable crashes and conflicts of every cell, without their intervals."""
    title = "% of episodes, AV / human: avoidable crashes; conflicts, crashes included"
    keys = run.study.varied_keys
    kinds = [f"{conflict_name(av)} conflicts" for av, _ in both_arms(run.conflicts[0])]
    headings = (key.split(".")[-1] for key in keys)
    table = table_of_columns(title, *headings, "κ avoidable", *kinds)
    for cell, summary, rates in zip(run.study.cells, run.summaries, run.conflicts, strict=True):
        both = [(summary.kappa_avoidable, summary.kappa_avoidable_human)]
        both += [(av.rate, human.rate) for av, human in both_arms(rates)]
        shares = [both_shares(av, human)[0].removesuffix(" %") for av, human in both]
        table.add_row(*(plain(cell.varied[key]) for key in keys), *shares)
    return table
