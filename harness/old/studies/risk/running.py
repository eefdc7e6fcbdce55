"""Runs the batches of a risk estimate and keeps finished episodes for ``harness resume``.

Each batch follows from the earlier ones, so batches have a fixed order and are identified by their
numbers.  After an interruption the sampling starts again and reuses the stored episodes.  Results
depend neither on the number of workers nor on interruptions.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from pathlib import Path
from time import monotonic

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from harness.core.encounter import FloatArray
from harness.old.store.tables import Row, write_parquet
from harness.old.studies.risk.asking import Question
from harness.old.studies.risk.episodes import Episodes, Score, failed, run_episodes
from harness.old.studies.risk.event import GRADINGS
from harness.old.studies.risk.outcomes import Outcomes
from harness.old.studies.workers.execution import ATTEMPTS, call_each, reason_of
from harness.old.studies.workers.executor import Executor, ExecutorLostError
from harness.scenario import hang_limit_s
from harness.scenario.options import HANG_AFTER_S

FIRST_NUMBER = 2**40
"""Number of the first episode; its random streams differ from those of a run's pairs."""

KEPT_EVERY_S = 20.0
"""Time in s between two writes of finished episodes, which limits what a killed process loses."""

_CHUNK = 25
"""Number of episodes in a task; the results do not depend on it."""

_SCORES = pa.schema(
    {
        "at": pa.int64(),
        "score": pa.list_(pa.float64(), GRADINGS),
        "passed_s": pa.float64(),
        "passed_mps": pa.float64(),
        "timed_out": pa.bool_(),
        "reason": pa.string(),
        "drew_more": pa.bool_(),
        "culprit": pa.int64(),
        "own": pa.list_(pa.float64(), GRADINGS),
        "speeds_mps": pa.list_(pa.float64()),
        "culprit_index": pa.int64(),
        "contact": pa.string(),
    }
)
"""The fields of ``Score`` with the episode's position in the batch."""

Progress = Callable[[int, int, str], None]
"""Receives the numbers of finished and planned episodes, and their purpose."""


class Evaluation:
    """Runs batches on an executor.

    Args:
        question: the workers' input.
        folder: folder for the finished episodes.
        executor: runs tasks of episodes.
        progress: called with the progress of a batch.

    ``episodes``, ``timed_out``, ``drew_more`` and ``reasons`` (of failures) count over all batches
    so far.  ``events`` are the scores that ``tell`` found.
    """

    def __init__(
        self, question: Question, folder: Path, executor: Executor, progress: Progress
    ) -> None:
        self.question, self._folder = question, folder
        self.events = _SCORES.empty_table()
        self._executor, self._progress = executor, progress
        self._batches = 0
        self.episodes, self.timed_out, self.drew_more = 0, 0, 0
        self.reasons: list[str] = []

    def __call__(
        self,
        z: FloatArray,
        what: str,
        numbers: NDArray[np.int64] | None = None,
        asked: NDArray[np.int64] | None = None,
    ) -> Outcomes:
        """Run a batch; see ``Evaluate``."""
        if numbers is None:
            numbers = FIRST_NUMBER + self.episodes + np.arange(len(z))
        table = self._scores(z, numbers, asked, what, in_full=False)
        self.episodes += len(z)
        self.timed_out += pc.sum(table["timed_out"], min_count=0).as_py()
        self.drew_more += pc.sum(table["drew_more"], min_count=0).as_py()
        self.reasons += table["reason"].drop_null().to_pylist()
        score, own = (
            table[name].combine_chunks().flatten().to_numpy().reshape(-1, GRADINGS)
            for name in ("score", "own")
        )
        passed_s, passed_mps, culprit = (
            table[name].to_numpy() for name in ("passed_s", "passed_mps", "culprit")
        )
        return Outcomes(score, numbers, passed_s, passed_mps, culprit, own)

    def tell(self, z: FloatArray, numbers: NDArray[np.int64]) -> None:
        """Run the events of the estimate once more, for all that a ``Score`` can have."""
        self.events = self._scores(z, numbers, None, "events", in_full=True)

    def _scores(
        self,
        z: FloatArray,
        numbers: NDArray[np.int64],
        asked: NDArray[np.int64] | None,
        what: str,
        *,
        in_full: bool,
    ) -> pa.Table:
        """Return the scores of a batch in order.  Episodes without a stored score are run."""
        form = f"batch-{self._batches}-{{}}.parquet"
        self._batches += 1
        parts = [_SCORES.empty_table()]
        while (path := self._folder / form.format(len(parts))).is_file():
            parts.append(pq.read_table(path))
        kept = pa.concat_tables(parts)["at"].to_numpy()
        left = np.setdiff1d(np.arange(len(z)), kept)
        new_rows: list[Row] = []

        def keep() -> None:
            if new_rows:
                parts.append(pa.Table.from_pylist(new_rows, _SCORES))
                self._folder.mkdir(exist_ok=True)
                path = self._folder / form.format(len(parts) - 1)
                write_parquet(path, _SCORES, iter(parts[-1:]))
                new_rows.clear()

        kept_at = monotonic()
        try:
            for task, scores in self._finished(
                z[left], numbers[left], asked if asked is None else asked[left], in_full
            ):
                places = left[task.first : task.first + len(scores)].tolist()
                new_rows += [
                    {"at": place, **score._asdict()}
                    for place, score in zip(places, scores, strict=True)
                ]
                if monotonic() - kept_at > KEPT_EVERY_S:
                    keep()
                    kept_at = monotonic()
                self._progress(sum(map(len, (*parts, new_rows))), len(z), what)
        finally:
            keep()
        return pa.concat_tables(parts).sort_by("at")

    def _finished(
        self,
        z: FloatArray,
        numbers: NDArray[np.int64],
        asked: NDArray[np.int64] | None,
        in_full: bool,
    ) -> Iterator[tuple[Episodes, list[Score]]]:
        """Yield the tasks of some episodes as they finish."""
        question = self.question
        hang_s = hang_limit_s(HANG_AFTER_S, question.scenario)
        keys = tuple(numbers.tolist())
        places = None if asked is None else tuple(asked.tolist())
        waiting = [
            Episodes(
                question,
                i,
                keys[i : i + _CHUNK],
                z[i : i + _CHUNK],
                None if places is None else places[i : i + _CHUNK],
                in_full,
                hang_s,
            )
            for i in reversed(range(0, len(z), _CHUNK))
        ]
        failures: dict[int, int] = {}

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
                    reason = reason_of(error, hang_s, None)
                    yield task, [failed(reason)] * len(task.numbers)
