"""The folder of conflicts: ``passages.parquet``, ``crosswalks.csv`` and ``conflicts.json``."""

import json
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from harness.core.errors import InputError, unknown_name
from harness.core.files import cannot_write, write_csv, write_file
from harness.core.versions import versions_of_runs
from harness.measures.catalogue import COLUMNS, MEASURES
from harness.old.studies.conflicts.records import ConflictFindings
from harness.old.studies.runs.worst import RANKED, badness, least

PASSAGES, CROSSWALKS, DOCUMENT = "passages.parquet", "crosswalks.csv", "conflicts.json"

Row = dict[str, Any]


def check_new(folder: Path) -> None:
    """Refuse a folder that exists and is not empty.

    Raises:
        InputError: the folder contains files, or the path is a file.
    """
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"--out {folder}", "exists and is not empty", "a new or empty folder")
    except OSError as error:
        raise cannot_write(folder, error) from None


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder, which is renamed to ``folder`` if the block succeeds."""
    beside = folder.with_name(f".{folder.name}.partial")
    try:
        shutil.rmtree(beside, ignore_errors=True)
        beside.mkdir(parents=True)
        yield beside
        if folder.is_dir():
            folder.rmdir()
        beside.replace(folder)
    except OSError as error:
        raise cannot_write(folder, error) from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def write_tables(findings: ConflictFindings, folder: Path) -> list[Path]:
    """Write the tables and the document, and return their paths in the folder."""
    import pyarrow as pa
    from pyarrow import parquet

    rows = [each.row() for each in findings.passages]
    parquet.write_table(pa.Table.from_pylist(rows, schema=_schema()), folder / PASSAGES)
    write_csv(folder / CROSSWALKS, [each.row(findings.thresholds) for each in findings.crosswalks])
    text = json.dumps(document_of(findings), indent=1, ensure_ascii=False)
    write_file(folder / DOCUMENT, text.encode())
    return [Path(PASSAGES), Path(CROSSWALKS), Path(DOCUMENT)]


def _schema() -> Any:
    """Return the schema of ``passages.parquet``."""
    import pyarrow as pa

    texts = ("crosswalk", "approach", "vehicle", "type")
    numbers = ("begin_s", "edge_s", "range_m", "length_m", "width_m", "speed_mps")
    kinds = {float: pa.float64(), int: pa.int64(), bool: pa.bool_()}
    return pa.schema(
        [
            *((name, pa.string()) for name in texts),
            *((name, pa.float64()) for name in numbers),
            ("people", pa.int64()),
            *((name, pa.string()) for name in ("ending", "contact", "contact_person")),
            ("contact_s", pa.float64()),
            *((measure.column, kinds[measure.kind]) for measure in MEASURES),
        ]
    )


def document_of(findings: ConflictFindings) -> dict[str, Any]:
    """Return the document of ``--json``: inputs, how they were read, and crosswalks' numbers."""
    return {
        "files": [str(path) for path in findings.files],
        "net": str(findings.net),
        "step_s": findings.step_s,
        "motion": "places" if findings.by_places else findings.motion,
        "rounding_m": findings.rounding_m,
        "geo": findings.geo,
        "vehicle_records": findings.vehicle_records,
        "person_records": findings.person_records,
        "thresholds": findings.thresholds.model_dump(),
        "undefined_types": dict(findings.undefined_types),
        "unusable": dict(findings.unusable),
        "crosswalks": [each.row(findings.thresholds) for each in findings.crosswalks],
        "versions": versions_of_runs(),
    }


def is_conflicts(folder: Path) -> bool:
    """Return whether a folder contains the conflicts of a recording."""
    return (folder / DOCUMENT).is_file()


def worst_passages(folder: Path, by: str, most: int) -> list[Row]:
    """Return the worst passages of a folder; see ``worst_rows``."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        rows = parquet.read_table(folder / PASSAGES).to_pylist()
    except (OSError, pa.ArrowException) as error:
        raise InputError(str(folder / PASSAGES), f"cannot be read ({error})") from None
    return worst_rows(rows, by, most)


def worst_rows(rows: Sequence[Row], by: str, most: int) -> list[Row]:
    """Return the worst passages by a measure, ranked as ``harness worst`` ranks episodes.

    Raises:
        InputError: there is no such measure, it has no bad direction, or ``most`` is below 1.
    """
    if by in COLUMNS and by not in RANKED:
        raise InputError(
            "--by", f"neither small nor large values of {by} are bad", ", ".join(RANKED)
        )
    if by not in RANKED:
        raise unknown_name("--by", "measure", by, RANKED)
    if most < 1:
        raise InputError("-n", f"{most}", "1 or more")
    ranked = [(badness(by, row[by], row["ending"], row["contact_speed_mps"]), row) for row in rows]
    bad = [each for each in ranked if each[0] > least(by)]
    bad.sort(key=lambda each: (-each[0], each[1]["begin_s"], each[1]["vehicle"]))
    return [row for _, row in bad[:most]]
