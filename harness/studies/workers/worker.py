"""Takes a task in a worker process and returns its tables, from the process's one SUMO."""

import importlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from time import perf_counter
from typing import Any

from harness.core.encounter import Ending
from harness.core.errors import in_one_line
from harness.engine.shared import close_engine, open_engine, road_for
from harness.episode.pairing import EpisodeKey, PairRunner
from harness.episode.traffic.pairing import HourRunner
from harness.measures import Outcome
from harness.scenario import EngineName
from harness.store.episode_tables import audit_rows, episode_rows, pedestrian_rows, trace_rows
from harness.store.hour_tables import hour_rows
from harness.store.hour_traces import hour_trace_rows
from harness.studies.workers.audit import Finding, repeated_in_sumo
from harness.studies.workers.tasks import Task, TaskResult
from harness.studies.workers.watchdog import Watch, watchdog

_cell = ""
_runners: dict[EngineName, PairRunner] = {}
"""The runners of the present cell, by engine."""


def serve(connection: Connection, module: str) -> None:
    """Answer calls from a pipe until the pipe or the parent process is closed.

    The first message is None after all imports, including ``module``, or the error of an import.
    The answer to a call is (True, its result) or (False, the reason why there is none).
    """
    # A broken pipe is not an error, because it means that the parent has ended.
    with suppress(EOFError, OSError):
        try:
            importlib.import_module(module)
        except Exception as error:
            connection.send(in_one_line(error))
            return
        connection.send(None)
        while True:
            function, argument = connection.recv()
            try:
                answer = (True, function(argument))
            except BaseException as error:  # a strategy may well call sys.exit
                answer = (False, f"{type(error).__name__}: {error}")
            connection.send(answer)


def run_task(task: Task) -> tuple[TaskResult, ...]:
    """Run every pair of a task and return the results of ``task.each``."""
    begin = perf_counter()
    try:
        if task.scenario.traffic is not None:
            return (_run_hours(task),)
        results = tuple(_run_encounters(task))
        took_s = (perf_counter() - begin) / len(results)
        return tuple(replace(result, took_s=took_s) for result in results)
    except BaseException:
        # An interrupted episode must not affect the next one.
        close_engine()
        raise


def _run_encounters(task: Task) -> Iterator[TaskResult]:
    known: dict[EpisodeKey, Outcome] = {}
    repeated: dict[EpisodeKey, Finding] = {}
    hung: set[EpisodeKey] = set()
    limit_s = task.scenario.experiment.decide_limit_s
    with watchdog(task.hang_after_s, task.stack_file, limit_s) as watch:
        for each in task.each:
            runner = _runner_for(each, each.engine)
            if each.hung is not None:
                arm, reason = each.hung
                key = runner.key(arm, each.first_pair)
                known[key] = runner.hung(arm, each.first_pair, reason)
                hung.add(key)
            outcomes = list(runner.run(each.pairs, watch.begins, watch.alive, known))
            known |= {runner.key(outcome.arm, outcome.pair): outcome for outcome in outcomes}
            # An episode that hung would also hang in SUMO and stop the other arm.
            ended = [
                outcome for outcome in outcomes if runner.key(outcome.arm, outcome.pair) not in hung
            ]
            yield _result_of(each, outcomes, list(_audited(each, ended, watch, repeated)))


def _audited(
    task: Task, outcomes: list[Outcome], watch: Watch, repeated: dict[EpisodeKey, Finding]
) -> Iterable[tuple[Outcome, Finding]]:
    if task.audit is None:
        return ()
    runners = _runner_for(task, "sumo"), _runner_for(task, task.engine)
    return repeated_in_sumo(outcomes, task.audit, *runners, watch, repeated)


def _run_hours(task: Task) -> TaskResult:
    """Run every pair of a task in traffic; the time limit applies to one hour."""
    runner = HourRunner(
        task.scenario, task.model, lambda: road_for(task.scenario), paths=task.traces
    )
    with watchdog(task.hang_after_s, task.stack_file) as watch:
        outcomes = list(runner.run(task.pairs, watch.alive))
    failures = tuple(
        {
            "cell": task.cell,
            "pair": outcome.pair,
            "arm": outcome.arm.value,
            "reason": outcome.reason,
            "traceback": outcome.traceback,
        }
        for outcome in outcomes
        if outcome.reason is not None
    )
    tables = hour_rows(task.cell, outcomes)
    if task.traces:
        tables |= hour_trace_rows(task.cell, outcomes)
    return TaskResult(tables, failures)


def _result_of(
    task: Task, outcomes: list[Outcome], audited: list[tuple[Outcome, Finding]]
) -> TaskResult:
    tables = {
        "episodes": episode_rows(task.cell, outcomes),
        "pedestrians": pedestrian_rows(task.cell, outcomes),
    }
    if task.traces:
        tables["traces"] = trace_rows(task.cell, outcomes)
    if task.audit is not None:
        tables["audit"] = audit_rows(task.cell, audited)
    return TaskResult(tables, tuple(_failures(task.cell, outcomes)))


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


def _runner_for(task: Task, engine: EngineName) -> PairRunner:
    """The runner of a cell on an engine; a new one is made only if the cell changes."""
    global _cell
    scenario = task.scenario
    cell = repr((scenario, task.model.sha256))
    if cell != _cell:
        _runners.clear()
        _cell = cell
    if engine not in _runners:
        _runners[engine] = PairRunner(scenario, task.model, lambda: open_engine(scenario, engine))
    return _runners[engine]
