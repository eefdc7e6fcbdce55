"""Commands about the installation and its parts: ``network``, ``strategies``, ``doctor``."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.options import settings_of
from harness.cli.output import emit, print_json, print_line
from harness.core.errors import HarnessError, InputError


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
    ] = 60.0,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print only names, or failed checks.")
    ] = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the strategies and their parameters, or check one."""
    if check is not None:
        from harness.old.cli.about import strategies as check_one

        check_one(check, scenario, settings, limit, quiet, as_json)
        return
    if settings or scenario != "cctc" or limit != 60.0:
        needed = "--check STRATEGY"
        raise InputError("--scenario, --set and --limit", f"need {needed}", needed)
    documents = _strategies()

    def listed() -> None:
        for each in documents:
            print_line(f"{each['name']}: {each.get('problem') or each['summary']}")
            if each.get("knows_the_model"):
                print_line("    it is given the model from which the pedestrians are drawn")
            for parameter in each.get("parameters", ()):
                default = parameter["default"] or "no default"
                print_line(f"    {parameter['name']} = {default}  ({parameter['kind']})")
                for note in parameter["notes"]:
                    print_line(f"        {note}")

    emit(quiet, as_json, documents, [each["name"] for each in documents], listed)


def _strategies() -> list[Mapping[str, Any]]:
    """Return every strategy with its first line and its parameters, or with its problem."""
    from harness.strategies.parameters import describe, knows_the_model, parameters_of
    from harness.strategies.registry import available

    found: list[Mapping[str, Any]] = []
    for name, factory in available().items():
        if isinstance(factory, InputError):
            found.append({"name": name, "problem": str(factory)})
            continue
        notes = getattr(factory, "NOTES", {})
        found.append(
            {
                "name": name,
                "summary": (factory.__doc__ or "no description").strip().splitlines()[0],
                "knows_the_model": knows_the_model(factory),
                "parameters": [
                    {
                        "name": each.name,
                        "kind": describe(each.annotation),
                        "default": None if each.required else repr(each.default),
                        "notes": [*notes.get(each.name, ())],
                    }
                    for each in parameters_of(factory)
                ],
            }
        )
    return found


def doctor(
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print only failed checks.")] = False,
    as_json: options.JsonOption = False,
) -> None:
    """Check this installation: versions, SUMO, a network, a pair."""
    from harness.core.versions import versions_of_runs

    try:
        versions = versions_of_runs()
    except ImportError:
        versions = {}  # the first check says what is missing
    checks, problem = [], None
    with unwinding():
        for title, check in _CHECKS.items():
            try:
                check()
            except (HarnessError, ImportError, OSError) as error:
                problem = str(error)
            checks.append({"check": title, "problem": problem})
            if problem is not None:
                break
    if as_json:
        print_json({"versions": versions, "checks": checks})
    else:
        for name, version in {} if quiet else versions.items():
            print_line(f"{name:8s} {version}")
        for each in checks:
            if each["problem"] is not None:
                print_line(f"FAILED   {each['check']}: {each['problem']}")
            elif not quiet:
                print_line(f"ok       {each['check']}")
    if problem is not None:
        raise typer.Exit(1)


def _check_packages() -> None:
    from harness.engine.installation import check_packages

    check_packages()


def _check_network() -> None:
    from harness.engine.network import build_network
    from harness.scenario.sections import CrossingSection

    with tempfile.TemporaryDirectory() as folder:
        build_network(CrossingSection(length_m=10.0), Path(folder), "doctor")


def _check_pair() -> None:
    """Run a pair in a process of its own, because a broken library may kill it."""
    from harness.studies.run import run

    with tempfile.TemporaryDirectory() as folder:
        failures = run("cctc", pairs=1, out=Path(folder) / "run", workers=1).failures
    if failures:
        raise HarnessError(failures[0][-1])


_CHECKS: Mapping[str, Callable[[], None]] = {
    "SUMO is installed in the version needed": _check_packages,
    "SUMO's netconvert builds a network": _check_network,
    "one pair runs in SUMO": _check_pair,
}
