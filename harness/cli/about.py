"""Commands about the installation and its parts: ``network``, ``strategies``."""

from pathlib import Path
from typing import Annotated

from typer import Exit, Option

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.options import settings_of
from harness.cli.output import show_rows
from harness.core.errors import InputError


def network(
    scenario: options.ScenarioArgument,
    out: Annotated[Path, Option(help="Folder for the sources and the network.")],
    settings: options.SetOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Build the scenario's SUMO network and its plain-XML sources."""
    from harness.scenario import read_scenario_file

    file = read_scenario_file(scenario, settings_of(settings))
    crossing = file.scenario().crossing
    from harness.engine.network import build_network

    with unwinding():
        net = build_network(crossing, out, file.name)
    show_rows("network", [{"file": str(net)}], True, as_json)


def strategies(
    check: options.CheckOption = None,
    scenario: options.ScenarioOption = "cctc",
    settings: options.SetOption = None,
    quiet: options.QuietOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the strategies and their parameters; --check STRATEGY checks one."""
    if check is None:
        if settings:
            raise InputError("--set", "needs --check", "--check STRATEGY --set KEY=VALUE")
        from harness.strategies.registry import listing

        closing = ["harness strategies --check my_module:MyStrategy checks your own one."]
        show_rows("strategies", listing(), quiet, as_json, closing=closing)
        return
    from harness.strategies.parameters import knows_the_model
    from harness.strategies.registry import KNOWS_THE_MODEL, find_strategy
    from harness.studies.checks import check_strategy

    verdicts = check_strategy(check, None, scenario, settings_of(settings))
    rows = [
        {
            "rule": each.rule,
            "kept": "yes" if each.problem is None else "no" if each.checked else "-",
            "problem": each.problem or "",
            "shown": "" if each.observation is None else str(each.observation),
            "why": each.why,
        }
        for each in verdicts
    ]
    title = f"{check}: the rules that make results repeatable"
    closing = [KNOWS_THE_MODEL] if knows_the_model(find_strategy(check, "--check")) else []
    show_rows("strategies", rows, quiet, as_json, title=title, closing=closing)
    if any(each.problem for each in verdicts):
        raise Exit(1)
