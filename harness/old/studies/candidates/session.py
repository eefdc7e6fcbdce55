"""Drives candidates with workers that stay open, and keeps the episodes of the reference."""

from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np
import pyarrow as pa

from harness.core.encounter import Arm, FloatArray
from harness.core.errors import refused_at
from harness.engine.installation import check_packages
from harness.episode.arms import check_arms
from harness.model.interaction import InteractionModel, load_model
from harness.old.store.schemas import EPISODES
from harness.old.studies.kinds.table import simulation_of
from harness.old.studies.kinds.tasks import Task
from harness.old.studies.workers.execution import run_tasks
from harness.old.studies.workers.executor import Executor
from harness.old.studies.workers.pool import LocalPool, default_workers
from harness.old.studies.workers.this_process import ThisProcess
from harness.scenario import EngineName, Options, Scenario, hang_limit_s
from harness.scenario.options import HANG_AFTER_S, TASK_PAIRS
from harness.strategies.own import is_of_this_process
from harness.strategies.perception.sensor import sensor_of
from harness.strategies.registry import source_digests

MOST_REFERENCES = 16
"""Number of references whose episodes are kept; the oldest is forgotten first."""


@dataclass(frozen=True)
class Driven:
    """The rows of ``episodes`` of a candidate by pair, AV first, and the AV's wall times in s."""

    rows: pa.Table
    decisions_s: FloatArray

    @property
    def failure(self) -> str | None:
        """The first failure of an episode with its pair and arm; None if no episode failed."""
        for row in self.rows.select(["pair", "arm", "reason"]).to_pylist():
            if row["reason"] is not None:
                return f"pair {row['pair']} {row['arm']}: {row['reason']}"
        return None


class _Part(NamedTuple):
    """A scenario with its loaded model."""

    scenario: Scenario
    model: InteractionModel


