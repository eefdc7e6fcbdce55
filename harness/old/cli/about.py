"""``strategies --check``: checks one strategy."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from harness.core.errors import InputError
from harness.old.cli import options
from harness.old.cli.options import settings_of
from harness.old.cli.output import emit

if TYPE_CHECKING:
    from harness.old.studies.conformance import RuleResult


def strategies(
    check: Annotated[
        str,
        typer.Option(
            help="Check your own strategy, e.g. my_module:MyStrategy, or one from the list.",
            metavar="STRATEGY",
        ),
    ],
    scenario: Annotated[
        str,
        typer.Option(help="With --check: the scenario that sets crosswalk, ego and parameters."),
    ] = "cctc",
    settings: options.SetOption = None,
    limit: Annotated[
        float, typer.Option(help="With --check: time limit for all checks together, in seconds.")
    ] = 60.0,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print only names, or failed checks.")
    ] = False,
    as_json: options.JsonOption = False,
) -> None:
    """Check a strategy, and print which rules it keeps."""
    from harness.old.studies.conformance import check_strategy

    if not limit > 0:
        raise InputError("--limit", f"{limit:g} s", "above 0")
    results = check_strategy(check, None, scenario, settings_of(settings), limit)
    _print_results(check, results, quiet, as_json)


def _print_results(name: str, results: "Sequence[RuleResult]", quiet: bool, as_json: bool) -> None:
    """Print which rules a strategy keeps, and the observations with which it broke one."""
    from harness.old.report.screens.listings import (
        knowledge_of,
        observation_lines,
        verdict_document,
    )
    from harness.strategies.registry import find_strategy

    knows = knowledge_of(find_strategy(name, "--check"))
    lines = []
    for result in results:
        failed = result.problem is not None and result.checked
        if failed or not quiet:
            word = "FAILED" if failed else "ok" if result.problem is None else "-"
            lines.append(_line(word, result.check, result.problem))
            lines += [_line("", text) for text in observation_lines(result.observation)]
    if knows and not quiet:
        lines.append(_line("note", f"it {knows}"))
    checks = [verdict_document(result) for result in results]
    emit(quiet, as_json, {"checks": checks, "knows": knows}, lines)
    if any(result.problem for result in results):
        raise typer.Exit(1)


def _line(word: str, text: str, problem: str | None = None) -> str:
    return f"{word:8s} {text}" + (f": {problem}" if problem else "")
