"""The command ``crossings``."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.output import say, show_rows
from harness.core.errors import InputError

_NO_CROSSWALK = (
    "note: the network has no crossing: netconvert -s THIS --sidewalks.guess --crossings.guess "
    "-o NEW adds crossings at junctions with sidewalks"
)


def crossings(
    file: Annotated[Path, Argument(help="A SUMO configuration (.sumocfg) or network.")],
    write: options.WriteOption = None,
    edge: options.EdgeOption = None,
    every: Annotated[bool, Option("--all", help="List those that are not usable, too.")] = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the crosswalks of a SUMO configuration or a network.

    A configuration is simulated once, untouched, to count who passes per hour; usable crosswalks
    with most vehicles and people come first. --write simulates nothing: strategies drive in your
    configuration, at the crosswalks of --edge.
    """
    from harness.engine.installation import scratch_folder
    from harness.simulation.listing import crossings_of, is_configuration, scenario_text

    if (write is None) != (not edge):
        option, missing = ("--write", "--edge") if not edge else ("--edge", "--write")
        raise InputError(option, f"needs {missing}", f"both, or neither to list {file}")
    if write is not None:
        if not is_configuration(file):
            raise InputError("--write", "is of SUMO configurations", f"{file} without it")
        with unwinding():
            _write_new(write, scenario_text(file, edge or [], _seen_from(file, write.parent)))
        show_rows("crossings", [{"scenario": str(write)}], not as_json, as_json)
        return
    with unwinding(), scratch_folder() as scratch:
        rows = crossings_of(file, Path(scratch))
    if not rows:
        say(_NO_CROSSWALK)
    usable = [row for row in rows if row["not usable"] is None]
    known = [{name: row[name] for name in row if name != "not usable"} for row in usable]
    shown = rows if every or as_json else known
    left = len(rows) - len(shown)
    title = f"{file}: {len(rows)} crosswalks, {len(usable)} usable"
    closing = [f"--all lists the other {left}, with the reasons"] if left else []
    show_rows("crossings", shown, False, as_json, title=title, closing=closing)


def _seen_from(file: Path, folder: Path) -> Path:
    """A file's path, relative to the folder of the scenario file if it lies inside."""
    whole, here = file.absolute(), folder.absolute()
    return whole.relative_to(here) if whole.is_relative_to(here) else whole


def _write_new(path: Path, text: str) -> None:
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError("--write", f"{path} exists", "a new file") from None
    except OSError as error:
        raise InputError("--write", f"{path} cannot be written ({error.strerror})") from None
