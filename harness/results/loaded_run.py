"""The folder of a run in; a ``Run`` with its tables, findings and results out.

For example ``load_run("runs/cctc-1").episodes.groupby("arm")["delay_s"].mean()``.  The notes
about a run as a whole are made here, too.
"""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.compute as pc

from harness.core.documents import as_plain
from harness.core.errors import InputError, advised, checked, in_shell, inside, unknown_name
from harness.core.freezing import frozen
from harness.core.versions import versions_of_runs
from harness.core.vocabulary import Arm
from harness.results import folder as folders
from harness.results.cell_findings import CellFindings, cell_findings, records_of
from harness.results.cell_tables import drivers, scope_of, tables_of
from harness.results.notes import FIRST, Note, notes_of, retries
from harness.results.place import name_of, place_in_words
from harness.results.result import Result
from harness.results.tables import COUNTED, TABLES_OF, TRACES, RunKind
from harness.scenario import Scenario, Study, study_from
from harness.scenario.file import ScenarioFile, as_settings, parts_of

if TYPE_CHECKING:
    import pandas as pd

Failure = tuple[int, int, str, str]
"""Cell, pair, arm and reason of an episode that failed."""


@dataclass(frozen=True)
class Run:
    """The content of a run folder.  Each frame is new, and belongs to whoever asked for it.

    A missing value is NaN or None.  An unfinished run has, of each cell, the pairs up to the first
    one that is missing: later ones are left out, because those that finish first are the fast ones.
    """

    path: Path
    manifest: folders.Manifest
    """``manifest.json``: scenario, versions, models (docs/files.md).  Its tables are
    read-only, so ``json.dumps`` needs a copy of each as a dictionary."""
    study: Study
    """Its cells with their checked scenarios."""
    finished: bool
    """Whether every planned pair is there, episodes that failed among them."""
    cells: tuple[CellFindings, ...]
    """The findings of every cell that has a pair."""

    @property
    def name(self) -> str:
        """The name of the run, which is its scenario's name."""
        return self.study.name

    @property
    def confidence(self) -> float:
        """The two-sided confidence of each interval."""
        return float(self.manifest["confidence"])

    def scenario_of(self, cell: int) -> Scenario:
        """The scenario of one cell.

        Raises:
            InputError: there is no such cell.
        """
        return self.study.cell(cell).scenario

    def rows(self, table: str, cell: int) -> pa.Table:
        """The rows of a table and cell by pair, the AV's first, up to the first missing pair.

        Those of a finished run are kept, but for its traces.

        Raises:
            InputError: runs of this kind have no such table, there is no such cell, a part is
                damaged, or the run is finished and a part is missing.
        """
        if table not in (names := [each.name for each in TABLES_OF[self.kind]]):
            raise unknown_name(str(self.path), "table", table, names)
        key = table, self.study.cell(cell).number
        rows = self._kept.get(key) or folders.read_cell(self.path, *key, self.manifest)
        if self.finished and table != TRACES.name:
            self._kept[key] = rows
        return rows

    @cached_property
    def _kept(self) -> dict[tuple[str, int], pa.Table]:
        return {}

    @property
    def kind(self) -> RunKind:
        """The kind of the run."""
        return self.study.base.kind

    def table(self, name: str) -> "pd.DataFrame":
        """A table of all cells as a frame; a new one each time."""
        cells = (self.rows(name, cell.number) for cell in self.study.cells)
        frame: pd.DataFrame = pa.concat_tables(cells).to_pandas()
        return frame

    @property
    def summary(self) -> "pd.DataFrame":
        """One row per cell: ``cell``, the varied keys, the drivers, and every finding.

        ``flat`` (``results.result``) has the names of what stands beside a number.
        """
        return self.result().frame()

    @property
    def episodes(self) -> "pd.DataFrame":
        """One row per cell × pair × arm: how it ended, and every measure (docs/files.md)."""
        return self.table("episodes")

    @property
    def pedestrians(self) -> "pd.DataFrame":
        """One row per pedestrian × arm who arrived within the record."""
        return self.table("pedestrians")

    @property
    def pairs(self) -> "pd.DataFrame":
        """One row per cell × pair: ``cell, pair, av_time_s, human_time_s, tau``."""
        times = self.episodes.pivot(index=["cell", "pair"], columns="arm", values="pass_time_s")
        times = times.reindex(columns=[*Arm]).set_axis(["av_time_s", "human_time_s"], axis=1)
        times["tau"] = times["av_time_s"] / times["human_time_s"]
        return times.rename_axis(columns=None).reset_index()

    @cached_property
    def failures(self) -> tuple[Failure, ...]:
        """Every episode or simulation that failed."""
        table, failed = TABLES_OF[self.kind][0].name, pc.field("reason").is_valid()
        return tuple(
            (cell.number, row["pair"], row["arm"], row["reason"])
            for cell in self.study.cells
            for row in self.rows(table, cell.number).filter(failed).to_pylist()
        )

    def refuse_unfinished(self) -> None:
        """Raise an ``InputError`` if pairs are missing."""
        if not self.finished:
            raise folders.unfinished(self.path)

    def result(self) -> Result:
        """What ``harness run`` shows of it.

        Raises:
            InputError: no pair is finished.
        """
        if not self.cells:
            raise InputError(self.path, "no pair is finished yet", advised("resume", self.path))
        cells, folder = self.cells, shlex.quote(str(self.path))
        notes = [*older_code(self.manifest), *retries(folders.tried_again(self.path))]
        facts: dict[str, Any] = {"name": self.name, "folder": str(self.path), "kind": self.kind}
        facts |= {key: self.manifest[key] for key in ("seed", "confidence", "engine")}
        facts |= {"finished": self.finished, "failed": sum(cell.total("failed") for cell in cells)}
        if facts["failed"]:
            number, pair, arm, why = self.failures[0]
            facts["failure"] = f"cell {number} pair {pair} {arm}: {why}"
        if not self.finished:
            done = sum(cell["pairs"].count for cell in cells)
            planned = sum(cell.scenario.experiment.pairs for cell in self.study.cells)
            text = f"The run is not finished: {done:,} of {planned:,} pairs are done; "
            text += f"{in_shell(advised('resume', self.path))} continues it."
            notes.append(Note("unfinished", FIRST, "unfinished", text))
        which = name_of(cells[0].varied) if len(cells) == 1 else f"{len(cells)} cells"
        screen, full = tables_of(cells)
        return Result(
            command="run",
            title=f"{self.name}: {', '.join(filter(None, [which, drivers(cells)]))}",
            scope=scope_of(cells, facts),
            about=place_in_words([cell.scenario for cell in cells]),
            screen=screen,
            full=full,
            notes=notes_of(cells, notes),
            closing=(f"All measures: harness show {folder} --full. Page: harness report {folder}",),
            facts=facts,
            records=[record for cell in cells for record in records_of(cell)],
        )


