"""``harness crossings``: lists crosswalks, and writes a scenario."""

import gc
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.interruption import unwinding
from harness.cli.options import JsonOption
from harness.cli.output import print_json, print_line, print_wrapped, say
from harness.cli.written import seen_from, write_new
from harness.core.errors import InputError, nearest_name, one_line

if TYPE_CHECKING:
    from harness.engine.network.crossings import CrossingRow

_NONE_IN_NETWORK = (
    "the network has no crossing: netconvert -s THIS --sidewalks.guess --crossings.guess -o NEW "
    "adds crossings at junctions with sidewalks; a mid-block crossing needs a node there, and "
    '-x FILE with <crossing node="…" edges="…"/>'
)
_NONE_IN_MAP = (
    "the converted map has no crossing: it needs a node with highway=crossing on a road for cars "
    "with sidewalks"
)

_SHOWN = 5
"""Number of crossings that a refusal lists."""


def crossings(
    file: Annotated[
        Path,
        typer.Argument(
            help="A SUMO configuration (.sumocfg), a SUMO network (.net.xml), or an OpenStreetMap "
            "extract (.osm, .osm.gz), which the command converts first."
        ),
    ],
    write: Annotated[
        Path | None,
        typer.Option(
            help="Write a scenario file for the crossings of --edge.", metavar="SCENARIO.toml"
        ),
    ] = None,
    edge: Annotated[
        list[str] | None,
        typer.Option(
            help="Edge of the crossing for --write. Repeatable for a configuration.",
            metavar="CROSSING",
        ),
    ] = None,
    ignore_signal: Annotated[
        bool,
        typer.Option(
            "--ignore-signal",
            help="Accept crossings of a network or map with a traffic light; it stays green for "
            "everybody.",
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for a converted map; default: next to the map, with its name."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the crosswalks of a SUMO scenario, a network or a map.

    Usable ones come first.

    For a configuration (.sumocfg) the command simulates the scenario once, untouched, and counts
    vehicles and people per hour at every crosswalk. With --write it simulates nothing, and the
    file has [simulation]: strategies drive in your own scenario, at the crosswalks of --edge.

    For a network or a map the file has [crossing]: the harness sends its own vehicles over one
    crosswalk.
    """
    from harness.episode.simulation.listing import is_configuration

    if (write is None) != (not edge):
        option, missing = ("--write", "--edge") if not edge else ("--edge", "--write")
        raise InputError(option, f"needs {missing}", f"both, or neither to list {file}")
    if not is_configuration(file):
        _of_network(file, write, edge or [], out, ignore_signal=ignore_signal, as_json=as_json)
        return
    from harness.cli.own_crossings import of_configuration

    for option, given in (("--out", out is not None), ("--ignore-signal", ignore_signal)):
        if given:
            raise InputError(option, "is of networks and maps", f"{file} without it")
    of_configuration(file, write, edge or [], as_json=as_json)


def _of_network(
    file: Path,
    write: Path | None,
    edges: list[str],
    out: Path | None,
    *,
    ignore_signal: bool,
    as_json: bool,
) -> None:
    """List the crossings of a network or a map, or write a scenario for one of them."""
    from harness.engine.network.crossings import list_crossings, scenario_text
    from harness.engine.network.osm import convert, is_osm
    from harness.report.screens.tables import counted
    from harness.site import read_network

    if len(edges) > 1:
        problem = f"is given {len(edges)} times"
        raise InputError("--edge", problem, "one crossing of a network; several of a .sumocfg")
    net, remarks = file, tuple[str, ...]()
    if is_osm(file):
        with unwinding():
            converted = convert(file, out or file.with_name(file.name.partition(".osm")[0]))
        net, remarks = converted.net, converted.remarks
    elif out is not None:
        raise InputError("--out", f"{file} needs no conversion", "an OpenStreetMap extract")
    # Millions of records stay alive: searching them for garbage would double the time.
    gc.disable()
    rows = list_crossings(read_network(net), ignore_signal=ignore_signal)
    gc.enable()
    if not rows:
        remarks += (_NONE_IN_MAP if is_osm(file) else _NONE_IN_NETWORK,)
    if write is not None:
        row = _chosen(rows, edges[0])
        write_new(write, scenario_text(seen_from(net, write.parent), row))
    for remark in remarks:
        say(f"note: {remark}")
    if as_json:
        documents = [{**asdict(row), "usable": row.usable} for row in rows]
        print_json({"net": str(net), "remarks": list(remarks), "crossings": documents})
    elif write is not None:
        print_line(str(write))
    else:
        usable = sum(row.usable for row in rows)
        print_line(f"{net}: {counted(len(rows), 'crossing')}, {usable} usable")
        for row in rows:
            print_wrapped(_line(row))


def _chosen(rows: list["CrossingRow"], edge: str) -> "CrossingRow":
    """The usable crossing with this edge."""
    listed = {row.edge: row for row in rows}
    row = listed.get(edge)
    if row is None:
        some = ", ".join([*listed][:_SHOWN]) + ", …" * (len(rows) > _SHOWN)
        near = nearest_name(edge, listed)
        raise InputError("--edge", f"no crossing {edge!r}", some or "there are none", near)
    if row.problem is not None:
        raise InputError(f"--edge {edge}", row.problem)
    return row


def _line(row: "CrossingRow") -> str:
    """Describe a crossing on one line; names in a network may contain any character."""
    parts = [row.edge, " / ".join(row.streets)]
    if row.longitude_deg is not None:
        parts.append(f"{row.latitude_deg:.6f}°, {row.longitude_deg:.6f}°")
    if row.length_m is not None:
        parts += [
            f"{row.lanes} + {row.oncoming_lanes} lanes",
            f"{row.length_m:.2f} m x {row.width_m:.2f} m",
            f"limit {row.speed_limit_mps:.4g} m/s",
            "priority" if row.pedestrian_priority else "no priority",
            "no signal" if row.signal is None else f"signal {row.signal}",
            f"straight for {row.straight_m:.1f} m",
            *(f"passes {other}" for other in row.passed),
        ]
    parts.append("usable" if row.problem is None else f"not usable: {row.problem}")
    return one_line("; ".join(parts))
