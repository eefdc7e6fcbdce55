"""The tables of a run folder in another format."""

from pathlib import Path

from harness.files import write_file
from harness.results.reading import read_finished_manifest, read_table


def export_csv(folder: Path) -> list[Path]:
    """Write every table of a run folder as CSV beside it.

    Raises:
        InputError: no finished run, or a table cannot be read.
    """
    read_finished_manifest(folder)
    written = []
    for source in sorted(folder.glob("*.parquet")):
        table = read_table(folder, source.stem)
        target = source.with_suffix(".csv")
        write_file(target, table.to_pandas().to_csv(index=False, lineterminator="\n").encode())
        written.append(target)
    return written
