"""Commands about the installation and its parts: ``network``, ``strategies``, ``doctor``."""

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.interruption import unwinding
from harness.cli.options import JsonOption, QuietOption, ScenarioArgument, SetOption, settings_of
from harness.cli.output import print_json, print_line


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
    """Build the scenario's SUMO network: plain-XML sources and the .net.xml."""
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
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print names, or failed checks, alone.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List the strategies and their parameters, or check one against the rules for all."""
    if check is None:
        _list_strategies(quiet, as_json)
        return
    from harness.conformance import check_strategy

    verdicts = check_strategy(check)
    unchecked = {verdict.check for verdict in verdicts if not verdict.checked}
    checks = [(verdict.check, verdict.problem) for verdict in verdicts]
    _print_checks(checks, quiet, as_json, unchecked)


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
            print_line(f"    {document['knows']}: it is given the model that they are drawn from")
        for parameter in [] if quiet else document["parameters"]:
            default = "no default" if parameter["required"] else parameter["default"]
            print_line(f"    {parameter['name']} = {default}  ({parameter['kind']})")


def doctor(
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print failed checks alone.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Check this installation: versions, SUMO, a network build, one episode."""
    from harness.report.listings import installation_checks
    from harness.versions import versions_of_runs

    try:
        found = versions_of_runs()
    except ImportError:
        found = {}  # what is missing is the first check's to say
    if as_json:
        with unwinding():
            _print_checks(installation_checks(), quiet, as_json, versions=found)
        return
    for name, version in () if quiet else found.items():
        print_line(f"{name:8s} {version}")
    with unwinding():
        _print_checks(installation_checks(), quiet, as_json)


def _print_checks(
    checks: Iterable[tuple[str, str | None]],
    quiet: bool,
    as_json: bool,
    unchecked: Collection[str] = (),
    **more: Any,
) -> None:
    """Say of each check, as it is made, whether it went well; exit code 1 if one did not.

    Those of ``unchecked`` could not be made; their problem says why.
    """
    problems = []
    made = []
    for title, problem in checks:
        made.append({"check": title, "problem": problem})
        if problem is not None:
            problems.append(problem)
        failed = problem is not None and title not in unchecked
        if not as_json and (failed or not quiet):
            word = "FAILED" if failed else "ok" if problem is None else "-"
            print_line(f"{word:8s} {title}" + (f": {problem}" if problem else ""))
    if as_json:
        print_json({**more, "checks": made})
    if problems:
        raise typer.Exit(1)
