"""One cell of a stored run: what its episodes were, to hold a repetition against."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from harness.encounter import Arm
from harness.errors import InputError
from harness.interaction import InteractionModel, load_model
from harness.measures import Outcome
from harness.results.manifest import recall_study
from harness.results.reading import read_finished_manifest, read_table
from harness.results.tables import episode_rows, pedestrian_rows
from harness.scenario import Cell

Row = dict[str, Any]


class StoredCell:
    """The stored rows of one cell of a finished run, with its scenario and model.

    Args:
        run: the run folder.
        number: of the cell.

    Raises:
        InputError: no finished run or no such cell, or its tables or model cannot be read.
    """

    def __init__(self, run: Path, number: int) -> None:
        cells = recall_study(read_finished_manifest(run)).cells
        if not 0 <= number < len(cells):
            raise InputError("--cell", f"{number}", f"0 to {len(cells) - 1}")
        self.cell: Cell = cells[number]
        section = self.cell.scenario.model
        self.model: InteractionModel = load_model(section.name, section.path)
        self._episodes, self._pedestrians = (
            _by_episode(read_table(run, name, number)) for name in ("episodes", "pedestrians")
        )

    def check_pair(self, pair: int) -> None:
        """Refuse a pair that was not run."""
        if (pair, Arm.AV.value) not in self._episodes:
            last = max((pair for pair, _ in self._episodes), default=0)
            raise InputError("--pair", f"{pair}", f"0 to {last}")

    def rows_of(self, pair: int, arm: Arm) -> tuple[list[Row], list[Row]]:
        """An episode's rows of ``episodes`` and of ``pedestrians``."""
        key = (pair, arm.value)
        return self._episodes.get(key, []), self._pedestrians.get(key, [])

    def differences(self, outcome: Outcome) -> Iterator[str]:
        """What of an episode is not exactly as stored, in words."""
        rows = self.rows_of(outcome.pair, outcome.arm)
        return record_differences(outcome, self.cell.number, *rows)


def record_differences(
    outcome: Outcome,
    cell: int,
    episodes: Sequence[Row],
    pedestrians: Sequence[Row],
) -> Iterator[str]:
    """What of an episode run again is not exactly as stored, in words.

    Args:
        outcome: the episode.
        cell: its cell.
        episodes, pedestrians: its stored rows of the two tables.
    """
    yield from differences_of("episodes", episode_rows(cell, [outcome]), episodes)
    yield from differences_of("pedestrians", pedestrian_rows(cell, [outcome]), pedestrians)


def differences_of(
    name: str, columns: Mapping[str, Sequence[Any]], stored: Sequence[Row]
) -> Iterator[str]:
    """What of new columns of a table is not exactly as its stored rows, in words."""
    now = [
        dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)
    ]
    if len(stored) != len(now):
        yield f"{name}: {len(now)} rows instead of {len(stored)}"
        return
    for old, new in zip(stored, now, strict=True):
        # A run of an earlier version has fewer columns.
        for column in old:
            if old[column] != new[column]:
                yield f"{name}.{column}: {new[column]!r} instead of {old[column]!r}"


def _by_episode(table: pa.Table) -> dict[tuple[int, str], list[Row]]:
    rows: dict[tuple[int, str], list[Row]] = {}
    for row in table.to_pylist():
        rows.setdefault((row["pair"], row["arm"]), []).append(row)
    return rows
