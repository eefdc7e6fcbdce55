"""Repeats stored episodes or simulations: with SUMO's outputs, in sumo-gui, or in this process."""

import math
import os
import shutil
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa

from harness.core.errors import EngineError, InputError, Parameter
from harness.core.files import cannot_write
from harness.core.vocabulary import Arm, Ending
from harness.engine.configuration import read_config
from harness.engine.installation import check_packages
from harness.engine.network import network_of
from harness.engine.shared import close_engine
from harness.model.interaction import load_model
from harness.results.folder import read_cell
from harness.results.loaded_run import Run
from harness.results.tables import COUNTED, TABLES_OF, Tables
from harness.strategies.registry import source_digests
from harness.studies.running.claimed_folder import changes, simulated_with
from harness.studies.running.episodes import run_episodes, run_task
from harness.studies.running.tasks import Task, TaskRows
from harness.studies.running.workers import carried_out

TOLERANCE = 1e-6
"""Numbers are equal if they differ by at most this, absolutely or relatively."""

RECORDS = ("episodes", "pedestrians")
"""The tables of encounters that are compared; of simulations all are."""

_MOST_DIFFERENCES = 3
"""Differences of a replay from its record that are printed."""

Key = tuple[int, int]
"""Cell and pair."""

Traced = tuple[Tables, tuple[str, ...]]
"""The rows of a pair by table, and how they differ from its record."""


@dataclass(frozen=True)
class Replayed:
    """A repeated episode.

    Attributes:
        name: its folder, or its pair and arm.
        differences: how its record differs from the stored one, after what has changed since.
        problem: why there is no record, so that SUMO's files are incomplete; otherwise None.
        traceback: of a strategy that raised an exception.
    """

    name: str
    differences: tuple[str, ...] = ()
    problem: str | None = None
    traceback: str | None = None

    @property
    def row(self) -> dict[str, str]:
        """What a table says of it."""
        record = self.problem or ("differs" if self.differences else "is the stored one")
        some = "; ".join(self.differences[:_MOST_DIFFERENCES])
        return {"episode": self.name, "record": record, "differences": some}


def replay(run: Run, cell: int, pairs: range, arms: Sequence[Arm], out: Path) -> list[Replayed]:
    """Run episodes again; SUMO's files of each are in ``out/<pair>-<arm>``.

    Those of a single episode are in ``out``.  Times in SUMO's files are one step later than in the
    episode, because SUMO inserts the ego in its second step.

    Args:
        run: a run.
        cell: number of the cell.
        pairs: numbers of the pairs.
        arms: the arms.
        out: a new or empty folder.

    Raises:
        InputError: the cell or a pair does not exist, or ``out`` is not empty or cannot be written.
    """
    tasks = stored_tasks(run, cell, pairs, arms)
    refuse_in_use(out, "out")
    folders = [out / f"{each.first}-{each.arms[0]}" for each in tasks] if len(tasks) > 1 else [out]
    tasks = [replace(task, outputs=place) for task, place in zip(tasks, folders, strict=True)]
    net = network_of(run.scenario_of(cell)) if run.kind == "encounters" else None
    try:
        for place in folders:
            place.mkdir(parents=True, exist_ok=True)
            if net is not None:
                shutil.copyfile(net, place / "site.net.xml")
        done = zip(tasks, carried_out(tasks), strict=True)
        return [replayed(run, task, rows) for task, rows in done]
    except OSError as error:
        raise cannot_write(out, error) from None
    except KeyboardInterrupt:
        shutil.rmtree(out, ignore_errors=True)
        raise


def debug(run: Run, cell: int, pairs: range, arms: Sequence[Arm]) -> list[Replayed]:
    """Run episodes again in this process, so that ``breakpoint()`` works in a strategy.

    Standard input is that of this process, and there are no time limits.

    Raises:
        InputError: the cell or a pair does not exist.
    """
    tasks = stored_tasks(run, cell, pairs, arms)
    try:
        return [replayed(run, task, run_task(task)) for task in tasks]
    finally:
        close_engine()


def watch(run: Run, cell: int, pairs: range, arms: Sequence[Arm]) -> list[Replayed]:
    """Run episodes again in sumo-gui in real time, one after the other.

    Args:
        run: a run.
        cell: number of the cell.
        pairs: numbers of the pairs.
        arms: the arms.

    Raises:
        InputError: the cell or a pair does not exist, or there is no display.
        EngineError: sumo-gui did not start, or its window was closed.
    """
    tasks = stored_tasks(run, cell, pairs, arms)
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise InputError(
            "DISPLAY",
            "is not set, so there is no display",
            "a desktop session, or a virtual one: install Xvfb and run `xvfb-run -a harness …`",
        )
    # What a run does not simulate is not imported, and only this function opens windows.
    from harness.engine.window import Window, window_options

    if run.kind == "simulations":
        from harness.studies.running.simulations import simulate_task

        shown = (simulate_task(task, window=window_options()) for task in tasks)
        return [replayed(run, task, rows) for task, rows in zip(tasks, shown, strict=True)]
    found = []
    for task in tasks:
        rows = run_episodes(task, make_engine=partial(Window, arm=task.arms[0]))
        (episode,) = rows.tables[cell]["episodes"].to_pylist()
        if episode["failed_in"] == "engine":
            raise EngineError(f"sumo-gui: {episode['reason']}")
        found.append(replayed(run, task, rows))
    return found


