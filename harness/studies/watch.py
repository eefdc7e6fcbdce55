"""Shows stored episodes in sumo-gui: the same loop drives it, through TraCI."""

import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from harness.core.encounter import Arm, Ending
from harness.core.errors import EngineError, InputError
from harness.results.run import Run
from harness.studies import simulations
from harness.studies.encounters import run_task
from harness.studies.replay import Replayed, refuse_in_use, replayed, stored_tasks

_SHOW = {"start": "true", "quit-on-end": "true", "delay": "100"}
"""Options of sumo-gui for a simulation."""


def watch(
    run: Run,
    cell: int,
    pairs: range,
    arms: Sequence[Arm],
    screenshots: Path | None = None,
) -> list[Replayed]:
    """Run episodes again in sumo-gui in real time, one after the other.

    Args:
        run: a run.
        cell: number of the cell.
        pairs: numbers of the pairs.
        arms: the arms.
        screenshots: a new or empty folder for PNG files; several episodes each have one in it.

    Raises:
        InputError: the cell or a pair does not exist, there is no display, or the folder is not
            empty.
        EngineError: sumo-gui did not start, or its window was closed.
    """
    if screenshots is not None:
        refuse_in_use(screenshots, "--screenshots")
    tasks = stored_tasks(run, cell, pairs, arms)
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise InputError(
            "--gui",
            "there is no display (DISPLAY is not set)",
            "a desktop session, or a virtual one: install Xvfb and run `xvfb-run -a harness …`",
        )
    if run.kind == "simulations":
        if screenshots is not None:
            raise InputError("--screenshots", "is of encounters", "--gui without it")
        return [
            replayed(run, task, simulations.run_task(task, module="gui", more=_SHOW))
            for task in tasks
        ]
    from harness.engine.window import Window

    shown = []
    for task in tasks:
        folder, (arm,) = screenshots, task.arms
        if folder is not None:
            folder = folder / f"{task.first}-{arm}" if len(tasks) > 1 else folder
            folder.mkdir(parents=True, exist_ok=True)
        rows = run_task(task, make_engine=partial(Window, arm=arm, screenshots=folder))
        (episode,) = rows.tables[cell]["episodes"].to_pylist()
        if episode["ending"] == Ending.ENGINE_FAILED:
            raise EngineError(f"sumo-gui: {episode['reason']}")
        shown.append(replayed(run, task, rows))
    return shown
