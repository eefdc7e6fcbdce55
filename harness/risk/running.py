"""Runs the episodes of a risk batch by batch, and keeps what is finished.

What is finished of a batch becomes a file several times a minute, and when the risk is
interrupted.  A risk that goes on draws the same points again, finds their scores in the files, and
runs the others.
"""

import io
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from itertools import chain
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from harness.encounter import FloatArray
from harness.files import write_file
from harness.risk.episodes import Episodes, Question, Scores, run_episodes
from harness.risk.event import GRADINGS
from harness.risk.outcomes import Outcomes
from harness.scenario import hang_limit_s
from harness.scenario.options import HANG_AFTER_S
from harness.workers.execution import ATTEMPTS, call_each, reason_of
from harness.workers.tasks import Executor, ExecutorLostError

FIRST_NUMBER = 2**40
"""The number of a risk's first episode: its streams are not those of a run's pairs."""

CHECKED_EVERY = 100
"""Of so many episodes one is run in the other engine too."""

KEPT_EVERY_S = 20.0
"""So often what is finished is kept: a risk that is killed loses less than a minute."""

_CHUNK = 25
"""Episodes of a task; results do not depend on it."""

Progress = Callable[[int, int, str], None]
"""(done, planned, of what)."""


class Compared(NamedTuple):
    """How many episodes were run in both engines, and in words the records that differ.

    ``ties`` differ by a tie of the strategy; ``differs`` are the others.
    """

    episodes: int
    differs: list[str]
    ties: list[str]