def stored_tasks(run: Run, cell: int, pairs: Sequence[int], arms: Sequence[Arm]) -> list[Task]:
    """A task for each of these episodes.

    Raises:
        InputError: the cell or a pair does not exist, or SUMO or the model is missing.
    """
    check_pairs(run, cell, pairs)
    check_packages()
    chosen = run.study.cells[cell]
    model = load_model(chosen.scenario.model.name, chosen.scenario.model.path)
    code = source_digests(chosen.scenario.arms.model_dump().values())
    task = Task((chosen,), model, 0, 1, code=code)
    return [replace(task, first=pair, arms=(arm,)) for pair in pairs for arm in arms]


def check_pairs(run: Run, cell: int, pairs: Sequence[int]) -> None:
    """Raise an ``InputError`` if the cell or a pair does not exist."""
    known = set(run.rows(TABLES_OF[run.kind][0].name, cell)["pair"].to_pylist())
    if (odd := next((pair for pair in pairs if pair not in known), None)) is not None:
        raise InputError(Parameter("pair", odd), "there is none", f"0 to {max(known, default=0)}")


def traced(run: Run, keys: Collection[Key], arms: tuple[Arm, ...]) -> dict[Key, Traced]:
    """The tables of pairs with their traces, and how the pairs differ from their records.

    They are simulated again if the run kept no traces; otherwise they have both arms.
    """
    found: dict[Key, Traced] = {}
    if run.manifest["traces"]:
        names = [table.name for table in TABLES_OF["encounters"]]
        for cell, pair in keys:
            stored = {name: read_cell(run.path, name, cell, run.manifest, pair) for name in names}
            found[cell, pair] = stored, ()
        return found
    tasks = [
        replace(task, arms=arms, traces=True, engine=run.manifest["engine"])
        for cell in sorted({cell for cell, _ in keys})
        for task in stored_tasks(run, cell, [pair for of, pair in keys if of == cell], arms[:1])
    ]
    for task, rows in zip(tasks, carried_out(tasks), strict=True):
        for cell, tables in rows.tables.items():
            differences = differences_of(run, cell, task.first, tables, arms)
            found[cell, task.first] = tables, differences
    return found


def refuse_in_use(folder: Path, name: str) -> None:
    """Raise if a folder for new files is a file or is not empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(Parameter(name, folder), "is not empty", "a new or empty folder")


def replayed(run: Run, task: Task, rows: TaskRows) -> Replayed:
    """How a repeated episode differs from its record."""
    (cell,), (arm,) = task.cells, task.arms
    tables = rows.tables[cell.number]
    found = differences_of(run, cell.number, task.first, tables, [arm])
    name = f"pair {task.first}, arm {arm}" if task.outputs is None else str(task.outputs)
    traceback = next((each.get("traceback") for each in rows.events), None)
    (episode,) = tables[TABLES_OF[run.kind][0].name].to_pylist()
    failed = episode["reason"] is not None
    if run.kind == "encounters":
        failed = episode["ending"] == Ending.FAILED and not episode["steps"]
    return Replayed(name, found, episode["reason"] if failed and found else None, traceback)


def differences_of(
    run: Run, cell: int, pair: int, tables: Mapping[str, pa.Table], arms: Sequence[Arm]
) -> tuple[str, ...]:
    """How repeated episodes differ from their record, after what has changed since the run.

    SUMO's verdict on collisions is not compared with the plain engine, which has none.
    """
    found: list[str] = []
    names = RECORDS if run.kind == "encounters" else COUNTED["simulations"]
    for name in names:
        stored = read_cell(run.path, name, cell, run.manifest, pair).to_pylist()
        old, now = [row for row in stored if row["arm"] in arms], tables[name].to_pylist()
        if len(old) != len(now):
            found.append(f"{name}: {len(now)} rows instead of {len(old)}")
            continue
        found += [
            f"{name}.{column}: {new[column]!r} instead of {row[column]!r}"
            for row, new in zip(old, now, strict=True)
            for column in row
            if not _same(row[column], new[column])
            if column != "sumo_collision" or run.manifest["engine"] == "sumo"
        ]
    if found:
        scenario = run.scenario_of(cell)
        model = load_model(scenario.model.name, scenario.model.path)
        user = scenario.simulation
        files = {} if user is None else read_config(Path(user.file), user.step_s).digests
        now_with = simulated_with(scenario.arms.model_dump().values(), [model], files)
        found = [*changes(run.manifest["simulated_with"], now_with), *found]
    return tuple(found)


def _same(old: Any, new: Any) -> bool:
    if isinstance(old, float) and isinstance(new, float):
        return math.isclose(old, new, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    if isinstance(old, list) and isinstance(new, list):
        return len(old) == len(new) and all(map(_same, old, new))
    if isinstance(old, dict) and isinstance(new, dict):
        return all(_same(old[key], new.get(key)) for key in old)
    return bool(old == new)
