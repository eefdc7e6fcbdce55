"""Runs the episodes of a risk batch by batch, and keeps what is finished.

The scores of a batch become a file as soon as all of them are there.  A risk that was interrupted
draws the same points again and finds their scores in the files.
"""

import io
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from pathlib import Path

import numpy as np
import pyarrow as pa
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

_CHUNK = 25
"""Episodes of a task; results do not depend on it."""

Progress = Callable[[int, int, str], None]
"""(done, planned, of what)."""


class Evaluation:
    """Runs batches on an executor.

    Args:
        question: what is asked.
        folder: where finished batches are kept.
        executor: runs tasks of episodes.
        progress: told how far a batch is.

    ``episodes``, ``timed_out`` and ``reasons`` count what the batches came across so far.
    """

    def __init__(
        self, question: Question, folder: Path, executor: Executor, progress: Progress
    ) -> None:
        self._question, self._folder = question, folder
        self._executor, self._progress = executor, progress
        self._batches = 0
        self._sampled: list[tuple[FloatArray, int]] = []
        self.episodes, self.timed_out = 0, 0
        self.reasons: list[str] = []

    def __call__(
        self, z: FloatArray, what: str, numbers: NDArray[np.int64] | None = None
    ) -> Outcomes:
        """Run a batch; see ``Evaluate``."""
        if numbers is None:
            numbers = FIRST_NUMBER + self.episodes + np.arange(len(z))
        path = self._folder / f"batch-{self._batches}.parquet"
        if path.is_file():
            table = pq.read_table(path)
        else:
            table = _table(list(self._run(z, numbers, what, compare=False)))
            content = io.BytesIO()
            pq.write_table(table, content)
            self._folder.mkdir(exist_ok=True)
            write_file(path, content.getvalue())
        first = -self.episodes % CHECKED_EVERY
        self._sampled += zip(z[first::CHECKED_EVERY], numbers[first::CHECKED_EVERY], strict=True)
        self._batches += 1
        self.episodes += len(z)
        self.timed_out += int(np.sum(table["timed_out"].to_numpy(zero_copy_only=False)))
        self.reasons += [why for why in table["reason"].to_pylist() if why is not None]
        graded = [table[f"score_{grading}"].to_numpy() for grading in range(GRADINGS)]
        return Outcomes(np.stack(graded, axis=1), table["passed_s"].to_numpy(), numbers)

    def compare(self, z: FloatArray, numbers: NDArray[np.int64]) -> tuple[int, list[str]]:
        """Run episodes in both engines: those given, and one in ``CHECKED_EVERY`` of all batches.

        Returns:
            How many were compared, and which records differ, in words.
        """
        chosen = [*self._sampled, *zip(z, numbers, strict=True)]
        if not chosen:
            return 0, []
        states, of = np.array([row for row, _ in chosen]), np.array([n for _, n in chosen])
        parts = self._run(states, of, "checks in SUMO", compare=True)
        return len(chosen), [words for part in parts for words in part.differs]

    def _run(
        self, z: FloatArray, numbers: NDArray[np.int64], what: str, *, compare: bool
    ) -> Iterator[Scores]:
        """The tasks of a batch, in order."""
        question = self._question
        hang_s = hang_limit_s(HANG_AFTER_S, question.scenario)
        keys = tuple(numbers.tolist())
        waiting = [
            Episodes(question, i, keys[i : i + _CHUNK], z[i : i + _CHUNK], compare, hang_s)
            for i in range(0, len(z), _CHUNK)
        ]
        done: dict[int, Scores] = {}
        failures: dict[int, int] = {}
        waiting.reverse()

        def take() -> Episodes | None:
            return waiting.pop() if waiting else None

        for task, future in call_each(self._executor, run_episodes, take):
            try:
                done[task.first] = future.result()
            except ExecutorLostError:
                raise
            except (Exception, CancelledError) as error:
                failures[task.first] = failures.get(task.first, 0) + 1
                if failures[task.first] < ATTEMPTS:
                    waiting.append(task)
                    continue
                done[task.first] = _given_up(task, reason_of(error, hang_s, None))
            self._progress(min(len(done) * _CHUNK, len(z)), len(z), what)
        for first in sorted(done):
            yield done[first]


def _table(scores: list[Scores]) -> pa.Table:
    score = np.concatenate([np.empty((0, GRADINGS)), *(part.score for part in scores)])
    reasons = [why for part in scores for why in part.reasons]
    return pa.table(
        {
            **{f"score_{grading}": score[:, grading] for grading in range(GRADINGS)},
            "passed_s": np.concatenate([np.empty(0), *(part.passed_s for part in scores)]),
            "timed_out": pa.array(
                [ended for part in scores for ended in part.timed_out], pa.bool_()
            ),
            "reason": pa.array(reasons, pa.string()),
        }
    )


def _given_up(task: Episodes, reason: str) -> Scores:
    """Episodes that no worker survived."""
    count = len(task.numbers)
    unknown = np.full((count, GRADINGS), np.nan)
    return Scores(unknown, unknown[:, 0], (False,) * count, (reason,) * count, ())
