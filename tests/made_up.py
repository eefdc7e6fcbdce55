"""Runs whose episodes are made by hand: every number of what is reported can be counted."""

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from harness.core.encounter import Arm
from harness.old.store.schemas import PEDESTRIANS
from harness.old.store.tables import table_of
from harness.old.studies.batch.experiment import run_study
from harness.old.studies.kinds.tasks import Task, TaskResult
from harness.scenario import Options, Study

HUMAN_S = 10.0
FREE_S = 7.4
NOBODY = PEDESTRIANS.empty_table()

Fate = float | str | dict[str, Any]
"""Pass time in seconds, or how else the episode ended, or columns that differ from the usual."""

Fates = Callable[[Task, int], Fate | tuple[Fate, Fate]]
"""Of a task's pair: the AV's fate, the human then takes 10 s, or those of both."""


class MadeUp:
    """An executor whose episodes end as ``fates`` says."""

    workers = 1

    def __init__(self, fates: Fates) -> None:
        self.fates = fates

    def submit(self, _function: object, task: Task) -> "Future[tuple[TaskResult, ...]]":
        future: Future[tuple[TaskResult, ...]] = Future()
        future.set_result(tuple(map(self._result, task.each)))
        return future

    def _result(self, task: Task) -> TaskResult:
        rows = []
        for pair in range(task.first_pair, task.first_pair + task.count):
            fate = self.fates(task, pair)
            both = fate if isinstance(fate, tuple) else (fate, HUMAN_S)
            for arm, own in zip(Arm, both, strict=True):
                rows.append({"pair": pair, "arm": arm.value} | _episode(task, arm, own))
        return TaskResult({"episodes": table_of("episodes", rows), "pedestrians": NOBODY})

    def stop(self) -> None:
        """Nothing runs any more."""


def _episode(task: Task, arm: Arm, fate: Fate) -> dict[str, Any]:
    known = {
        "cell": task.cell,
        "strategy": getattr(task.scenario.arms, arm.value),
        "ending": "crossed",
        "stops": 0,
        "stopped_s": 0.0,
        "fallback": False,
        "steps": 100,
        "pedestrians": 1,
        "arrivals": 1,
        "pedestrian_delay_s": 0.0,
    }
    if isinstance(fate, float):
        return known | {
            "pass_time_s": fate,
            "pass_time_ignoring_contact_s": fate,
            "delay_s": fate - FREE_S,
        }
    changes = fate if isinstance(fate, dict) else {"ending": fate}
    if changes.get("ending") == "crashed":
        known |= {"contact": "front", "contact_time_s": 5.0, "contact_speed_mps": 5.0}
    if "pass_time_s" in changes:
        known |= _episode(task, arm, changes["pass_time_s"])
    return known | changes


def made_up(folder: Path, study: Study, fates: Fates, options: Options | None = None) -> Path:
    """The run folder of made-up episodes."""
    run_study(study, options or Options(), out=folder, make_executor=lambda _: MadeUp(fates))
    return folder