class Session:
    """Workers that stay open until ``close``, and the episodes of references.

    Args:
        workers: number of processes; None uses all cores; 0 uses this process alone, without time
            limits.
        engine: simulates the egos.

    ``references`` counts the episodes of references that were simulated.
    """

    def __init__(self, workers: int | None = None, engine: EngineName = "sumo") -> None:
        options = Options(workers=workers, engine=engine)
        self._workers, self._engine = options.workers, options.engine
        self._executor: Executor | None = None
        self._code: dict[str, str] = {}
        self._here = False
        self._kept: OrderedDict[str, dict[int, pa.Table]] = OrderedDict()
        self._stacks = TemporaryDirectory(prefix="harness-candidates-")
        self.references = 0

    def __enter__(self) -> Self:
        """Return the session."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the session."""
        self.close()

    def close(self) -> None:
        """End the workers at once."""
        self._stop()
        self._stacks.cleanup()

    def drive(
        self,
        scenarios: Sequence[Scenario],
        pairs: range,
        *,
        timed: bool = False,
        numbered: bool = False,
    ) -> list[Driven]:
        """Simulate the pairs of every scenario; references that are known are not driven again.

        Args:
            scenarios: checked scenarios of encounters.
            pairs: numbers of the pairs, at least one.
            timed: whether the wall times of the AVs' decisions are measured.
            numbered: whether a refusal has the scenario's number, as one of several candidates.

        Raises:
            InputError: a strategy or a network is refused.
            KeyboardInterrupt: Ctrl-C; the workers are ended, and start again with the next call.
        """
        check_packages()
        load = cache(load_model)
        models = [load(*scenario.model.file_and_refits) for scenario in scenarios]
        parts = list(map(_Part, scenarios, models))
        for number, part in enumerate(parts):
            with refused_at(f"candidates[{number}]" if numbered else ""):
                check_arms(*part)
                simulation_of(part.scenario).check(part.scenario)
        references = {_reference_key(part, self._engine): part for part in parts}
        try:
            self._open({name for part in parts for name in _drivers(part.scenario)})
            self._drive_references(references, pairs)
            driven = self._driven(parts, Arm.AV, [pairs] * len(parts), timed=timed)
        except BaseException:
            # Workers may be in the middle of tasks that nobody waits for.
            self._stop()
            raise
        known = [self._kept[_reference_key(part, self._engine)] for part in parts]
        while len(self._kept) > MOST_REFERENCES:
            self._kept.popitem(last=False)
        return [
            Driven(_by_pair(rows, [human[pair] for pair in pairs]), np.array(decisions_s))
            for (rows, decisions_s), human in zip(driven, known, strict=True)
        ]

    def _drive_references(self, references: Mapping[str, _Part], pairs: range) -> None:
        """Simulate the reference's arm of the pairs that are not kept."""
        missing = []
        for key in references:
            kept = self._kept.setdefault(key, {})
            self._kept.move_to_end(key)
            missing.append([pair for pair in pairs if pair not in kept])
        driven = self._driven([*references.values()], Arm.HUMAN, missing)
        for key, (rows, _) in zip(references, driven, strict=True):
            for place, pair in enumerate(rows["pair"].to_pylist()):
                self._kept[key][pair] = rows.slice(place, 1)
        self.references += sum(map(len, missing))

    def _driven(
        self,
        parts: Sequence[_Part],
        arm: Arm,
        pairs: Sequence[Sequence[int]],
        *,
        timed: bool = False,
    ) -> list[tuple[pa.Table, list[float]]]:
        """The rows of an arm of each part by pair, and the wall times of its decisions."""
        assert self._executor is not None
        share = -(-sum(map(len, pairs)) // (2 * self._executor.workers))
        size = max(1, min(TASK_PAIRS, share))
        tasks = (
            self._task(cell, part, arm, first, count, timed=timed)
            for cell, (part, numbers) in enumerate(zip(parts, pairs, strict=True))
            for first, count in _runs_of(numbers, size)
        )
        tables: list[list[pa.Table]] = [[] for _ in parts]
        decisions_s: list[list[float]] = [[] for _ in parts]
        for task, result in run_tasks(self._executor, tasks, lambda *_, **__: None):
            tables[task.cell].append(result.tables["episodes"])
            decisions_s[task.cell].extend(result.decisions_s)
        whole = [
            pa.concat_tables([EPISODES.empty_table(), *found]).sort_by("pair") for found in tables
        ]
        return list(zip(whole, decisions_s, strict=True))

    def _task(
        self, cell: int, part: _Part, arm: Arm, first: int, count: int, *, timed: bool
    ) -> Task:
        return Task(
            cell=cell,
            first_pair=first,
            count=count,
            scenario=part.scenario,
            model=part.model,
            traces=False,
            hang_after_s=hang_limit_s(HANG_AFTER_S, part.scenario),
            stack_file=Path(self._stacks.name) / f"{arm.value}-{cell}-{first}-{count}.txt",
            engine=self._engine,
            only=arm,
            timed=timed,
        )

    def _open(self, drivers: set[str]) -> None:
        """Start the workers, again if the code of a user's strategy or the kind of worker changed.

        A worker that has imported a module keeps its code.
        """
        here = self._workers == 0 or any(map(is_of_this_process, drivers))
        code = source_digests(drivers)
        changed = any(self._code.get(name, digest) != digest for name, digest in code.items())
        if changed or here != self._here:
            self._stop()
        self._here, self._code = here, self._code | code
        if self._executor is None:
            count = self._workers or default_workers()
            self._executor = ThisProcess() if here else LocalPool(count)

    def _stop(self) -> None:
        if self._executor is not None:
            self._executor.stop()
            self._executor = None


def _drivers(scenario: Scenario) -> list[str]:
    return [*scenario.arms.model_dump().values()]


def _reference_key(part: _Part, engine: EngineName) -> str:
    """Everything on which the reference's episodes depend, apart from the pair, as text."""
    scenario, model = part.scenario, part.model
    name = scenario.arms.human
    tree = scenario.model_dump()
    for key in ("arms", "strategies", "perception", "actuation", "conflicts"):
        del tree[key]
    del tree["experiment"]["pairs"]
    parameters = scenario.strategies.get(name, {})
    refits = model.refits and model.refits.sha256
    sensor, vehicle = sensor_of(scenario, Arm.HUMAN), scenario.vehicle(Arm.HUMAN)
    code = source_digests([name])
    return repr((tree, name, parameters, code, sensor, vehicle, model.sha256, refits, engine))


def _runs_of(numbers: Sequence[int], size: int) -> Iterator[tuple[int, int]]:
    """Consecutive numbers in parts of at most ``size``: the first number and the count of each."""
    first = 0
    for place in range(1, len(numbers) + 1):
        if (
            place == len(numbers)
            or numbers[place] != numbers[place - 1] + 1
            or place - first == size
        ):
            yield numbers[first], place - first
            first = place


def _by_pair(av: pa.Table, human: Sequence[pa.Table]) -> pa.Table:
    """The rows of both arms by pair, AV first."""
    count = len(human)
    order = np.arange(2 * count).reshape(2, count).T.ravel()
    return pa.concat_tables([av, *human]).take(pa.array(order)).combine_chunks()