@checked
def load_run(path: Path | str, settings: Mapping[str, Any] | None = None) -> Run:
    """Read a run folder, finished or not.

    Args:
        path: the folder.
        settings: other thresholds of conflicts by dotted key, e.g. ``conflicts.pet_s``, for which
            all numbers are computed anew; nothing is written.

    Returns:
        The run.  An unfinished one has the pairs before the first one that is missing.

    Raises:
        InputError: the folder holds no run, its files are damaged, or a setting is refused.
    """
    path = Path(path)
    manifest = folders.read_manifest(path)
    if manifest["kind"] == "risk":
        allowed = f"{path / folders.EVENTS}, the run of its events, or `harness show {path}`"
        raise InputError(str(path), "is a risk estimate", allowed)
    asked = as_plain(manifest)  # for other thresholds; the run's own is sealed
    given = as_settings(settings or {})
    for each in given:
        if parts_of(each)[0] != "conflicts" or each.key in manifest["cells"][0]:
            allowed = "thresholds of [conflicts] that are not swept; another run has the others"
            raise InputError(inside(each.source, each.key), "cannot change after a run", allowed)
    where = str(path / folders.MANIFEST)
    file = ScenarioFile("", where, manifest["scenario"], None, given, path)
    asked["scenario"] = file.cell().model_dump()
    study = study_from(asked, where)
    stored = None if settings else folders.read_findings(path, manifest, study.cells)
    finished = folders.is_finished(path)  # a run may end while its parts are read
    return Run(path, frozen(manifest), study, finished, stored or computed(path, manifest, study))


def older_code(manifest: folders.Manifest) -> list[Note]:
    """The note that code or versions that make rows have changed since a run, if they have."""
    command = "risk" if "risk" in manifest else "run"
    made, now = manifest["simulated_with"], (folders.code_of_rows(), versions_of_runs())
    text = "Code or versions of libraries that make rows have changed since this run. "
    text += f"To simulate it again, call `harness {command}` with its folder."
    note = Note("older_code", FIRST, "older code", text)
    return [] if (made["code"], made["versions"]) == now else [note]


def computed(path: Path, manifest: folders.Manifest, study: Study) -> tuple[CellFindings, ...]:
    """The findings of every cell that has a pair, from the tables."""
    found, names = [], COUNTED[manifest["kind"]]
    for cell in study.cells:
        tables = {name: folders.read_cell(path, name, cell.number, manifest) for name in names}
        pairs = len(tables[names[0]]) // 2
        for name in names[1:]:  # a run that goes on may have rows of more pairs by now
            tables[name] = tables[name].filter(pc.less(tables[name]["pair"], pairs))
        if pairs:
            found.append(cell_findings(cell, tables, manifest["confidence"]))
    return tuple(found)
