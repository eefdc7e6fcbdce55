"""The command ``crossings``."""

import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from harness.cli import options
from harness.cli.interruption import unwinding
from harness.cli.output import progress_bar, say, show_rows
from harness.core.errors import InputError

if TYPE_CHECKING:
    from harness.simulation.listing import CrosswalkRow

_NO_CROSSWALK = (
    "note: the network has no crossing: netconvert -s THIS --sidewalks.guess --crossings.guess "
    "-o NEW adds crossings at junctions with sidewalks"
)


def crossings(
    file: options.TownArgument,
    write: options.WriteOption = None,
    edge: options.EdgeOption = None,
    every: options.AllOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """List the crosswalks of a SUMO configuration or a network.

    A configuration is simulated once, untouched, to count who passes per hour; usable crosswalks
    with most vehicles and people come first. --write simulates nothing: strategies drive in your
    configuration, at the crosswalks of --edge.
    """
    from harness.engine.starting import scratch_prefix
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
    prefix = scratch_prefix(os.getpid())
    with (
        unwinding(),
        TemporaryDirectory(prefix=prefix) as scratch,
        progress_bar(as_json, "simulated s") as tell,
    ):
        rows = crossings_of(file, Path(scratch), lambda now_s, end_s: tell(now_s, end_s))
    if not rows:
        say(_NO_CROSSWALK)
    shown = rows if every or as_json else [row for row in rows if row.usable]
    left = len(rows) - len(shown)
    title = f"{file}: {len(rows)} crosswalks, {sum(row.usable for row in rows)} usable"
    closing = [f"--all lists the other {left}, with the reasons"] if left else []
    show_rows("crossings", [*map(_record, shown)], False, as_json, title=title, closing=closing)


def _record(row: "CrosswalkRow") -> dict[str, Any]:
    """A crosswalk's columns: vehicles and people per hour, or of a network its connections."""
    many: dict[str, Any] = {}
    if row.vehicles_per_hour is not None:
        counts = row.vehicles_per_hour
        many = {
            "vehicles/h": round(sum(counts.values())),
            "people/h": round(row.people_per_hour or 0),
        }
    else:
        counts = row.connections
    turning = {name: round(counts.get(name, 0)) for name in ("straight", "left", "right", "turn")}
    return {
        "crosswalk": row.crosswalk,
        "roads": " / ".join(row.roads),
        **many,
        **turning,
        "priority": "people" if row.prioritized else "vehicles",
        "length, m": round(row.length_m, 1),
        "limit, m/s": None if row.limit_mps is None else round(row.limit_mps, 1),
        **({} if row.refused is None else {"not usable": row.refused}),
    }


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
