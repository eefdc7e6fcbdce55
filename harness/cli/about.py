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


def strategies() -> None:
    """List the strategies and their parameters."""
    from harness.report.terminal import print_strategies

    print_strategies()


def doctor() -> None:
    """Check this installation: versions, SUMO, a network build, one episode."""
    from harness.report.terminal import print_checks

    if not print_checks():
        raise typer.Exit(1)
