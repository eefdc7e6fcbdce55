"""A finished run folder of hours of traffic or own simulations in Python."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.errors import InputError
from harness.model.interaction import InteractionModel, load_model
from harness.old.statistics import CONFIDENCE, Findings, columns_of, row_of
from harness.old.store.hour_summaries import HoursSummary, hours_summary
from harness.old.store.kinds import Kind, kind_of_study
from harness.old.store.manifest import model_entry
from harness.old.store.reading import read_table
from harness.old.store.schemas import TABLES
from harness.old.store.summary_table import read_summary
from harness.old.store.tables import Row
from harness.old.studies.kinds.tasks import Failure
from harness.scenario import Cell, Scenario, Study


@dataclass(frozen=True)
class RunData:
    """The content of a run folder.  Tables are read on first use and kept; do not change them.

    A missing value is NaN or None.
    """

    path: Path
    manifest: Mapping[str, Any]
    """``manifest.json``: scenario, versions, models, counts (docs/files.md)."""
    study: Study
    _kept: dict[str, pa.Table] = field(default_factory=dict)
    _models: dict[tuple[str, str | None, bool], InteractionModel] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The name of the run, which is its scenario's name."""
        return self.study.name

    @property
    def scenario(self) -> Scenario:
        """The scenario without the values of varied keys."""
        return self.study.base

    def scenario_of(self, cell: int) -> Scenario:
        """The scenario of one cell."""
        return self.study.cells[cell].scenario

    @property
    def varied_keys(self) -> list[str]:
        """The keys that a sweep varies; empty for a run of one cell."""
        return self.study.varied_keys

    @property
    def kept_traces(self) -> bool:
        """Whether the run kept every step (``--traces``)."""
        return bool(self.manifest["traces"])

    @cached_property
    def cells(self) -> pd.DataFrame:
        """One row per cell: ``cell`` and the varied keys."""
        return _frame(self.table("cells"))

    @cached_property
    def ranked(self) -> pd.DataFrame:
        """The rows that ``harness worst`` ranks: a user's simulation's passages."""
        return _frame(self.table(self.kind.ranked[0]))

    @cached_property
    def pedestrians(self) -> pd.DataFrame:
        """One row per pedestrian × arm.

        ``cell, pair, arm, index, arrival_s, start_s, side, quantile, speed_mps, range_m,
        vehicle_speed_mps, cleared_s``.  Range and speeds are missing for pedestrians who never
        stepped off.
        """
        return _frame(self.table("pedestrians"))

    @property
    def kind(self) -> Kind:
        """The kind of the run, which determines its tables and its findings."""
        return kind_of_study(self.study)

    @cached_property
    def hours(self) -> pd.DataFrame:
        """One row per cell × pair × arm of a run in traffic; the summary is computed from it."""
        return _frame(self.table("hours"))

    @cached_property
    def passages(self) -> pd.DataFrame:
        """One row per vehicle × arm of a run in traffic, with a column for each measure."""
        return _frame(self.table("passages"))

    @cached_property
    def passages_over(self) -> pd.DataFrame:
        """One row per passage × arm of a run of a user's own simulation."""
        return _frame(self.table("passages_over"))

    @cached_property
    def queues(self) -> pd.DataFrame:
        """One row per minute, lane and arm of a run in traffic."""
        return _frame(self.table("queues"))

    @property
    def hour_results(self) -> tuple[tuple[Cell, HoursSummary], ...]:
        """The summary of every cell of a run in traffic."""
        return tuple((cell, hours_summary(findings)) for cell, findings in self.results)

    @cached_property
    def summary(self) -> pd.DataFrame:
        """One row per cell: ``cell``, the varied keys and the columns of ``summary.csv``.

        It is computed from the rows if ``summary.parquet`` does not exist yet or lacks a newer
        column (docs/files.md).
        """
        rows = [
            {
                "cell": cell.number,
                **cell.varied,
                **row_of(self.kind.catalogue, findings),
            }
            for cell, findings in self.results
        ]
        frame = pd.DataFrame(rows)
        # A column that is undefined in every cell still has a numeric type.
        types = {name: of for name, of in columns_of(self.kind.catalogue).items() if of is not str}
        return frame.astype({name: types[name] for name in frame.columns if name in types})

    @cached_property
    def results(self) -> tuple[tuple[Cell, Findings], ...]:
        """Every cell with its findings."""
        kind, cells = self.kind, self.study.cells
        stored = read_summary(self.path, kind.catalogue, cells)
        if stored is not None:
            return tuple((cell, stored[cell.number]) for cell in cells)
        return tuple(
            (cell, kind.findings(rows, cell, CONFIDENCE))
            for cell, rows in self._by_cell(self.kind.rows)
        )

    @cached_property
    def traces(self) -> pd.DataFrame:
        """One row per step and object.  This table is large; ``traces_of`` reads one pair.

        ``cell, pair, arm, time_s, object, x_m, y_m, speed_mps, acceleration_mps2``.  ``object`` is
        ``ego`` (its front bumper) or ``pedestrian-<index>`` (their centre).  A run in traffic has
        ``vehicle-<number>`` instead of ``ego``.

        Raises:
            InputError: the run kept no traces.
        """
        self._refuse_without_traces()
        return _frame(self._checked("traces"))

    def rows_of(self, name: str, cell: int, pair: int) -> pa.Table:
        """Return the stored rows of one pair in ``episodes``, ``pedestrians`` or ``traces``."""
        if name == "traces":
            return read_table(self.path, name, cell, pair)
        table = self.table(name)
        selected = pc.and_(pc.equal(table["cell"], cell), pc.equal(table["pair"], pair))
        return table.filter(selected)

    def rows_of_cell(self, cell: int) -> pa.Table:
        """Return the rows of a cell from which its findings are computed, by pair."""
        table = self.table(self.kind.rows)
        return table.filter(pc.equal(table["cell"], cell))

    def statistics(self, name: str) -> list[Row]:
        """Return the rows of all cells in ``<name>.csv``, with ``cell``; empty if there is none."""
        findings = {cell.number: findings for cell, findings in self.results}
        return [
            {"cell": cell.number, **row}
            for cell, rows in self._by_cell(self.kind.rows)
            for row in self.kind.statistics(rows, cell, findings[cell.number]).get(name, ())
        ]

    @cached_property
    def failures(self) -> tuple[Failure, ...]:
        """(cell, pair, arm, reason) of every episode in which the engine or the strategy failed."""
        failed = self.kind.failed(self.table(self.kind.rows))
        columns = (failed[name].to_pylist() for name in ("cell", "pair", "arm", "reason"))
        return tuple((*where, reason or "") for *where, reason in zip(*columns, strict=True))

    def model_of(self, cell: int) -> InteractionModel:
        """Return the interaction model that a cell used.

        Raises:
            InputError: the model's file is missing or has changed since the run.
        """
        key = self.scenario_of(cell).model.file_and_refits
        if key not in self._models:
            self._models[key] = load_model(*key)
        model = self._models[key]
        used = self.manifest["simulated_with"]["models"]
        if not any(model_entry(model).items() <= entry.items() for entry in used):
            raise InputError(f"model {model.name}", "has changed since the run", "the same file")
        return model

    def __repr__(self) -> str:
        """Return the text that a debugger shows."""
        return f"<RunData {self.name} in {self.path}>"

    def table(self, name: str) -> pa.Table:
        """Return all rows of a table other than ``traces``; it is read once and kept.

        Raises:
            InputError: the table is missing or damaged.
        """
        if name not in self._kept:
            self._kept[name] = self._checked(name)
        return self._kept[name]

    def _checked(self, name: str) -> pa.Table:
        table, cells = read_table(self.path, name), len(self.study.cells)
        if name in TABLES and (pc.max(table["cell"]).as_py() or 0) >= cells:
            where = str(self.path / f"{name}.parquet")
            problem = "names a cell that does not exist"
            raise InputError(f"{where}: cell", problem, f"0 to {cells - 1}")
        return table

    def _by_cell(self, name: str) -> Iterator[tuple[Cell, pa.Table]]:
        """Yield every cell that has rows, with its rows."""
        table = self.table(name)
        numbers = table["cell"].to_numpy()
        for cell in self.study.cells:
            of_cell = numbers == cell.number
            # The rows of a single cell may be large, so they are not copied.
            rows = table if of_cell.all() else table.filter(pa.array(of_cell))
            if rows.num_rows:
                yield cell, rows

    def _refuse_without_traces(self) -> None:
        if not self.kept_traces:
            raise InputError(str(self.path), "kept no traces", "a run with --traces")


def _frame(table: pa.Table) -> pd.DataFrame:
    frame: pd.DataFrame = table.to_pandas()
    return frame
