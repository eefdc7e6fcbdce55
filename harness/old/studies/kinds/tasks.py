"""Tasks, and their results."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.model.interaction import InteractionModel
    from harness.old.store.tables import Tables
    from harness.scenario import Scenario

Failure = tuple[int, int, str, str]
"""Cell, pair, arm and reason of an episode that has no result."""

LoggedFailure = Mapping[str, int | str | None]
"""The log's details of a failed episode."""


@dataclass(frozen=True)
class Task:
    """Some pairs of one cell.

    ``twins`` are tasks of the same pairs in cells that differ only in their arms.  Episodes that
    they share are simulated once.

    ``outputs`` is the folder in which SUMO's own outputs of a user's simulation are kept.

    A worker that hangs for ``hang_after_s`` in one pair writes its Python stack to ``stack_file``
    and ends itself.  If the path is None or cannot be opened, the stack is lost.
    """

    cell: int
    first_pair: int
    count: int
    scenario: "Scenario"
    model: "InteractionModel"
    traces: bool
    hang_after_s: float
    stack_file: Path | None
    outputs: Path | None = None
    twins: "tuple[Task, ...]" = ()

    @property
    def each(self) -> "tuple[Task, ...]":
        """The task of each cell without its twins."""
        return replace(self, twins=()), *self.twins

    @property
    def name(self) -> str:
        """A name that is unique within the run."""
        return f"{self.cell}-{self.first_pair}-{self.count}"

    @property
    def pairs(self) -> range:
        """The pairs to run."""
        return range(self.first_pair, self.first_pair + self.count)


@dataclass(frozen=True)
class TaskResult:
    """The tables by name, and the log's details of failed episodes."""

    tables: "Tables"
    failures: tuple[LoggedFailure, ...] = ()
