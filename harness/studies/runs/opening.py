"""Opens finished and unfinished run folders, and checks them against their manifest."""

from pathlib import Path

from harness.core.errors import InputError
from harness.scenario import study_from
from harness.store.kinds import kind_of_study
from harness.store.reading import MANIFEST, count_rows, read_manifest, unfinished
from harness.studies.runs.run_data import RunData
from harness.studies.runs.run_tables import readable_shards


def load_run(path: str | Path) -> RunData:
    """Open a run folder, finished or not.

    Args:
        path: the folder.

    Returns:
        The run's content; each table is read on first use.

    Raises:
        InputError: the folder is not a run folder, has another format version, or is incomplete
            or damaged.
    """
    folder = Path(path)
    document = read_manifest(folder)
    study = study_from(document, str(folder / MANIFEST))
    counts = document["counts"]
    finished = counts is not None
    if not finished:
        shards = readable_shards(folder, study)
        if read_manifest(folder)["counts"] is not None:
            # The run finished while its shards were read, and the shards are gone.
            return load_run(folder)
        return RunData(folder, document, study, finished=False, shards=shards)
    expected = {"cells": len(study.cells), **counts}
    kind = kind_of_study(study)
    names = [*kind.derived, *kind.tables(traces=document["traces"])]
    for name in ("cells", *names):
        count = count_rows(folder, name)
        rows = expected.get(name, count)
        if count != rows:
            where = str(folder / f"{name}.parquet")
            raise InputError(where, f"{count} rows", f"{rows}, as the manifest says")
    return RunData(folder, document, study, finished=True)


def finished_run(run: RunData | str | Path) -> RunData:
    """Open the folder of a finished run.  A run that is already open is returned unchanged.

    Raises:
        InputError: see ``load_run``; or the run was interrupted or still continues.
    """
    data = run if isinstance(run, RunData) else load_run(run)
    if not data.finished:
        raise unfinished(data.path)
    return data
