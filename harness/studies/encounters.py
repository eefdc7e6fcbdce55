"""Simulates the pairs of a task one after another in the one SUMO of this process."""

from collections.abc import Callable, Mapping, Sequence, Sized
from dataclasses import replace
from functools import partial

import pyarrow as pa

from harness.core.encounter import Arm, Ending
from harness.engine.protocol import Engine
from harness.engine.shared import close_engine, open_engine
from harness.episode.loop import Episode
from harness.episode.pairing import CHUNK_PAIRS, EpisodeKey, PairRunner
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
    decisions: dict[int, list[float]] = {cell.number: [] for cell in task.cells}
    events: list[Row] = []
    for begin in range(0, task.count, CHUNK_PAIRS):
        pairs = task.pairs[begin : begin + CHUNK_PAIRS]
        known = _given_up(task, runners, pairs)
        for cell, runner in runners:
            number = cell.number
            runner.decisions_s = decisions[number] if task.timed else None
            outcomes = _outcomes(runner, number, task, pairs, known, tell)
            known |= {runner.key(outcome.arm, outcome.pair): outcome for outcome in outcomes}
            parts[number].append(rows_of(number, outcomes, traces=task.traces))
            events += [
                {
                    "event": "episode failed",
                    **EpisodeId(number, outcome.pair, outcome.arm)._asdict(),
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
    return Rows(tables, tuple(events), decisions)


def _outcomes(
    runner: PairRunner,
    cell: int,
    task: Task,
    pairs: range,
    known: Mapping[EpisodeKey, Outcome],
    tell: Tell,
) -> list[Outcome]:
    def begins(pair: int, arm: Arm, episode: Episode) -> None:
        tell(EpisodeId(cell, pair, arm), episode.x_m)

    def asks(pair: int, arm: Arm) -> None:
        tell(EpisodeId(cell, pair, arm), None)

    return [*runner.run(pairs, begins, lambda: tell(None, None), known, task.arms, asks)]


def _given_up(task: Task, runners: Sequence[Runner], pairs: range) -> dict[EpisodeKey, Outcome]:
    """The failed outcomes of the episodes that are not tried again."""
    known, by_cell = {}, {cell.number: runner for cell, runner in runners}
    for episode, failure in task.given_up.items():
        if episode.pair in pairs:
            runner = by_cell[episode.cell]
            outcome = runner.hung(episode.arm, episode.pair, failure.reason)
            record = replace(outcome.record, failed_in=failure.failed_in)
            known[runner.key(episode.arm, episode.pair)] = replace(outcome, record=record)
    return known
