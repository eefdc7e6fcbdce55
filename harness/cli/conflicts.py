"""The command ``conflicts``."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from harness.cli import options
from harness.cli.output import show


def conflicts(
    fcd: Annotated[Path, Argument(metavar="FCD", help="SUMO's --fcd-output, .gz too.")],
    net: Annotated[Path, Option(help="The simulation's network (.net.xml).")],
    person_fcd: Annotated[Path | None, Option(help="SUMO's --person-fcd-output.")] = None,
    types: Annotated[list[Path] | None, Option(help="A file with its vTypes. Repeatable.")] = None,
    edge: options.EdgeOption = None,
    settings: options.SetOption = None,
    table: options.TableOption = None,
    full: options.FullOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Measure conflicts of people and vehicles in a SUMO output; nothing is simulated."""
    from harness.core.files import write_csv
    from harness.scenario.file import set_thresholds
    from harness.studies.conflicts import conflicts as measured

    thresholds = set_thresholds(options.settings_of(settings), "conflicts")
    files = [fcd] if person_fcd is None else [fcd, person_fcd]
    result, rows = measured(files, net, types or (), edge or (), thresholds)
    if table is not None:
        write_csv(table, rows)
    show(result, full, False, as_json)
