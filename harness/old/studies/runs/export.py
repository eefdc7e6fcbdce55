"""The tables of a run folder in another format."""

from pathlib import Path

from harness.core.files import write_file
from harness.old.store.reading import read_table
from harness.old.store.summary_table import SUMMARY
from harness.old.studies.runs.opening import load_run


def export_csv(folder: Path) -> list[Path]:
    """Write every table of a run folder as CSV next to it.  After an error none is written.

    Raises:
        InputError: the run is not finished, or a table is missing or cannot be read.
    """
    load_run(folder)
    written = []
    try:
        # A run writes summary.csv itself.
        for source in sorted({*folder.glob("*.parquet")} - {folder / SUMMARY}):
            table = read_table(folder, source.stem)
            target = source.with_suffix(".csv")
            write_file(target, table.to_pandas().to_csv(index=False, lineterminator="\n").encode())
            written.append(target)
    except BaseException:
        for target in written:
            target.unlink(missing_ok=True)
        raise
    return written
