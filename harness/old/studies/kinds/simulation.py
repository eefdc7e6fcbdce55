"""The protocol by which a kind of run is simulated."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from harness.core.encounter import Arm
from harness.model.interaction import InteractionModel
from harness.old.store.tables import Tables
from harness.old.studies.kinds.tasks import Task, TaskResult
from harness.scenario import Cell, Scenario

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
        """A name that is unique within the run."""
        return f"{self.cell.number}-{self.pair}-{self.arm.value}"


@dataclass(frozen=True)
class ArmRows:
    """The rows of one arm as a run stores them, by table.

    ``failure`` is the reason why the engine did not finish.  ``traceback`` is the traceback of a
    strategy that raised.
    """

    tables: Tables
    failure: str | None = None
    traceback: str | None = None


@dataclass(frozen=True)
class Simulation:
    """The functions that simulate a kind of run.

    Attributes:
        run: runs every pair of a task and returns the results of ``task.each``.
        in_this_process: runs an arm on the simulation of this process.
        with_outputs: runs an arm in a fresh SUMO that writes its outputs into a folder.
        in_gui: runs an arm in sumo-gui.
        check: refuses a scenario that cannot be simulated, before anything is written.
        network: returns the network's file.
    """

    run: Callable[[Task], tuple[TaskResult, ...]]
    in_this_process: Callable[[ArmOfPair], ArmRows]
    with_outputs: Callable[[ArmOfPair, Path], ArmRows]
    in_gui: "Callable[[ArmOfPair, Gui], ArmRows]"
    check: Callable[[Scenario], object]
    network: Callable[[Scenario], Path]
