"""Sets the warm-up of each cell of a study of hours with a pilot run."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.core.seeding import stream
from harness.episode.traffic.saturation import longest_queue_s
from harness.scenario import Cell, Options, Scenario, Study
from harness.store.kinds import kind_of
from harness.studies.batch.experiment import run_study
from harness.studies.runs.run_data import RunData

WARM_UP = "traffic.warm_up_s"

ROUND_S = 300.0
"""Every warm-up is a multiple of this time or equals the counted time."""


def settled(
    study: Study,
    options: Options,
    progress: Callable[[int, int, str], None] = lambda _done, _planned, _what: None,
) -> Study:
    """Return the study with a warm-up for each cell that removes the effect of the empty start.

    The pilot of a cell is one pair with a separate seed.  It begins with an empty road and lasts
    twice the counted time.  The warm-up is the longest time that a queue took to clear in either
    arm.  It is at least the scenario's warm-up and at most the counted time.  In a study of several
    cells the warm-up becomes a varied key.

    Raises:
        InputError: a cell has no traffic, flows that change, or a permanent queue.
    """
    for cell in study.cells:
        _check(cell.scenario)
    pilots = [_cell(cell, _pilot(cell.scenario)) for cell in study.cells]
    with TemporaryDirectory(prefix="harness-pilot-") as folder:
        run = run_study(
            Study(study.name, _with(study.base, _pilot(study.base)), tuple(pilots)),
            Options(workers=options.workers),
            out=Path(folder) / "pilot",
            progress=lambda done, planned, _: progress(done, planned, "pilots"),
        )
        warm_ups = [{WARM_UP: _warm_up_s(run, cell)} for cell in study.cells]
    cells = [_cell(cell, warm_up) for cell, warm_up in zip(study.cells, warm_ups, strict=True)]
    if len(cells) == 1:
        return replace(study, base=cells[0].scenario, cells=tuple(cells))
    varied = (
        replace(cell, varied={**cell.varied, **warm_up})
        for cell, warm_up in zip(cells, warm_ups, strict=True)
    )
    return replace(study, cells=tuple(varied))


def _check(scenario: Scenario) -> None:
    if not kind_of(scenario).settles:
        raise InputError("--settle", "needs hours of traffic", "a scenario with [traffic]")
    traffic = scenario.known_traffic
    if traffic.saturated:
        raise InputError(
            "--settle", "is not supported with a permanent queue", "traffic.saturated = false"
        )
    if scenario.flows_change:
        raise InputError(
            "--settle", "is not supported with flows that change", "one flow for the whole time"
        )


def _pilot(scenario: Scenario) -> Mapping[str, float]:
    """Return the keys and values in which a pilot differs from its cell."""
    seed = stream(scenario.experiment.seed, "pilot", 0).integers(2**62)
    return {
        WARM_UP: 0.0,
        "traffic.duration_s": 2 * scenario.known_traffic.duration_s,
        "experiment.pairs": 1,
        "experiment.seed": int(seed),
    }


def _warm_up_s(run: RunData, cell: Cell) -> float:
    """Return the longest time in s that a queue lasted in either arm.

    The time is rounded up to ``ROUND_S`` and kept within its limits.
    """
    traffic, passages = cell.scenario.known_traffic, run.passages
    cell_passages, end_s = passages[passages["cell"] == cell.number], 2 * traffic.duration_s
    longest_s = 0.0
    for arm in Arm:
        rows = cell_passages[cell_passages["arm"] == arm.value]
        # A vehicle that never passed counts as late at the latest from its scheduled time on.
        due_s = (rows["passed_s"] - rows["delay_s"]).fillna(rows["scheduled_s"]).to_numpy(float)
        left_s = rows["passed_s"].fillna(math.inf).to_numpy(float)
        late = left_s > due_s
        longest_s = max(longest_s, longest_queue_s(due_s[late], left_s[late], end_s))
    rounded_s = ROUND_S * math.ceil(longest_s / ROUND_S)
    return max(traffic.warm_up_s, min(rounded_s, traffic.duration_s))


def _cell(cell: Cell, settings: Mapping[str, float]) -> Cell:
    """Return the cell with new values of some keys in its scenario and in its varied keys."""
    varied = {key: settings.get(key, value) for key, value in cell.varied.items()}
    return Cell(cell.number, varied, _with(cell.scenario, settings))


def _with(scenario: Scenario, settings: Mapping[str, float]) -> Scenario:
    sections: dict[str, dict[str, float]] = {}
    for key, value in settings.items():
        section, name = key.split(".")
        sections.setdefault(section, {})[name] = value
    updated = {
        section: getattr(scenario, section).model_copy(update=values)
        for section, values in sections.items()
    }
    return scenario.model_copy(update=updated)
