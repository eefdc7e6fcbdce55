"""``harness crossings``: lists the crosswalks of a network or map, and writes a scenario."""

import gc
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.interruption import unwinding
from harness.cli.options import JsonOption
from harness.cli.output import print_json, print_line, say
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
            help="A SUMO network (.net.xml), or an OpenStreetMap extract (.osm, .osm.gz), "
            "which the command converts first."
        ),
    ],
    write: Annotated[
        Path | None,
        typer.Option(help="Write a scenario file for one crossing.", metavar="SCENARIO.toml"),
    ] = None,
    edge: Annotated[str | None, typer.Option(help="Edge of the crossing for --write.")] = None,
    ignore_signal: Annotated[
        bool,
        typer.Option(
            "--ignore-signal",
            help="Accept crossings with a traffic light; it stays green for everybody.",
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for a converted map; default: next to the map, with its name."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the crosswalks of a network or a map, usable ones first."""
    from harness.engine.network.crossings import list_crossings, scenario_text
    from harness.engine.network.osm import convert, is_osm
    from harness.report.screens.tables import counted
    from harness.site import read_network

    if (write is None) != (edge is None):
        option, missing = ("--write", "--edge") if edge is None else ("--edge", "--write")
        raise InputError(option, f"needs {missing}", f"both, or neither to list {file}")
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
        listed = {row.edge: row for row in rows}
        row = listed.get(edge or "")
        if row is None:
            near = nearest_name(edge or "", listed)
            some = ", ".join([*listed][:_SHOWN]) + ", …" * (len(rows) > _SHOWN)
            raise InputError("--edge", f"no crossing {edge!r}", some or "there are none", near)
        if row.problem is not None:
            raise InputError(f"--edge {edge}", row.problem)
        _write_new(write, scenario_text(_seen_from(net, write.parent), row))
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
            print_line(_line(row))


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


def _seen_from(net: Path, folder: Path) -> Path:
    """Return a network's path, relative to the folder of the scenario file if it lies inside."""
    whole = net.absolute()
    here = folder.absolute()
    return whole.relative_to(here) if whole.is_relative_to(here) else whole


def _write_new(path: Path, text: str) -> None:
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError("--write", f"{path} exists", "a new file") from None
    except OSError as error:
        raise InputError("--write", f"{path} cannot be written ({error.strerror})") from None
