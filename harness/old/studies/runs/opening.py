"""Opens run folders, and checks them against their manifest."""

from pathlib import Path

from harness.core.errors import InputError
from harness.old.store.kinds import kind_of_study
from harness.old.store.reading import MANIFEST, count_rows, read_finished_manifest
from harness.old.studies.runs.run_data import RunData
from harness.scenario import study_from


def load_run(path: str | Path) -> RunData:
    """Open a finished run folder.

    Args:
        path: the folder.

    Returns:
        The run's content; each table is read on first use.

    Raises:
        InputError: the folder is not a run folder, is not finished, has another format version, or
            is incomplete or damaged.
    """
    folder = Path(path)
    document = read_finished_manifest(folder)
    study = study_from(document, str(folder / MANIFEST))
    expected = {"cells": len(study.cells), **document["counts"]}
    kind = kind_of_study(study)
    names = [*kind.derived, *kind.tables(traces=document["traces"])]
    for name in ("cells", *names):
        count = count_rows(folder, name)
        rows = expected.get(name, count)
        if count != rows:
            where = str(folder / f"{name}.parquet")
            raise InputError(where, f"{count} rows", f"{rows}, as the manifest says")
    return RunData(folder, document, study)


def opened_run(run: RunData | str | Path) -> RunData:
    """Open a folder; a run that is already open is returned unchanged.

    Raises:
        InputError: see ``load_run``.
    """
    return run if isinstance(run, RunData) else load_run(run)
