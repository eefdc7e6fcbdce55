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
from harness.model.interaction import InteractionModel, load_model
from harness.results.findings import CellFindings, cell_findings
from harness.results.folder import model_entry, read_findings, read_manifest
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
    def planned(self) -> int:
        """Planned pairs of all cells."""
        return sum(cell.scenario.experiment.pairs for cell in self.study.cells)

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

        A number's interval, pairs and events are in ``_low``, ``_high``, ``_n`` and ``_events``.
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
    def traces(self) -> "pd.DataFrame":
        """One row per step and object.  It is large; ``traces_of`` has one pair.

        Raises:
            InputError: the run kept no traces.
        """
        self._refuse_without_traces()
        return self._frame("traces")

    def traces_of(self, cell: int, pair: int) -> "pd.DataFrame":
        """The traces of both arms of one pair.

        Raises:
            InputError: the run kept no traces.
        """
        self._refuse_without_traces()
        rows: pd.DataFrame = self.rows("traces", cell).to_pandas()
        return rows[rows["pair"] == pair]

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

    def model_of(self, cell: int) -> InteractionModel:
        """The interaction model that a cell used.

        Raises:
            InputError: the model's file is missing or has changed since the run.
        """
        model = load_model(*self.scenario_of(cell).model.file_and_refits)
        if model_entry(model) not in self.manifest["simulated_with"]["models"]:
            raise InputError(f"model {model.name}", "has changed since the run", "the same file")
        return model

    def result(self) -> Result:
        """What ``harness run`` shows of it.

        Raises:
            InputError: no pair is finished.
        """
        if not self.cells:
            allowed = f"a run with results: {resume_command(self.path)}"
            raise InputError(str(self.path), "no pair is finished yet", allowed)
        facts = {
            "seed": self.manifest["seed"],
            "confidence": self.confidence,
            "engine": self.manifest["engine"],
        }
        return run_result(
            self.name,
            self.path,
            self.cells,
            planned=self.planned,
            finished=self.finished,
            facts=facts,
        )

    def write_csv(self) -> list[Path]:
        """Write every table as ``RUN/csv/<table>.csv``; legs of walks are JSON.

        Raises:
            HarnessError: the files cannot be written.
        """
        from pyarrow import csv

        folder, written = self.path / "csv", []
        names = ["episodes", "pedestrians", *(["traces"] if self.manifest["traces"] else [])]
        try:
            folder.mkdir(exist_ok=True)
            for name in names:
                parts = [self.rows(name, cell.number) for cell in self.study.cells]
                table = pa.concat_tables(parts)
                if "legs" in table.column_names:
                    texts = [legs and json.dumps(legs) for legs in table["legs"].to_pylist()]
                    at = table.column_names.index("legs")
                    table = table.set_column(at, "legs", pa.array(texts, pa.string()))
                with whole_file(folder / f"{name}.csv") as file:
                    csv.write_csv(table, file)
                written.append(folder / f"{name}.csv")
            with whole_file(folder / "pairs.csv") as file:
                self.pairs.to_csv(file, index=False)
        except OSError as error:
            raise cannot_write(folder, error) from None
        return [*written, folder / "pairs.csv"]

    def _frame(self, table: str) -> "pd.DataFrame":
        parts = [self.rows(table, cell.number) for cell in self.study.cells]
        frame: pd.DataFrame = pa.concat_tables(
            [TABLES[table].schema.empty_table(), *parts]
        ).to_pandas()
        return frame

    def _refuse_without_traces(self) -> None:
        if not self.manifest["traces"]:
            raise InputError(
                str(self.path), "kept no traces", "a run with --traces, or harness replay"
            )


def load_run(path: Path | str) -> Run:
    """Read a run folder of encounters, finished or not.

    Raises:
        InputError: the folder holds no such run, or its files are damaged.
    """
    path = Path(path)
    manifest = read_manifest(path)
    study = study_from(manifest, str(path / "manifest.json"))
    stored = read_findings(path, study.cells)
    return Run(
        path, manifest, study, stored is not None, stored or _computed(path, manifest, study)
    )


def _computed(path: Path, manifest: Mapping[str, Any], study: Study) -> tuple[CellFindings, ...]:
    """The findings of the cells that have a pair, from the tables."""
    rows = ((cell, read_cell(path, "episodes", cell.number, manifest)) for cell in study.cells)
    found = (cell_findings(cell, of, manifest["confidence"]) for cell, of in rows if of.num_rows)
    return tuple(found)
