"""Tasks, their results, and the protocol of executors that run them.

This module imports nothing heavy, so that worker processes and their parent import in parallel.
"""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from harness.core.errors import HarnessError

if TYPE_CHECKING:
    import pyarrow as pa

    from harness.core.encounter import Arm
    from harness.model.interaction import InteractionModel
    from harness.scenario import EngineName, Scenario
    from harness.studies.workers.audit import Audit

Failure = tuple[int, int, str, str]
"""(cell, pair, arm, reason) of an episode that came to nothing."""

Argument = TypeVar("Argument")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Task:
    """Some pairs of one cell.

    ``twins`` are tasks of the same pairs of cells that differ in their arms alone: an episode that
    several of them have is simulated once.  ``engine`` moves the egos; with an ``audit`` some
    episodes are repeated in SUMO.

    ``hung``, of a task of one pair: the arm whose strategy gave no answer, and how that is said;
    only the other one is simulated.

    ``stack_file`` is where a worker that hangs for ``hang_after_s`` in one pair leaves its Python
    stack before it ends itself; None, or a path it cannot open, drops the stack.
    """

    cell: int
    first_pair: int
    count: int
    scenario: "Scenario"
    model: "InteractionModel"
    traces: bool
    hang_after_s: float
    stack_file: Path | None
    engine: "EngineName" = "sumo"
    audit: "Audit | None" = None
    twins: "tuple[Task, ...]" = ()
    hung: "tuple[Arm, str] | None" = None

    @property
    def each(self) -> "tuple[Task, ...]":
        """The task of every cell, on its own."""
        return replace(self, twins=()), *self.twins

    @property
    def name(self) -> str:
        """Identifies the task among all of a run."""
        return f"{self.cell}-{self.first_pair}-{self.count}"

    @property
    def pairs(self) -> range:
        """The pairs to run."""
        return range(self.first_pair, self.first_pair + self.count)


@dataclass(frozen=True)
class TaskResult:
    """The tables by name, and what the log says of failed episodes.

    ``took_s`` is how long its worker was busy with it.
    """

    tables: "dict[str, pa.Table]"
    failures: tuple[dict[str, Any], ...] = ()
    took_s: float = 0.0


class Executor(Protocol):
    """Runs calls somewhere, each in a process that may die of it."""

    workers: int

    def submit(
        self, function: Callable[[Argument], Result], argument: Argument
    ) -> "Future[Result]":
        """Start a call; the future raises if the call raised or its worker died.

        Args:
            function: a function of a module, by which it is found in the worker.
            argument: what it is called with; pickled.
        """
        ...

    def stop(self) -> None:
        """End everything at once."""
        ...


class ExecutorLostError(HarnessError):
    """Whatever runs the tasks is gone; no task is to blame."""


class WorkerDiedError(HarnessError):
    """The process that worked on a task is gone."""


class TaskFailedError(HarnessError):
    """A task raised in its worker, which goes on; the message says what."""
