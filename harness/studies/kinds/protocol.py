"""What the rooms that simulate a run need from its kind."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from harness.core.encounter import Arm
from harness.model.interaction import InteractionModel
from harness.scenario import Cell, Scenario
from harness.store.tables import Tables
from harness.studies.workers.tasks import Task, TaskResult
from harness.studies.workers.watchdog import Watch

if TYPE_CHECKING:
    from harness.engine.traci import Gui


@dataclass(frozen=True)
class ArmOfPair:
    """One arm of a pair, and everything that determines it."""

    cell: Cell
    model: InteractionModel
    pair: int
    arm: Arm

    @property
    def scenario(self) -> Scenario:
        """The scenario of the cell."""
        return self.cell.scenario

    @property
    def name(self) -> str:
        """Identifies the arm among all of a run."""
        return f"{self.cell.number}-{self.pair}-{self.arm.value}"


@dataclass(frozen=True)
class ArmRows:
    """The rows of one arm as a run stores them, by table.

    ``failure`` says why the engine came to no end, ``traceback`` where a strategy raised.
    """

    tables: Tables
    failure: str | None = None
    traceback: str | None = None


class Simulation(Protocol):
    """How a kind of run is simulated."""

    def run(self, task: Task) -> tuple[TaskResult, ...]:
        """Run every pair of a task; the results of ``task.each``."""
        ...

    def decide_limit_s(self, scenario: Scenario) -> float:
        """The time that a single decision may take, in s; infinite if only the pair has a limit."""
        ...

    def in_this_process(self, arm: ArmOfPair) -> ArmRows:
        """Run an arm on the simulation of this process."""
        ...

    def with_outputs(self, arm: ArmOfPair, folder: Path, watch: Watch) -> ArmRows:
        """Run an arm in a fresh SUMO that writes its outputs into a folder."""
        ...

    def in_gui(self, arm: ArmOfPair, gui: "Gui") -> ArmRows:
        """Run an arm in sumo-gui."""
        ...
