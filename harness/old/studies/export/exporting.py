"""Exports one arm of a pair of a finished run, or of a risk's likeliest events."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import pyarrow.compute as pc

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.core.files import cannot_write, write_file
from harness.engine.network.opendrive import opendrive
from harness.old.store.reading import RISK
from harness.old.studies.batch.showing import traced_pair, write_shown_risk
from harness.old.studies.export.scenes import Stored, Wanted, scene_of
from harness.old.studies.export.trajectories import trajectories
from harness.old.studies.replay.rerun import refuse_in_use
from harness.old.studies.risk.folder import read_risk
from harness.old.studies.runs.opening import opened_run
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import shown_folders
from harness.results.folder import kind_of_folder
from harness.results.run import Run, load_run
from harness.results.tables import Tables, read_cell
from harness.studies.replay import RECORDS, differences_of, stored_tasks
from harness.studies.workers import LocalExecutor, supervise

Format = Literal["openscenario", "trajectories"]


@dataclass(frozen=True)
class Exported:
    """The written files.

    ``differences`` says how a pair that was simulated again differs from its record; it is None if
    the run kept the traces.
    """

    files: tuple[Path, ...]
    differences: tuple[str, ...] | None


def export_pair(
    run: Path, cell: int, pair: int, wanted: Wanted, form: Format, out: Path
) -> Exported:
    """Write one arm of a pair for another tool.

    Args:
        run: folder of a finished run, or of a finished risk estimate, whose pairs are those of
            ``critical.toml``.
        cell: number of the cell.
        pair: index of the pair.
        wanted: the arm, and in hours and users' own simulations the passage.
        form: the format.
        out: a new or empty folder.

    Raises:
        InputError: the run, cell, pair or passage does not exist, or an option is not supported.
    """
    refuse_in_use(out, "--out")
    if form == "openscenario":
        _require_writer()
    if (run / RISK).is_file():
        read_risk(run)
        if missing := write_shown_risk(run):
            raise InputError(str(run), "has no pairs to export", missing)
        run = shown_folders(run, None)[0]
    data: Run | RunData
    if kind_of_folder(run) == "encounters":
        data = load_run(run)
        tables, differences = _episode(data, cell, pair, wanted.arm)
    else:
        data = opened_run(run)
        tables, differences = traced_pair(data, cell, pair, wanted.arm)
    where = f"{data.name}, pair {pair}" + (f" of cell {cell}" if data.study.varied_keys else "")
    title = f"{where}, {wanted.arm.value}'s arm"
    scene = scene_of(Stored(data.scenario_of(cell), title, tables), wanted)
    contents = {}
    if form == "openscenario":
        from harness.old.studies.export.openscenario import ROAD, openscenario

        contents[ROAD] = opendrive(scene.net)
        contents["scenario.xosc"] = openscenario(scene, free=wanted.free)
    else:
        contents["trajectories.csv"] = trajectories(scene)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(out, error) from None
    for name, content in contents.items():
        write_file(out / name, content)
    return Exported(tuple(out / name for name in contents), differences)


def _episode(run: Run, cell: int, pair: int, arm: Arm) -> tuple[Tables, tuple[str, ...] | None]:
    """See ``traced_pair``."""
    (task,) = stored_tasks(run, cell, [pair], [arm])
    if run.manifest["traces"]:
        names = (*RECORDS, "traces")
        rows = {name: read_cell(run.path, name, cell, run.manifest, pair) for name in names}
        of_arm = {name: of.filter(pc.equal(of["arm"], arm.value)) for name, of in rows.items()}
        return of_arm, None
    executor = LocalExecutor(1, 1)
    try:
        again = replace(task, traces=True, engine=run.manifest["engine"])
        tables = executor.submit(supervise, again).result().tables[cell]
    finally:
        executor.abort()
    return tables, differences_of(run, cell, pair, tables, [arm])


def _require_writer() -> None:
    """Refuse OpenSCENARIO if the library that writes it is not installed."""
    try:
        import scenariogeneration  # noqa: F401
    except ImportError:
        raise InputError(
            "--format openscenario",
            "scenariogeneration is not installed",
            'pip install "crosswalk-harness[export]"',
        ) from None
