"""One cell of a stored run: what its episodes were, to hold a repetition against."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.encounter import Arm
from harness.errors import InputError
from harness.interaction import InteractionModel, load_model
from harness.manifest import recall_study
from harness.measures import Outcome
from harness.results import EPISODES, PEDESTRIANS, episode_rows, pedestrian_rows
from harness.run_folder import read_manifest, read_table
from harness.study import Cell


class StoredCell:
    """The stored rows of one cell of a finished run, with its scenario and model.

    Args:
        run: the run folder.
        number: of the cell.

    Raises:
        InputError: no such run or cell, or its tables or model cannot be read.
    """

    def __init__(self, run: Path, number: int) -> None:
        cells = recall_study(read_manifest(run)).cells
        if not 0 <= number < len(cells):
            raise InputError("--cell", f"{number}", f"0 to {len(cells) - 1}")
        self.cell: Cell = cells[number]
        section = self.cell.scenario.model
        self.model: InteractionModel = load_model(section.name, section.path)
        self.episodes = read_table(run, "episodes", number).to_pylist()
        self.pedestrians = read_table(run, "pedestrians", number).to_pylist()

    def check_pair(self, pair: int) -> None:
        """Refuse a pair that the cell does not have."""
        pairs = self.cell.scenario.experiment.pairs
        if not 0 <= pair < pairs:
            raise InputError("--pair", f"{pair}", f"0 to {pairs - 1}")

    def differences(self, outcome: Outcome) -> Iterator[str]:
        """What of an episode is not exactly as stored, in words."""
        episodes, pedestrians = (
            _of(rows, outcome.pair, outcome.arm) for rows in (self.episodes, self.pedestrians)
        )
        return record_differences(outcome, self.cell.number, episodes, pedestrians)


def record_differences(
    outcome: Outcome,
    cell: int,
    episodes: Sequence[Mapping[str, Any]],
    pedestrians: Sequence[Mapping[str, Any]],
) -> Iterator[str]:
    """What of an episode run again is not exactly as stored, in words.

    Args:
        outcome: the episode.
        cell: its cell.
        episodes, pedestrians: its stored rows of the two tables.
    """
    for name, schema, rows, before in (
        ("episodes", EPISODES, episode_rows(cell, [outcome]), episodes),
        ("pedestrians", PEDESTRIANS, pedestrian_rows(cell, [outcome]), pedestrians),
    ):
        now = [dict(zip(rows, values, strict=True)) for values in zip(*rows.values(), strict=True)]
        if len(before) != len(now):
            yield f"{name}: {len(now)} rows instead of {len(before)}"
            continue
        for old, new in zip(before, now, strict=True):
            for column in schema.names:
                if old[column] != new[column]:
                    yield f"{name}.{column}: {new[column]!r} instead of {old[column]!r}"


def _of(rows: list[dict[str, Any]], pair: int, arm: Arm) -> list[dict[str, Any]]:
    return [row for row in rows if row["pair"] == pair and row["arm"] == arm.value]
