"""Cells, runs and sweeps whose episodes are made by hand: every number of them can be counted."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pyarrow as pa
from rich.console import Console

from harness.core.versions import versions_of_runs
from harness.core.vocabulary import Arm
from harness.report.screen import print_result
from harness.results.cell_findings import CellFindings, cell_findings
from harness.results.folder import code_of_rows
from harness.results.loaded_run import Run
from harness.results.notes import Note, notes_of
from harness.results.result import Result
from harness.results.tables import EPISODES
from harness.scenario import Cell, Scenario, Setting, Study, read_scenario_file, study_of
from harness.scenario.variation import parse_variation

HUMAN_S = 10.0
FREE_S = 7.4
"""(30 + 5 + 2) m at 5 m/s: an undisturbed passage in ``cctc``."""

Fate = float | str | dict[str, Any]
"""Pass time in seconds, or how else an episode ended, or columns that differ from the usual."""

Fates = Callable[[Scenario, int], tuple[Fate, Fate]]
"""The AV's fate and the reference's in a pair."""

FAILED = {"ending": "failed", "failed_in": "strategy", "reason": "the strategy raised"}
FAILED |= {"steps": None, "pedestrians": None, "arrivals": None}
WALKER = {"side": "near", "start_lateral_m": 4.0, "speed_mps": 1.4, "impact_share": 0.5}
TIMED = {"pedestrians__timed": [WALKER], "pedestrians__first_at_trigger": False}
TIMED |= {"pedestrians__flow_per_hour": 0.0, "pedestrians__max_count": None}
TIMED |= {"pedestrians__kerb_wait_s": 2.0}
"""Changes to a cell in which one person comes, in every pair at the same time."""

NOBODY = {"pass_time_s": FREE_S, "pedestrians": 0, "arrivals": 0, "pedestrian_delay_s": None}


def _episode(fate: Fate) -> dict[str, Any]:
    """The columns of an episode that do not say whose it is."""
    known: dict[str, Any] = {"ending": "crossed", "fallback": False, "steps": 100, "stops": 0}
    known |= {"stopped_s": 0.0, "pedestrians": 1, "arrivals": 1, "pedestrian_delay_s": 0.0}
    if isinstance(fate, float):
        fate = {"pass_time_s": fate}
    changes: Any = {"ending": fate} if isinstance(fate, str) else dict(fate)
    if changes.get("ending") == "crashed":
        known |= {"contact": "front", "contact_time_s": 5.0, "contact_speed_mps": 5.0}
    if (time_s := changes.get("pass_time_s")) is not None:
        known |= {"pass_time_ignoring_contact_s": time_s, "delay_s": time_s - FREE_S}
    return known | changes


def episodes(pairs: Sequence[tuple[Fate, Fate]], scenario: Scenario, cell: int = 0) -> pa.Table:
    """The table ``episodes`` of a cell."""
    rows = [
        {"cell": cell, "pair": pair, "arm": arm.value, "strategy": scenario.arms.driver(arm)}
        | _episode(fate)
        for pair, fates in enumerate(pairs)
        for arm, fate in zip(Arm, fates, strict=True)
    ]
    return EPISODES.of(rows)


def study(changes: Mapping[str, object], *vary: str, name: str = "cctc") -> Study:
    """A study of a shipped scenario with changes by dotted key."""
    file = read_scenario_file(name, [Setting(key, value) for key, value in changes.items()])
    return study_of(file, [parse_variation(text) for text in vary])


def cell_of(pairs: Sequence[tuple[Fate, Fate]], **changes: object) -> CellFindings:
    """The findings of a cell of ``cctc``; a double underscore in a change stands for the dot."""
    (cell,) = study({key.replace("__", "."): value for key, value in changes.items()}).cells
    return cell_findings(cell, {"episodes": episodes(pairs, cell.scenario)}, 0.95)


@dataclass(frozen=True)
class MadeRun(Run):
    """A run of a study that has its rows in memory."""

    tables: Mapping[int, pa.Table] = field(default_factory=dict)

    def rows(self, table: str, cell: int) -> pa.Table:
        """The rows of a cell."""
        assert table == "episodes"
        return self.tables[cell]


def run_of(
    of: Study, fates: Fates, pairs: int, *, finished: bool = True, name: str = "run"
) -> MadeRun:
    """The first pairs of a study as a run."""

    def rows(cell: Cell) -> pa.Table:
        made = [fates(cell.scenario, pair) for pair in range(pairs)]
        return episodes(made, cell.scenario, cell.number)

    tables = {cell.number: rows(cell) for cell in of.cells}
    cells = tuple(cell_findings(cell, {"episodes": tables[cell.number]}, 0.95) for cell in of.cells)
    manifest: Any = {"confidence": 0.95, "engine": "sumo"}
    made = {"code": code_of_rows(), "versions": versions_of_runs()}
    manifest |= {"seed": of.base.experiment.seed, "simulated_with": made}
    return MadeRun(Path(name), manifest, of, finished, cells, tables=tables)


def result_of(of: Study, fates: Fates, pairs: int, *, finished: bool = True) -> Result:
    """What is shown of a run."""
    with patch("harness.results.folder.tried_again", return_value=0):  # there is no log
        return run_of(of, fates, pairs, finished=finished).result()


def screen_text(result: Result, width: int, full: bool = False) -> str:
    """The text that ``print_result`` prints to a console of this width."""
    written = StringIO()
    print_result(result, full, Console(file=written, width=width, color_system=None))
    return "".join(f"{line.rstrip()}\n" for line in written.getvalue().splitlines())


def notes_by_key(*cells: CellFindings) -> dict[str, Note]:
    """The notes of some cells, by their keys, the worst first."""
    return {note.key: note for note in notes_of(cells)}


def noisy(pair: int, seed: int = 0, mean_s: float = 9.0) -> float:
    """A pass time that differs from pair to pair."""
    return float(mean_s + np.random.default_rng((pair, seed)).normal(0.0, 0.8))
