"""Simulates the episodes of a task in the one SUMO of this process."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import pyarrow as pa

from harness.core.vocabulary import Arm, Ending, ignore
from harness.encounter.arms import arm_key
from harness.encounter.loop import Episode
from harness.encounter.pairing import CHUNK_PAIRS, ArmOfPair, PairRunner
from harness.engine.protocol import Engine
from harness.engine.shared import close_engine, open_engine
from harness.measures import Outcome
from harness.results.rows import encounter_rows
from harness.results.tables import Row, Tables
from harness.scenario import Cell, Scenario
from harness.studies.running.tasks import EpisodeId, Task, TaskRows, Tell

Runner = tuple[Cell, PairRunner]


def run_task(task: Task, tell: Tell = ignore) -> TaskRows:
    """Simulate a task of any kind."""
    if task.own is not None:
        return task.own.run(task, tell)
    if task.cells[0].scenario.kind == "encounters":
        return run_episodes(task, tell)
    # What a run does not simulate is not imported.
    from harness.studies.running import simulations

    return simulations.simulate_task(task, tell)


def run_episodes(
    task: Task, tell: Tell = ignore, make_engine: Callable[[Scenario], Engine] | None = None
) -> TaskRows:
    """Simulate every episode of a task; those that were given up are recorded as failed.

    Args:
        task: the task.
        tell: see ``Tell``.
        make_engine: makes an engine for this task alone; None: the engine of this process.
    """
    if task.outputs is not None:
        from harness.engine.shared import recording_engine

        make_engine = partial(recording_engine, task.outputs, task.arms[0])
    if make_engine is not None:
        close_engine()  # a process has one simulation
    own: list[Engine] = []

    def get_engine(scenario: Scenario) -> Engine:
        if make_engine is None:
            return open_engine(scenario, task.engine)
        own.append(make_engine(scenario))
        return own[-1]

    try:
        runners = [
            (cell, PairRunner(cell.scenario, task.model, partial(get_engine, cell.scenario)))
            for cell in task.cells
        ]
        return _simulated(task, runners, tell)
    except BaseException:
        close_engine()  # an interrupted episode must not affect the next one
        raise
    finally:
        for engine in own:
            if not engine.closed:
                engine.close()


def _simulated(task: Task, runners: Sequence[Runner], tell: Tell) -> TaskRows:
    """The rows of a task's episodes; equal arms of several cells are simulated once."""
    parts: dict[int, list[Tables]] = {cell.number: [] for cell in task.cells}
    events: list[Row] = []
    for begin in range(0, task.count, CHUNK_PAIRS):
        pairs = task.pairs[begin : begin + CHUNK_PAIRS]
        shared: dict[tuple[str, int], Outcome] = {}
        for cell, runner in runners:
            keys = {arm: arm_key(cell.scenario, arm) for arm in task.arms}
            known = {
                (arm, pair): shared[key, pair]
                for arm, key in keys.items()
                for pair in pairs
                if key is not None and (key, pair) in shared
            }
            known |= dict(_given_up(task, cell, runner))
            outcomes = _outcomes(runner, cell.number, task, pairs, known, tell)
            for outcome in outcomes:
                if (key := keys[outcome.arm]) is not None:
                    shared[key, outcome.pair] = outcome
            parts[cell.number].append(encounter_rows(cell.number, outcomes, traces=task.traces))
            events += [
                task.failed(cell.number, of.pair, of.arm, of.record.reason, of.trace.traceback)
                for of in outcomes
                if of.record.ending is Ending.FAILED
            ]
    tables = {
        number: {name: pa.concat_tables([each[name] for each in found]) for name in found[0]}
        for number, found in parts.items()
    }
    return TaskRows(tables, tuple(events))


def _outcomes(
    runner: PairRunner,
    cell: int,
    task: Task,
    pairs: range,
    known: Mapping[ArmOfPair, Outcome],
    tell: Tell,
) -> list[Outcome]:
    """The outcomes of pairs of one cell; what begins is told before it runs."""

    def begins(pair: int, arm: Arm, episode: Episode) -> None:
        tell(EpisodeId(cell, pair, arm), episode.x_m)

    def asks(pair: int, arm: Arm) -> None:
        tell(EpisodeId(cell, pair, arm), None)

    return [*runner.run(pairs, begins, lambda: tell(None, None), known, task.arms, asks)]


def _given_up(task: Task, cell: Cell, runner: PairRunner) -> Iterator[tuple[ArmOfPair, Outcome]]:
    """The failed outcomes of a cell's episodes that are not tried again."""
    for (number, pair, arm), failure in task.given_up.items():
        if number == cell.number:
            outcome = runner.hung(arm, pair, failure.reason)
            record = replace(outcome.record, failed_in=failure.failed_in)
            yield (arm, pair), replace(outcome, record=record)
