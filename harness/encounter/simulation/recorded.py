"""SUMO's FCD output read in parts: XML, packed by gzip or not, CSV or Parquet.

Only vehicles near crosswalks and people on them are kept, so a long file needs little memory.
"""

import gzip
import math
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from harness.core.errors import InputError

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

VEHICLE_COLUMNS = ("time_s", "id", "type", "lane", "pos", "speed")
PERSON_COLUMNS = ("time_s", "id", "edge", "x", "y")
_NUMBERS = ("pos", "speed", "x", "y")
_ALLOWED = "SUMO's --fcd-output or --person-fcd-output: .xml, .xml.gz, .csv, .csv.gz or .parquet"
_PART = 1 << 18
_KINDS = ("vehicle", "person")

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Recorded:
    """The rows that are kept of a recording.

    ``vehicles`` has ``VEHICLE_COLUMNS`` and ``people`` has ``PERSON_COLUMNS``, in the files' order.
    The counts include the records that are left out.
    """

    vehicles: "pd.DataFrame"
    people: "pd.DataFrame"
    vehicle_records: int
    person_records: int
    types: dict[str, str]
    """The type of every vehicle that is kept, by its id."""


@dataclass
class _Kept:
    """The wanted rows of the files read so far."""

    lanes: Set[str]
    edges: Set[str]
    vehicles: list["pd.DataFrame"]
    people: list["pd.DataFrame"]
    vehicle_records: int = 0
    person_records: int = 0


def read_recorded(
    files: list[Path], lanes: Set[str], edges: Set[str], progress: Progress = lambda _d, _p: None
) -> Recorded:
    """Read vehicles on some lanes and people on some edges.

    Args:
        files: FCD files of one simulation.
        lanes: ids of the lanes whose vehicles are kept.
        edges: ids of the edges, crossings and walking areas, whose people are kept.
        progress: called with the bytes read and the bytes of all files.

    Raises:
        InputError: a file is missing, cut off, no FCD, or has no ids, places or speeds.
    """
    import pandas as pd

    kept = _Kept(lanes, edges, [], [])
    sizes = [_size(path) for path in files]
    for number, path in enumerate(files):
        before = sum(sizes[:number])
        for done in _read(path, kept):
            progress(before + done, sum(sizes))
        progress(before + sizes[number], sum(sizes))
    frames = {
        name: pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=list(columns))
        for name, columns, parts in (
            ("vehicles", VEHICLE_COLUMNS, kept.vehicles),
            ("people", PERSON_COLUMNS, kept.people),
        )
    }
    vehicles = frames["vehicles"]
    types = dict(zip(vehicles["id"].tolist(), vehicles["type"].tolist(), strict=True))
    return Recorded(vehicles, frames["people"], kept.vehicle_records, kept.person_records, types)


def _size(path: Path) -> int:
    try:
        if not path.is_file():
            raise InputError(str(path), "no such file", _ALLOWED)
        return path.stat().st_size
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"cannot be read ({error})", _ALLOWED) from None


def _read(path: Path, kept: _Kept) -> Iterator[int]:
    """Read a file in the format of its content; yield the number of bytes read so far."""
    import pyarrow as pa

    name = path.name.removesuffix(".gz")
    try:
        if name.endswith(".parquet"):
            yield from _parquet(path, kept)
        elif name.endswith(".csv"):
            yield from _csv(path, kept)
        elif name.endswith(".xml"):
            yield from _xml(path, kept)
        else:
            raise InputError(str(path), "unknown ending", _ALLOWED)
    except (ET.ParseError, EOFError, zlib.error) as error:
        raise InputError(str(path), f"cut off, or no XML ({error})", _ALLOWED) from None
    except pa.ArrowException as error:
        raise InputError(str(path), f"is damaged ({error})", _ALLOWED) from None
    except OSError as error:
        problem = f"cannot be read ({error.strerror or error})"
        raise InputError(str(path), problem, _ALLOWED) from None


def seconds(text: str) -> float:
    """A time of SUMO in s, written as a number or as days:hours:minutes:seconds.

    >>> seconds("12.50"), seconds("00:01:00.50"), seconds("1:00:00:00")
    (12.5, 60.5, 86400.0)
    """
    total = 0.0
    for part, scale in zip(reversed(text.split(":")), (1, 60, 3600, 86400), strict=False):
        total += float(part) * scale
    return total


def _xml(path: Path, kept: _Kept) -> Iterator[int]:
    with path.open("rb") as raw:
        packed = raw.read(2) == b"\x1f\x8b"
        raw.seek(0)
        source: Any = gzip.GzipFile(fileobj=raw) if packed else raw
        yield from _timesteps(path, source, raw, kept)


def _timesteps(path: Path, source: IO[bytes], raw: IO[bytes], kept: _Kept) -> Iterator[int]:
    vehicles: list[tuple[Any, ...]] = []
    people: list[tuple[Any, ...]] = []
    events = ET.iterparse(source, ("start", "end"))
    root = next(events)[1]
    if root.tag != "fcd-export":
        raise InputError(str(path), f"its first element is <{root.tag[:40]}>", _ALLOWED)
    time_s = math.nan
    try:
        for event, element in events:
            if event == "start":
                if element.tag == "timestep":
                    time_s = seconds(element.attrib["time"])
                continue
            if element.tag == "vehicle":
                kept.vehicle_records += 1
                row = element.attrib
                if row["lane"] in kept.lanes:
                    vehicles.append(
                        (time_s, row["id"], row["type"], row["lane"], row["pos"], row["speed"])
                    )
            elif element.tag == "person":
                kept.person_records += 1
                row = element.attrib
                if row["edge"] in kept.edges:
                    people.append((time_s, row["id"], row["edge"], row["x"], row["y"]))
            elif element.tag == "timestep":
                root.clear()
                if len(vehicles) + len(people) > _PART:
                    _keep(kept, vehicles, people)
                    yield raw.tell()
    except KeyError as error:
        problem = f"a <{element.tag}> has no attribute {error}"
        allowed = "all of --fcd-output.attributes that are written without that option"
        raise InputError(str(path), problem, allowed) from None
    except ValueError as error:
        raise InputError(str(path), f"is damaged ({error})", _ALLOWED) from None
    _keep(kept, vehicles, people, path)


