"""Commands about the installation and its parts: ``network``, ``strategies``, ``doctor``."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.core.errors import InputError
from harness.old.cli import options
from harness.old.cli.interruption import unwinding
from harness.old.cli.options import refuse_without, settings_of
from harness.old.cli.output import emit, print_json, print_line, print_wrapped

if TYPE_CHECKING:
    from harness.old.report.screens.listings import StrategyRow
    from harness.old.studies.conformance import RuleResult

_LIMIT_S = 60.0


def print_version(wanted: bool) -> None:
    """Print the package's version for ``harness --version``."""
    if wanted:
        from importlib.metadata import version

        print_line(version("crosswalk-harness"))
        raise typer.Exit


def network(
    scenario: options.ScenarioArgument,
    out: Annotated[Path, typer.Option(help="Folder for the sources and the network.")],
    settings: options.SetOption = None,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Build the scenario's SUMO network and its plain-XML sources."""
    from harness.scenario import read_scenario_file

    file = read_scenario_file(scenario, settings_of(settings))
    crossing = file.scenario().crossing
    from harness.engine.network import build_network

    with unwinding():
        net = build_network(crossing, out, file.name).net
    emit(quiet, as_json, {"net": str(net)}, [net])


def strategies(
    check: Annotated[
        str | None,
        typer.Option(
            help="Check your own strategy, e.g. my_module:MyStrategy, or one from the list.",
            metavar="STRATEGY",
        ),
    ] = None,
    scenario: Annotated[
        str,
        typer.Option(help="With --check: the scenario that sets crosswalk, ego and parameters."),
    ] = "cctc",
    settings: options.SetOption = None,
    limit: Annotated[
        float, typer.Option(help="With --check: time limit for all checks together, in seconds.")
    ] = _LIMIT_S,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print only names, or failed checks.")
    ] = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the strategies and their parameters, or check one."""
    refuse_without(
        "--check STRATEGY",
        check is not None,
        scenario=scenario != "cctc",
        set=bool(settings),
        limit=limit != _LIMIT_S,
    )
    if check is None:
        from harness.old.report.screens.listings import strategy_documents

        documents = strategy_documents()
        names = [document.get("problem") or document["name"] for document in documents]
        emit(quiet, as_json, documents, names, lambda: _list_strategies(documents))
        return
    from harness.old.studies.conformance import check_strategy

    if not limit > 0:
        raise InputError("--limit", f"{limit:g} s", "above 0")
    results = check_strategy(check, None, scenario, settings_of(settings), limit)
    _print_results(check, results, quiet, as_json)


def _list_strategies(documents: "Iterable[StrategyRow]") -> None:
    for document in documents:
        if "problem" in document:
            print_line(_line("FAILED", document["problem"]))
            continue
        print_wrapped(f"{document['name']}: {document['summary']}")
        if document["knows"]:
            print_wrapped(document["knows"], "    ")
        for parameter in document["parameters"]:
            default = "no default" if parameter["required"] else parameter["default"]
            print_line(f"    {parameter['name']} = {default}  ({parameter['kind']})")
            for note in parameter["notes"]:
                print_wrapped(note, "        ")


def doctor(
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print only failed checks.")] = False,
    as_json: options.JsonOption = False,
) -> None:
    """Check this installation: versions, SUMO, a network, a pair."""
    from harness.core.versions import versions_of_runs
    from harness.old.report.screens.listings import installation_checks

    try:
        versions = versions_of_runs()
    except ImportError:
        versions = {}  # the first check says what is missing
    for name, version in {} if quiet or as_json else versions.items():
        print_line(f"{name:8s} {version}")
    checks = []
    with unwinding():
        for title, problem in installation_checks():
            checks.append({"check": title, "problem": problem})
            if not as_json and (problem is not None or not quiet):
                print_line(_line("ok" if problem is None else "FAILED", title, problem))
    if as_json:
        print_json({"versions": versions, "checks": checks})
    if any(check["problem"] is not None for check in checks):
        raise typer.Exit(1)


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
