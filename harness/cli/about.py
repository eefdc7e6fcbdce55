"""Commands about networks and strategies: ``network, crossings, strategies``."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Exit, Option

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.output import say, show_rows
from harness.core.errors import InputError
from harness.core.files import seen_from, write_new

_HEADINGS = {
    "vehicles_per_hour": "vehicles/h",
    "people_per_hour": "people/h",
    "length_m": "length, m",
    "limit_mps": "limit, m/s",
    "refused": "not usable",
}
"""Headings of crosswalks that differ from the names."""

_NO_CROSSWALK = (
    "note: the network has no crossing: netconvert -s THIS --sidewalks.guess --crossings.guess "
    "-o NEW adds crossings at junctions with sidewalks"
)


def network(
    scenario: options.ScenarioArgument,
    out: Annotated[Path, Option(help="Folder for the sources and the network.")],
    settings: options.SetOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Build a scenario's SUMO network and its plain-XML sources."""
    from harness.scenario import read_scenario_file

    file = read_scenario_file(scenario, options.settings_of(settings))
    crossing = file.scenario().crossing
    from harness.engine.network import build_network

    with unwinding():
        net = build_network(crossing, out, file.name)
    show_rows("network", [{"file": str(net)}], quiet=True, as_json=as_json)


def crossings(
    file: Annotated[Path, Argument(help="A SUMO configuration (.sumocfg).")],
    write: options.WriteOption = None,
    edges: options.EdgeOption = None,
    every: Annotated[bool, Option("--all", help="Also list unusable crosswalks.")] = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the crosswalks of a SUMO configuration.

    One simulation counts the vehicles and people per hour at each crosswalk; usable crosswalks with
    most of them come first. --write simulates nothing: it writes a scenario in which strategies
    drive at the crosswalks of --edge.
    """
    from harness.engine.installation import scratch_folder
    from harness.simulation.listing import crossings_of, scenario_text

    if (write is None) != (not edges):
        option, missing = ("--write", "--edge") if not edges else ("--edge", "--write")
        raise InputError(option, f"needs {missing}", f"both, or neither to list {file}")
    if write is not None:
        with unwinding():
            write_new(write, scenario_text(file, edges or [], seen_from(file, write.parent)))
        show_rows("crossings", [{"scenario": str(write)}], quiet=True, as_json=as_json)
        return
    with unwinding(), scratch_folder() as scratch:
        usable, refused = crossings_of(file, Path(scratch))
    if not usable and not refused:
        say(_NO_CROSSWALK)
    whole, left = every or as_json, len(refused)
    shown = [row._asdict() for row in (usable + refused if whole else usable)]
    title = f"{file}: {len(usable) + left} crosswalks, {len(usable)} usable"
    closing = [f"--all lists the other {left}, with the reasons"] if left and not whole else []
    show_rows("crossings", shown, as_json=as_json, closing=closing, title=title, headings=_HEADINGS)


def strategies(
    strategy: options.CheckOption = None,
    scenario: options.ScenarioOption = "cctc",
    settings: options.SetOption = None,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """List strategies with their parameters, or check one (--check)."""
    from harness.strategies.parameters import KNOWS_THE_MODEL, knows_the_model, rows_of
    from harness.strategies.registry import STRATEGIES, find_strategy

    if strategy is None:
        if settings or scenario != "cctc":
            option = "--set" if settings else "--scenario"
            raise InputError(option, "needs --check", f"--check STRATEGY with {option}")
        listed = [row for each in STRATEGIES.items() for row in rows_of(*each)]
        closing = ["harness strategies --check my_module:MyStrategy checks your own one."]
        show_rows("strategies", listed, quiet=quiet, as_json=as_json, closing=closing)
        return
    from harness.studies.checks import check_strategy

    verdicts = check_strategy(strategy, None, scenario, options.settings_of(settings))
    rows = [each.row for each in verdicts]
    title = f"{strategy}: the rules that make results repeatable"
    closing = [KNOWS_THE_MODEL] if knows_the_model(find_strategy(strategy, "strategy")) else []
    show_rows("strategies", rows, quiet=quiet, as_json=as_json, title=title, closing=closing)
    if any(each.problem for each in verdicts):
        raise Exit(1)
