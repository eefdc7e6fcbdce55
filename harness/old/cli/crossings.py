"""``harness crossings``: lists crosswalks, and writes a scenario with ``[simulation]``."""

import gc
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.core.errors import InputError, one_line
from harness.old.cli.options import JsonOption
from harness.old.cli.output import print_json, print_line, print_wrapped, say

if TYPE_CHECKING:
    from harness.engine.network.crossings import CrossingRow

_NONE_IN_NETWORK = (
    "the network has no crossing: netconvert -s THIS --sidewalks.guess --crossings.guess -o NEW "
    "adds crossings at junctions with sidewalks; a mid-block crossing needs a node there, and "
    '-x FILE with <crossing node="…" edges="…"/>'
)


def crossings(
    file: Annotated[
        Path,
        typer.Argument(help="A SUMO configuration (.sumocfg), or a SUMO network (.net.xml)."),
    ],
    write: Annotated[
        Path | None,
        typer.Option(
            help="Write a scenario file for the crossings of --edge.", metavar="SCENARIO.toml"
        ),
    ] = None,
    edge: Annotated[
        list[str] | None,
        typer.Option(help="Edge of a crossing for --write. Repeatable.", metavar="CROSSING"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the crosswalks of a SUMO scenario or a network.

    For a configuration (.sumocfg) the command simulates the scenario once, untouched, and counts
    vehicles and people per hour at every crosswalk; usable ones come first. With --write it
    simulates nothing, and the file has [simulation]: strategies drive in your own scenario, at the
    crosswalks of --edge.

    For a network it lists each crosswalk's length, width, lanes each way and bearing, which are
    keys of [crossing] in a scenario of encounters.
    """
    from harness.encounter.simulation.listing import is_configuration

    if (write is None) != (not edge):
        option, missing = ("--write", "--edge") if not edge else ("--edge", "--write")
        raise InputError(option, f"needs {missing}", f"both, or neither to list {file}")
    if is_configuration(file):
        from harness.old.cli.own_crossings import of_configuration

        of_configuration(file, write, edge or [], as_json=as_json)
    elif write is not None:
        raise InputError("--write", "is of SUMO configurations", f"{file} without it")
    else:
        _list(file, as_json=as_json)


def _list(net: Path, *, as_json: bool) -> None:
    from harness.engine.network.crossings import list_crossings
    from harness.old.report.screens.tables import counted
    from harness.site import read_network

    # Millions of records stay alive: searching them for garbage would double the time.
    gc.disable()
    rows = list_crossings(read_network(net))
    gc.enable()
    if not rows:
        say(f"note: {_NONE_IN_NETWORK}")
    if as_json:
        print_json({"net": str(net), "crossings": [asdict(row) for row in rows]})
        return
    print_line(f"{net}: {counted(len(rows), 'crossing')}")
    for row in rows:
        print_wrapped(_line(row))


def _line(row: "CrossingRow") -> str:
    """Describe a crossing on one line; names in a network may contain any character."""
    parts = [row.edge, " / ".join(row.streets), row.problem or ""]
    if row.problem is None:
        parts[2:] = [
            f"{row.length_m:.2f} m x {row.width_m:.2f} m",
            f"{row.lanes} + {row.oncoming_lanes} lanes",
            f"bearing {row.bearing_deg:.1f}°",
        ]
    return one_line("; ".join(parts))
