"""A run folder of encounters in Python, finished or unfinished.

run = harness.load_run("runs/cctc-1")
run.summary["mu"], run.pairs["tau"], run.episodes.groupby("arm")["delay_s"].mean()
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from harness.core.encounter import Ending
from harness.core.errors import InputError, resume_command
from harness.core.files import cannot_write, whole_file
from harness.results.catalogue import ENTRY_OF
from harness.results.findings import CellFindings, cell_findings
from harness.results.folder import read_findings, read_manifest
from harness.results.result import Result
from harness.results.screens import run_result
from harness.results.tables import TABLES, read_cell
from harness.scenario import Scenario, Study, study_from

if TYPE_CHECKING:
    import pandas as pd

Failure = tuple[int, int, str, str]
"""Cell, pair, arm and reason of an episode that failed."""


@dataclass(frozen=True)
class Run:
    """The content of a run folder.  Tables are read on first use and kept; do not change them.

    A missing value is NaN or None.  An unfinished run has, of each cell, the pairs up to the first
    one that is missing: later ones are left out, because those that finish first are the fast ones.
    """

    path: Path
    manifest: Mapping[str, Any]
    """``manifest.json``: scenario, versions, models (docs/files.md)."""
    study: Study
    finished: bool
    cells: tuple[CellFindings, ...]
    """The findings of every cell that has a pair."""
    _kept: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def name(self) -> str:
        """The name of the run, which is its scenario's name."""
        return self.study.name

    @property
    def confidence(self) -> float:
        """The two-sided confidence of each interval."""
        confidence: float = self.manifest["confidence"]
        return confidence

    def scenario_of(self, cell: int) -> Scenario:
        """The scenario of one cell."""
        return self.study.cells[cell].scenario

    def rows(self, table: str, cell: int) -> pa.Table:
        """The rows of a table and cell by pair, the AV's first, up to the first missing pair."""
        return read_cell(self.path, table, cell, self.manifest)

    @cached_property
    def summary(self) -> "pd.DataFrame":
        """One row per cell: ``cell``, the varied keys, the drivers, and every finding.

        ``flat`` (``results.result``) has the names of what stands beside a number.
        """
        return self.result().frame()

    @cached_property
    def episodes(self) -> "pd.DataFrame":
        """One row per cell × pair × arm: how it ended, and every measure (docs/files.md)."""
        return self._frame("episodes")

    @cached_property
    def pedestrians(self) -> "pd.DataFrame":
        """One row per pedestrian × arm who arrived within the record."""
        return self._frame("pedestrians")

    @cached_property
    def pairs(self) -> "pd.DataFrame":
        """One row per cell × pair: ``cell, pair, av_time_s, human_time_s, tau``."""
        times = self.episodes.pivot(index=["cell", "pair"], columns="arm", values="pass_time_s")
        times = times.rename(columns={"av": "av_time_s", "human": "human_time_s"})
        times["tau"] = times["av_time_s"] / times["human_time_s"]
        return times.rename_axis(columns=None).reset_index()

    @cached_property
    def failures(self) -> tuple[Failure, ...]:
        """Every episode in which the engine or the strategy failed."""
        found: list[Failure] = []
        for cell in self.study.cells:
            rows = self.rows("episodes", cell.number).select(["pair", "arm", "ending", "reason"])
            for pair, arm, ending, reason in zip(*rows.to_pydict().values(), strict=True):
                if ending == Ending.ENGINE_FAILED:
                    found.append((cell.number, pair, arm, reason or ""))
        return tuple(found)

    def result(self) -> Result:
        """What ``harness run`` shows of it.

        Raises:
            InputError: no pair is finished.
        """
        if not self.cells:
            allowed = f"a run with results: {resume_command(self.path)}"
            raise InputError(str(self.path), "no pair is finished yet", allowed)
        return run_result(
            self.name,
            self.path,
            self.cells,
            planned=sum(cell.scenario.experiment.pairs for cell in self.study.cells),
            finished=self.finished,
            facts={key: self.manifest[key] for key in ("seed", "confidence", "engine")},
        )

    def write_csv(self) -> list[Path]:
        """Write every table as ``RUN/csv/<table>.csv``; legs of walks are JSON.

        Raises:
            HarnessError: the files cannot be written.
        """
        from pyarrow import csv

        names = ("episodes", "pedestrians", *["traces"] * self.manifest["traces"])
        tables = {name: self._table(name) for name in names}
        people = tables["pedestrians"]
        legs = [of and json.dumps(of) for of in people["legs"].to_pylist()]
        place = people.schema.get_field_index("legs")
        tables["pedestrians"] = people.set_column(place, "legs", pa.array(legs, pa.string()))
        tables["pairs"] = pa.Table.from_pandas(self.pairs, preserve_index=False)
        folder = self.path / "csv"
        try:
            folder.mkdir(exist_ok=True)
            for name, table in tables.items():
                with whole_file(folder / f"{name}.csv") as file:
                    csv.write_csv(table, file)
        except OSError as error:
            raise cannot_write(folder, error) from None
        return [folder / f"{name}.csv" for name in tables]

    def _table(self, name: str) -> pa.Table:
        """A table of all cells."""
        parts = [self.rows(name, cell.number) for cell in self.study.cells]
        return pa.concat_tables([TABLES[name].schema.empty_table(), *parts])

    def _frame(self, name: str) -> "pd.DataFrame":
        frame: pd.DataFrame = self._table(name).to_pandas()
        return frame


def load_run(path: Path | str) -> Run:
    """Read a run folder of encounters, finished or not.

    Raises:
        InputError: the folder holds no such run, or its files are damaged.
    """
    path = Path(path)
    manifest = read_manifest(path)
    study = study_from(manifest, str(path / "manifest.json"))
    stored = read_findings(path, study.cells)
    if stored and all(cell.findings.keys() == ENTRY_OF.keys() for cell in stored):
        return Run(path, manifest, study, True, stored)
    # The run is unfinished, or the catalogue has other numbers than it had.
    rows = ((cell, read_cell(path, "episodes", cell.number, manifest)) for cell in study.cells)
    found = (cell_findings(cell, of, manifest["confidence"]) for cell, of in rows if len(of))
    return Run(path, manifest, study, stored is not None, tuple(found))