class Evaluation:
    """Runs batches on an executor.

    Args:
        question: what is asked.
        folder: where finished batches are kept.
        executor: runs tasks of episodes.
        progress: told how far a batch is.

    ``episodes``, ``timed_out``, ``drew_more`` and ``reasons`` count what the batches came across so
    far.
    """

    def __init__(
        self, question: Question, folder: Path, executor: Executor, progress: Progress
    ) -> None:
        self._question, self._folder = question, folder
        self._executor, self._progress = executor, progress
        self._batches = 0
        self._sampled: list[tuple[FloatArray, int]] = []
        self.episodes, self.timed_out, self.drew_more = 0, 0, 0
        self.reasons: list[str] = []

    def __call__(
        self, z: FloatArray, what: str, numbers: NDArray[np.int64] | None = None
    ) -> Outcomes:
        """Run a batch; see ``Evaluate``."""
        if numbers is None:
            numbers = FIRST_NUMBER + self.episodes + np.arange(len(z))
        table = self._rows(z, numbers, what, compare=False)
        first = -self.episodes % CHECKED_EVERY
        self._sampled += zip(z[first::CHECKED_EVERY], numbers[first::CHECKED_EVERY], strict=True)
        self.episodes += len(z)
        self.timed_out += pc.sum(table["timed_out"], min_count=0).as_py()
        self.drew_more += pc.sum(table["drew_more"], min_count=0).as_py()
        self.reasons += [why for why in table["reason"].to_pylist() if why is not None]
        graded = [table[f"score_{grading}"].to_numpy() for grading in range(GRADINGS)]
        return Outcomes(np.stack(graded, axis=1), table["passed_s"].to_numpy(), numbers)

    def compare(self, z: FloatArray, numbers: NDArray[np.int64]) -> Compared:
        """Run episodes in both engines: those given, one in ``CHECKED_EVERY`` of all batches."""
        chosen = [*self._sampled, *zip(z, numbers, strict=True)]
        if not chosen:
            return Compared(0, [], [])
        states, of = np.array([row for row, _ in chosen]), np.array([n for _, n in chosen])
        table = self._rows(states, of, "checks in SUMO", compare=True)
        differs, ties = (
            table.filter(pc.equal(table["by_a_tie"], tie))["differs"].drop_null().to_pylist()
            for tie in (False, True)
        )
        return Compared(len(chosen), differs, ties)

    def _rows(
        self, z: FloatArray, numbers: NDArray[np.int64], what: str, *, compare: bool
    ) -> pa.Table:
        """The rows of a batch in order: those that were kept, and the others run."""
        form = f"batch-{self._batches}-{{}}.parquet"
        self._batches += 1
        parts = [_table(np.empty(0, dtype=np.int64), [])]
        while (path := self._folder / form.format(len(parts))).is_file():
            parts.append(pq.read_table(path))
        kept = pa.concat_tables(parts)["at"].to_numpy()
        left = np.setdiff1d(np.arange(len(z)), kept)
        fresh: list[Scores] = []
        rows: list[NDArray[np.int64]] = []

        def keep() -> None:
            if not fresh:
                return
            content = io.BytesIO()
            parts.append(_table(np.concatenate(rows), fresh))
            pq.write_table(parts[-1], content)
            self._folder.mkdir(exist_ok=True)
            write_file(self._folder / form.format(len(parts) - 1), content.getvalue())
            fresh.clear()
            rows.clear()

        done, kept_at = len(kept), monotonic()
        try:
            for task, scores in self._scored(z[left], numbers[left], compare=compare):
                own = left[task.first : task.first + len(task.numbers)]
                fresh.append(scores)
                rows.append(own)
                done += len(own)
                if monotonic() - kept_at > KEPT_EVERY_S:
                    keep()
                    kept_at = monotonic()
                self._progress(done, len(z), what)
        finally:
            keep()
        return pa.concat_tables(parts).sort_by("at")

    def _scored(
        self, z: FloatArray, numbers: NDArray[np.int64], *, compare: bool
    ) -> Iterator[tuple[Episodes, Scores]]:
        """The tasks of some episodes as they are finished."""
        question = self._question
        hang_s = hang_limit_s(HANG_AFTER_S, question.scenario)
        keys = tuple(numbers.tolist())
        waiting = [
            Episodes(question, i, keys[i : i + _CHUNK], z[i : i + _CHUNK], compare, hang_s)
            for i in range(0, len(z), _CHUNK)
        ]
        failures: dict[int, int] = {}
        waiting.reverse()

        def take() -> Episodes | None:
            return waiting.pop() if waiting else None

        for task, future in call_each(self._executor, run_episodes, take):
            try:
                yield task, future.result()
            except ExecutorLostError:
                raise
            except (Exception, CancelledError) as error:
                failures[task.first] = failures.get(task.first, 0) + 1
                if failures[task.first] < ATTEMPTS:
                    waiting.append(task)
                else:
                    yield task, _given_up(task, reason_of(error, hang_s, None))


def _table(rows: NDArray[np.int64], scores: list[Scores]) -> pa.Table:
    """Some rows of a batch, ``rows`` in it."""
    score = np.concatenate([np.empty((0, GRADINGS)), *(part.score for part in scores)])

    def column(of: Callable[[Scores], Iterable[Any]], kind: pa.DataType) -> pa.Array:
        return pa.array(chain.from_iterable(map(of, scores)), kind)

    return pa.table(
        {
            "at": rows,
            **{f"score_{grading}": score[:, grading] for grading in range(GRADINGS)},
            "passed_s": np.concatenate([np.empty(0), *(part.passed_s for part in scores)]),
            "timed_out": column(lambda part: part.timed_out, pa.bool_()),
            "reason": column(lambda part: part.reasons, pa.string()),
            "differs": column(lambda part: part.differs, pa.string()),
            "by_a_tie": column(lambda part: part.by_a_tie, pa.bool_()),
            "drew_more": column(lambda part: part.drew_more, pa.bool_()),
        }
    )


def _given_up(task: Episodes, reason: str) -> Scores:
    """Episodes that no worker survived."""
    count = len(task.numbers)
    unknown, no = np.full((count, GRADINGS), np.nan), (False,) * count
    return Scores(unknown, unknown[:, 0], no, (reason,) * count, (None,) * count, no, no)
