"""What runs inside a worker process: one task, on the one SUMO simulation of the process."""

import faulthandler
import importlib
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Any

from harness.encounter import Ending
from harness.engine.process import close_engine, engine_for
from harness.episode.pairing import PairRunner
from harness.errors import in_one_line
from harness.measures import Outcome
from harness.results.tables import episode_rows, pedestrian_rows, trace_rows
from harness.workers.tasks import Task, TaskResult

_runner: tuple[str, PairRunner] | None = None


def serve(connection: Connection, module: str) -> None:
    """Answer the calls that come down a pipe, until it or the parent process is gone.

    The first message is None when everything is imported, ``module`` included, or says why not.
    The answer to a call is (True, its result), or (False, why there is none).
    """
    try:
        importlib.import_module(module)
    except Exception as error:
        connection.send(in_one_line(error))
        return
    connection.send(None)
    while True:
        try:
            function, argument = connection.recv()
        except EOFError:
            return
        try:
            answer = (True, function(argument))
        except BaseException as error:  # a strategy may well call sys.exit
            answer = (False, f"{type(error).__name__}: {error}")
        connection.send(answer)


def run_task(task: Task) -> TaskResult:
    """Run every pair of a task."""
    try:
        runner = _runner_for(task)
        with watchdog(task.hang_after_s, task.stack_file) as alive:
            outcomes = list(runner.run(task.pairs, alive))
    except BaseException:
        # Nothing of an episode that was broken off may reach the next one.
        close_engine()
        raise
    return _result_of(task, outcomes)


def _result_of(task: Task, outcomes: list[Outcome]) -> TaskResult:
    rows = {
        "episodes": episode_rows(task.cell, outcomes),
        "pedestrians": pedestrian_rows(task.cell, outcomes),
    }
    if task.traces:
        rows["traces"] = trace_rows(task.cell, outcomes)
    return TaskResult(rows, tuple(_failures(task.cell, outcomes)))


def _failures(cell: int, outcomes: list[Outcome]) -> Iterator[dict[str, Any]]:
    for outcome in outcomes:
        if outcome.record.ending is Ending.ENGINE_FAILED:
            yield {
                "cell": cell,
                "pair": outcome.pair,
                "arm": outcome.arm.value,
                "strategy": outcome.strategy,
                "reason": outcome.record.reason,
                "traceback": outcome.trace.traceback,
            }


@contextmanager
def watchdog(hang_after_s: float, stack_file: Path | None) -> Iterator[Callable[[], None]]:
    """Ends the process when no pair is finished for too long, hung C code included.

    faulthandler's watchdog is a thread of its own that needs no interpreter lock; it writes the
    Python stack and exits the process, which the parent then sees as a dead worker.  To wind it up
    costs a thread, so that is done at every tenth of the limit and for as much longer.
    """
    pause_s = hang_after_s / 10
    wound_up_s = -math.inf
    with _open_for_writing(stack_file) as file:

        def alive() -> None:
            nonlocal wound_up_s
            now_s = time.monotonic()
            if now_s - wound_up_s >= pause_s:
                faulthandler.dump_traceback_later(hang_after_s + pause_s, exit=True, file=file)
                wound_up_s = now_s

        alive()
        try:
            yield alive
        finally:
            faulthandler.cancel_dump_traceback_later()
    if stack_file:
        stack_file.unlink(missing_ok=True)


def _open_for_writing(path: Path | None) -> IO[str]:
    """The file, or nowhere: a worker on another machine may not see the run folder."""
    try:
        return (path or Path(os.devnull)).open("w", encoding="utf-8")
    except OSError:
        return Path(os.devnull).open("w", encoding="utf-8")


def _runner_for(task: Task) -> PairRunner:
    """The runner of a cell; made again only when the cell changes."""
    global _runner
    key = repr((task.scenario, task.model.sha256))
    if _runner is None or _runner[0] != key:
        runner = PairRunner(task.scenario, task.model, lambda: engine_for(task.scenario))
        _runner = (key, runner)
    return _runner[1]
