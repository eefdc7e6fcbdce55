"""Simulates the pairs of a task one after another in the one SUMO of this process."""

from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from dataclasses import replace
from functools import partial

import pyarrow as pa

from harness.core.encounter import Arm, Ending
from harness.engine.protocol import Engine
from harness.engine.shared import close_engine, open_engine
from harness.episode.arms import arm_key
from harness.episode.loop import Episode
from harness.episode.pairing import CHUNK_PAIRS, ArmOfPair, PairRunner
from harness.measures import Outcome
from harness.results.rows import rows_of
from harness.results.tables import Row, Tables
from harness.scenario import Cell, Scenario
from harness.studies.tasks import EpisodeId, Rows, Task

Tell = Callable[[EpisodeId | None, Sized | None], None]
"""Receives the episode that is about to begin, and what grows with every answer of its strategy.

The latter is None while the strategy is made, and both are None between two episodes.
"""

Runner = tuple[Cell, PairRunner]

_runners: dict[str, PairRunner] = {}
"""The runners of the cells that this process simulated last."""

_MOST_RUNNERS = 200


def run_task(task: Task, tell: Tell = lambda _episode, _states: None) -> Rows:
    """Simulate every episode of a task; those that were given up are recorded as failed.

    Args:
        task: the task.
        tell: see ``Tell``.
    """
    if task.outputs is not None:
        from harness.engine.recording import recording_engine

        return run_on(task, partial(recording_engine, task.outputs, task.arms[0]), tell)
    if len(_runners) > _MOST_RUNNERS:
        _runners.clear()
    runners = []
    try:
        for cell in task.cells:
            scenario, key = cell.scenario, repr((task.engine, cell.scenario, task.model.sha256))
            if key not in _runners:
                get_engine = partial(open_engine, scenario, task.engine)
                _runners[key] = PairRunner(scenario, task.model, get_engine)
            runners.append((cell, _runners[key]))
        return _simulated(task, runners, tell)
    except BaseException:
        close_engine()  # an interrupted episode must not affect the next one
        raise


def run_on(
    task: Task,
    make_engine: Callable[[Scenario], Engine],
    tell: Tell = lambda _episode, _states: None,
) -> Rows:
    """Simulate a task of one cell on an engine of its own, which is closed at the end."""
    close_engine()
    (cell,) = task.cells
    engine = make_engine(cell.scenario)
    try:
        return _simulated(
            task, [(cell, PairRunner(cell.scenario, task.model, lambda: engine))], tell
        )
    finally:
        if not getattr(engine, "closed", False):
            engine.close()


def _simulated(task: Task, runners: Sequence[Runner], tell: Tell) -> Rows:
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
            parts[cell.number].append(rows_of(cell.number, outcomes, traces=task.traces))
            events += [
                {
                    "event": "episode failed",
                    **EpisodeId(cell.number, outcome.pair, outcome.arm)._asdict(),
                    **{"strategy": outcome.strategy, "reason": outcome.record.reason},
                    "traceback": outcome.trace.traceback,
                }
                for outcome in outcomes
                if outcome.record.ending is Ending.ENGINE_FAILED
            ]
    tables = {
        number: {name: pa.concat_tables([each[name] for each in found]) for name in found[0]}
        for number, found in parts.items()
    }
    return Rows(tables, tuple(events))


def _outcomes(
    runner: PairRunner,
    cell: int,
    task: Task,
    pairs: range,
    known: Mapping[ArmOfPair, Outcome],
    tell: Tell,
) -> list[Outcome]:
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
