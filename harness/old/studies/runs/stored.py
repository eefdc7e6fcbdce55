"""Reads the rows of a stored cell, and compares repeated episodes with them."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import pyarrow as pa

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.model.interaction import InteractionModel, load_model
from harness.old.store.kinds import kind_of
from harness.old.store.manifest import explained
from harness.old.store.reading import MANIFEST, read_finished_manifest, read_table
from harness.old.store.tables import Row, Tables
from harness.old.studies.kinds.simulation import ArmOfPair, ArmRows
from harness.scenario import Cell, study_from

Rows = dict[str, list[Row]]
"""Rows by the name of their table."""


class StoredCell:
    """The stored rows of one cell of a finished run, with its scenario and model.

    Args:
        run: the run folder.
        number: number of the cell.
        pair: a pair that the run must contain; None means no check.

    Raises:
        InputError: the run is not finished, the cell or pair does not exist, or its tables or
            model cannot be read.
    """

    def __init__(self, run: Path, number: int, pair: int | None = None) -> None:
        document = read_finished_manifest(run)
        cells = study_from(document, MANIFEST).cells
        if not 0 <= number < len(cells):
            raise InputError("--cell", f"{number}", f"0 to {len(cells) - 1}")
        self.cell: Cell = cells[number]
        self._document = document
        section = self.cell.scenario.model
        self.model: InteractionModel = load_model(*section.file_and_refits)
        names = kind_of(self.cell.scenario).records
        self._rows = {name: _by_episode(read_table(run, name, number)) for name in names}
        ran = self._rows[names[0]]
        if pair is not None and (pair, Arm.AV.value) not in ran:
            raise InputError(
                "--pair", f"{pair}", f"0 to {max((number for number, _ in ran), default=0)}"
            )

    def arm(self, pair: int, arm: Arm) -> ArmOfPair:
        """Return an arm of a pair of the cell."""
        return ArmOfPair(self.cell, self.model, pair, arm)

    def rows_of(self, pair: int, arm: Arm) -> Rows:
        """Return the stored rows of an episode, or of an hour's arm, by table."""
        key = (pair, arm.value)
        return {name: rows.get(key, []) for name, rows in self._rows.items()}

    def differences(self, arm: ArmOfPair, rows: ArmRows) -> tuple[str, ...]:
        """Return sentences about how a repeated arm differs from its stored record."""
        stored = self.rows_of(arm.pair, arm.arm)
        return self.explained(record_differences(rows.tables, stored))

    def explained(self, differences: Iterable[str]) -> tuple[str, ...]:
        """Prepend what changed since the run, such as the code of a strategy."""
        return explained(differences, self._document, self.cell.scenario, self.model)


def record_differences(tables: Tables, stored: Rows) -> Iterator[str]:
    """Yield sentences about how a repeated arm differs from its stored rows.

    Args:
        tables: rows of the repeated arm.
        stored: its stored rows by table.
    """
    for name, rows in stored.items():
        yield from differences_of(name, tables[name].to_pylist(), rows)


def differences_of(name: str, now: Sequence[Row], stored: Sequence[Row]) -> Iterator[str]:
    """Yield sentences about how new rows of a table differ from stored rows."""
    if len(stored) != len(now):
        yield f"{name}: {len(now)} rows instead of {len(stored)}"
        return
    for old, new in zip(stored, now, strict=True):
        for column in old:
            if old[column] != new[column]:
                yield f"{name}.{column}: {new[column]!r} instead of {old[column]!r}"


def _by_episode(table: pa.Table) -> dict[tuple[int, str], list[Row]]:
    rows: dict[tuple[int, str], list[Row]] = {}
    for row in table.to_pylist():
        rows.setdefault((row["pair"], row["arm"]), []).append(row)
    return rows
