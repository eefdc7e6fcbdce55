"""Prints runs and comparisons on the terminal."""

from dataclasses import replace

from rich.console import Console

from harness.old.report.screens.console import make_console, print_table
from harness.old.report.screens.paired_tables import paired_tables
from harness.old.report.screens.result_screen import screen_of
from harness.old.report.screens.result_tables import full_tables
from harness.old.report.screens.screen import Screen, screen_lines
from harness.old.statistics import RunFindings
from harness.old.studies.runs.reported import remarks, reported
from harness.old.studies.runs.run_data import RunData


def print_run(run: RunData, full: bool = False) -> None:
    """Print the first screen of a run, or with ``full`` every note, number and remark."""
    console = make_console()
    findings = reported(run)
    screen = screen_of(findings)
    print_screen(console, replace(screen, most_lines=None) if full else screen)
    if full:
        for table in (*full_tables(findings), *paired_tables(run)):
            print_table(console, table)
        for line in remarks(run):
            console.print(line)


def print_arms(findings: RunFindings, full: bool = False) -> None:
    """Print a comparison of runs with long pairs, or every number with ``full``."""
    console = make_console()
    screen = replace(screen_of(findings), footer="All measures: --full.")
    print_screen(console, replace(screen, most_lines=None) if full else screen)
    for table in full_tables(findings) if full else ():
        print_table(console, table)


def print_screen(console: Console, screen: Screen) -> None:
    """Print a first screen in the terminal's width."""
    for line in screen_lines(screen, console.width):
        console.print(line, soft_wrap=True)
