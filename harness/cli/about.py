"""Commands about the installation and its parts: ``network``, ``strategies``, ``doctor``."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.interruption import unwinding
from harness.cli.options import JsonOption, QuietOption, ScenarioArgument, SetOption, settings_of
from harness.cli.output import print_json, print_line
from harness.errors import InputError

if TYPE_CHECKING:
    from harness.conformance import RuleResult


def print_version(wanted: bool) -> None:
    """``harness --version``: the package's own, and nothing else."""
    if wanted:
        from importlib.metadata import version

        print_line(version("crosswalk-harness"))
        raise typer.Exit


def network(
    scenario: ScenarioArgument,
    out: Annotated[Path, typer.Option(help="Folder for the sources and the network.")],
    settings: SetOption = None,
    quiet: QuietOption = False,  # noqa: ARG001  # the path is all it prints anyway
    as_json: JsonOption = False,
) -> None:
    """Build the scenario's SUMO network, with its plain-XML sources."""
    from harness.scenario import read_scenario_file

    file = read_scenario_file(scenario, settings_of(settings))
    loaded = file.scenario()
    from harness.network import build_network

    with unwinding():
        files = build_network(loaded.crossing, out, file.name)
    if as_json:
        print_json({"net": str(files.net)})
    else:
        print_line(str(files.net))


def strategies(
    check: Annotated[
        str | None,
        typer.Option(
            help="Check a strategy of your own, e.g. my_module:MyStrategy, or any of the list.",
            metavar="STRATEGY",
        ),
    ] = None,
    scenario: Annotated[
        str,
        typer.Option(help="With --check: whose crosswalk, ego and parameters."),
    ] = "cctc",
    settings: SetOption = None,
    limit: Annotated[
        float, typer.Option(help="With --check: seconds of wall time for all checks together.")
    ] = 60.0,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print names, or failed checks, alone.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List the strategies and their parameters, or check one."""
    asked = {"--scenario": scenario != "cctc", "--set": bool(settings), "--limit": limit != 60.0}
    if check is None:
        if (option := next((name for name, given in asked.items() if given), None)) is not None:
            raise InputError(option, "goes with --check", "--check STRATEGY")
        _list_strategies(quiet, as_json)
        return
    from harness.conformance import check_strategy

    if not limit > 0:
        raise InputError("--limit", f"{limit:g} s", "above 0")
    verdicts = check_strategy(check, None, scenario, settings_of(settings), limit)
    _print_verdicts(check, verdicts, quiet, as_json)


def _list_strategies(quiet: bool, as_json: bool) -> None:
    from harness.report.listings import strategy_documents

    documents = strategy_documents()
    if as_json:
        print_json(documents)
        return
    for document in documents:
        if "problem" in document:
            print_line(f"FAILED   {document['problem']}")
            continue
        print_line(document["name"] if quiet else f"{document['name']}: {document['summary']}")
        if document["knows"] and not quiet:
            print_line(f"    {document['knows']}")
        for parameter in [] if quiet else document["parameters"]:
            default = "no default" if parameter["required"] else parameter["default"]
            print_line(f"    {parameter['name']} = {default}  ({parameter['kind']})")


def doctor(
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print failed checks alone.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Check this installation: versions, SUMO, a network, a pair."""
    from harness.report.listings import installation_checks
    from harness.versions import versions_of_runs

    try:
        found = versions_of_runs()
    except ImportError:
        found = {}  # what is missing is the first check's to say
    if not (quiet or as_json):
        for name, version in found.items():
            print_line(f"{name:8s} {version}")
    with unwinding():
        _print_checks(installation_checks(), found, quiet, as_json)


def _print_verdicts(
    name: str, verdicts: "Sequence[RuleResult]", quiet: bool, as_json: bool
) -> None:
    """Say of each rule whether it was kept, and what the strategy was shown where it was not."""
    from harness.report.listings import knowledge_of, observation_lines, verdict_document
    from harness.strategies.registry import find_strategy

    knows = knowledge_of(find_strategy(name, "--check"))
    if as_json:
        checks = [verdict_document(verdict) for verdict in verdicts]
        print_json({"checks": checks, "knows": knows})
    for verdict in [] if as_json else verdicts:
        failed = verdict.problem is not None and verdict.checked
        if not (failed or not quiet):
            continue
        word = "FAILED" if failed else "ok" if verdict.problem is None else "-"
        reason = f": {verdict.problem}" if verdict.problem else ""
        print_line(f"{word:8s} {verdict.check}{reason}")
        for line in observation_lines(verdict.observation):
            print_line(f"         {line}")
    if knows and not (quiet or as_json):
        print_line(f"note     it {knows}")
    if any(verdict.problem for verdict in verdicts):
        raise typer.Exit(1)


def _print_checks(
    checks: Iterable[tuple[str, str | None]],
    versions: dict[str, str],
    quiet: bool,
    as_json: bool,
) -> None:
    """Say of each check, as it is made, whether it went well; exit code 1 if one did not."""
    made = []
    for title, problem in checks:
        made.append({"check": title, "problem": problem})
        if not as_json and (problem is not None or not quiet):
            word = "ok" if problem is None else "FAILED"
            print_line(f"{word:8s} {title}" + (f": {problem}" if problem else ""))
    if as_json:
        print_json({"versions": versions, "checks": made})
    if any(check["problem"] is not None for check in made):
        raise typer.Exit(1)