def _keep(
    kept: _Kept,
    vehicles: list[tuple[Any, ...]],
    people: list[tuple[Any, ...]],
    path: Path | None = None,
) -> None:
    """Move rows of text into frames of numbers."""
    import pandas as pd

    for rows, columns, parts in (
        (vehicles, VEHICLE_COLUMNS, kept.vehicles),
        (people, PERSON_COLUMNS, kept.people),
    ):
        if rows:
            frame = pd.DataFrame(rows, columns=list(columns))
            for name in set(_NUMBERS) & set(columns):
                try:
                    frame[name] = frame[name].astype(float)
                except ValueError as error:
                    raise InputError(str(path), f"is damaged ({error})", _ALLOWED) from None
            parts.append(frame)
            rows.clear()


def _csv(path: Path, kept: _Kept) -> Iterator[int]:
    import pyarrow as pa
    from pyarrow import csv

    with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
        first = file.readline(1 << 16)
    separator = ";" if b";" in first else ","
    texts = ("id", "type", "lane", "edge")
    types = {f"{kind}_{name}": pa.string() for kind in _KINDS for name in texts}
    types["timestep_time"] = pa.string()
    with csv.open_csv(
        path,
        read_options=csv.ReadOptions(block_size=1 << 24),
        parse_options=csv.ParseOptions(delimiter=separator),
        convert_options=csv.ConvertOptions(column_types=types),
    ) as reader:
        _check_columns(path, reader.schema.names)
        read = 0
        for batch in reader:
            _keep_batch(path, pa.table(batch), kept)
            read += batch.nbytes
            yield min(read, path.stat().st_size)


def _parquet(path: Path, kept: _Kept) -> Iterator[int]:
    import pyarrow as pa
    from pyarrow import parquet

    with parquet.ParquetFile(path) as file:
        _check_columns(path, file.schema_arrow.names)
        rows = max(file.metadata.num_rows, 1)
        done = 0
        for batch in file.iter_batches(batch_size=_PART):
            _keep_batch(path, pa.table(batch), kept)
            done += len(batch)
            yield int(path.stat().st_size * done / rows)


def _check_columns(path: Path, names: list[str]) -> None:
    if "timestep_time" not in names:
        raise InputError(str(path), "has no column timestep_time", _ALLOWED)


def _keep_batch(path: Path, table: "pa.Table", kept: _Kept) -> None:
    """Keep the wanted rows of a table; rows with a lane are vehicles, the others people."""
    import pyarrow as pa
    from pyarrow import compute

    for kind in _KINDS:
        names = set(table.column_names)
        if f"{kind}_id" not in names:
            continue
        # A time without vehicles has a row without an id.
        ids = compute.fill_null(table[f"{kind}_id"].cast(pa.string()), "")
        there = table.filter(compute.not_equal(ids, ""))
        if not len(there):
            continue
        missing = {f"{kind}_{name}" for name in ("x", "y", "speed", "pos")} - names
        if missing or not names & {f"{kind}_lane", f"{kind}_edge"}:
            problem = f"has no column {min(missing or {f'{kind}_lane'})}"
            allowed = "all of --fcd-output.attributes that are written without that option"
            raise InputError(str(path), problem, allowed)
        empty = pa.nulls(len(there), pa.string())
        columns = {
            name: there[f"{kind}_{name}"].cast(pa.string())
            if f"{kind}_{name}" in names
            else pa.chunked_array([empty])
            for name in ("id", "type", "lane", "edge")
        }
        lane = compute.fill_null(columns["lane"], "")
        walks = compute.equal(lane, "")
        people = int(compute.sum(walks).as_py() or 0)
        kept.person_records += people
        kept.vehicle_records += len(there) - people
        on_lane = compute.is_in(lane, pa.array(sorted(kept.lanes), pa.string()))
        on_edge = compute.and_(
            walks, compute.is_in(columns["edge"], pa.array(sorted(kept.edges), pa.string()))
        )
        for mask, wanted, parts in (
            (on_lane, VEHICLE_COLUMNS, kept.vehicles),
            (on_edge, PERSON_COLUMNS, kept.people),
        ):
            _append(path, there, {**columns, "lane": lane}, mask, kind, wanted, parts)


def _append(
    path: Path,
    table: "pa.Table",
    columns: dict[str, Any],
    mask: Any,
    kind: str,
    wanted: tuple[str, ...],
    parts: list["pd.DataFrame"],
) -> None:
    import pandas as pd
    import pyarrow as pa

    rows = table.filter(mask)
    if not len(rows):
        return
    frame = {}
    try:
        for name in wanted:
            if name == "time_s":
                times = rows["timestep_time"].to_pylist()
                frame[name] = [seconds(each) if isinstance(each, str) else each for each in times]
            elif name in columns:
                frame[name] = columns[name].filter(mask).to_pylist()
            else:
                frame[name] = rows[f"{kind}_{name}"].cast(pa.float64()).to_numpy()
    except (ValueError, TypeError) as error:
        raise InputError(str(path), f"is damaged ({error})", _ALLOWED) from None
    parts.append(pd.DataFrame(frame)[list(wanted)])
