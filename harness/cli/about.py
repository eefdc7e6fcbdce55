"""Commands about the installation and its parts: ``network``, ``strategies``, ``doctor``."""

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import ScenarioArgument, SetOption, settings_of
from harness.cli.output import print_line


def network(
    scenario: ScenarioArgument,
    out: Annotated[Path, typer.Option(help="Folder for the sources and the network.")],
    settings: SetOption = None,
) -> None:
    """Build the scenario's SUMO network: plain-XML sources and the .net.xml."""
    from harness.scenario import read_scenario_file

    file = read_scenario_file(scenario, settings_of(settings))
    loaded = file.scenario()
    from harness.network import build_network
    from harness.place import geometry_of

    files = build_network(geometry_of(loaded), out, file.name)
    print_line(str(files.net))


def strategies(
    check: Annotated[
        str | None,
        typer.Option(
            help="Check a strategy of your own, e.g. my_module:MyStrategy, or any of the list.",
            metavar="STRATEGY",
        ),
    ] = None,
) -> None:
    """List the strategies and their parameters, or check one against the rules for all."""
    from harness.report.terminal import print_strategies

    if check is None:
        print_strategies()
        return
    from harness.conformance import check_strategy
    from harness.interaction import load_model
    from harness.scenario import Scenario

    verdicts = check_strategy(check, load_model(Scenario().model.name))
    for verdict in verdicts:
        failed = verdict.problem is not None
        print_line(
            f"FAILED   {verdict.check}: {verdict.problem}"
            if failed
            else f"ok       {verdict.check}"
        )
    if any(verdict.problem is not None for verdict in verdicts):
        raise typer.Exit(1)


def doctor() -> None:
    """Check this installation: versions, SUMO, a network build, one episode."""
    from harness.report.terminal import print_checks

    if not print_checks():
        raise typer.Exit(1)
