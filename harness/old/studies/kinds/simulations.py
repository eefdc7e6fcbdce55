"""Simulates a user's own scenario.  Every arm is one SUMO simulation from begin to end."""

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from harness.core.encounter import Arm
from harness.core.errors import EngineError
from harness.encounter.simulation.pairing import GetFolder, SimulationRunner
from harness.engine.shared import close_engine
from harness.engine.simulation.outputs import NOTHING, Kept, check_outputs
from harness.engine.simulation.running import OwnSimulation, check_starts, write_config
from harness.engine.starting import scratch_prefix
from harness.old.store.simulations.simulation_tables import simulation_rows
from harness.old.store.simulations.simulation_traces import simulation_trace_rows
from harness.old.studies.kinds.outputs import PRECISION
from harness.old.studies.kinds.simulation import ArmOfPair, ArmRows, Simulation
from harness.old.studies.kinds.tasks import Task, TaskResult
from harness.old.studies.kinds.watchdog import watchdog
from harness.scenario import Scenario
from harness.scenario.own_simulation import setting_of

if TYPE_CHECKING:
    from harness.engine.traci import Gui


_FCD = "fcd.xml"
_COLLISIONS = {"collision-output": "collisions.xml"}
"""Further outputs of an arm that runs again, which a run itself does not keep."""


def _folders(cell: int, outputs: Path | None) -> GetFolder:
    """Return a function that gives the folder of each arm.

    The folders are kept below ``outputs``; without ``outputs`` each is removed after its arm.
    """

    def folder_of(pair: int, arm: Arm) -> AbstractContextManager[Path]:
        if outputs is None:
            return _scratch()
        return _kept(outputs / f"{cell}-{pair}-{arm.value}")

    return folder_of


@contextmanager
def _scratch() -> Iterator[Path]:
    with TemporaryDirectory(prefix=scratch_prefix(os.getpid())) as folder:
        yield Path(folder)


@contextmanager
def _kept(folder: Path) -> Iterator[Path]:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise EngineError(f"{folder} cannot be written ({error.strerror})") from None
    # SUMO resolves relative paths from the folder of the configuration.
    yield folder.absolute()


def _run(task: Task) -> tuple[TaskResult, ...]:
    # libsumo allows one simulation in a process.
    close_engine()
    runner = SimulationRunner(task.scenario, task.model, _folders(task.cell, task.outputs))
    with watchdog(task.hang_after_s, task.stack_file) as watch:
        outcomes = list(runner.run(task.pairs, watch.alive))
    failures = tuple(
        {
            "cell": task.cell,
            "pair": outcome.pair,
            "arm": outcome.arm.value,
            "reason": outcome.reason,
            "traceback": outcome.traceback,
        }
        for outcome in outcomes
        if outcome.reason is not None
    )
    tables = simulation_rows(task.cell, outcomes)
    if task.traces:
        tables |= simulation_trace_rows(task.cell, outcomes)
    return (TaskResult(tables, failures),)


def _check(scenario: Scenario) -> None:
    """Refuse a scenario that SUMO refuses, and outputs that the scenario does not have."""
    setting, simulation = setting_of(scenario), scenario.known_simulation
    check_outputs(setting.config, simulation.outputs, "simulation.outputs")
    with _scratch() as folder:
        path = write_config(
            setting.config, Kept(folder, NOTHING), setting.config.seed, simulation.step_s
        )
        check_starts(path, f"simulation.config: {simulation.config}")


def _in_this_process(arm: ArmOfPair) -> ArmRows:
    close_engine()
    runner = SimulationRunner(arm.scenario, arm.model, lambda _pair, _arm: _scratch())
    return _rows(arm, runner)


def _with_outputs(arm: ArmOfPair, folder: Path) -> ArmRows:
    """Run an arm, and run it again for FCD.

    SUMO has one precision for all files, and the record is made of trips in that of the scenario.
    """
    close_engine()
    rows = _rows(
        arm,
        SimulationRunner(
            arm.scenario, arm.model, lambda _pair, _arm: _kept(folder), more=_COLLISIONS
        ),
    )
    fcd = {"fcd-output": str(folder.absolute() / _FCD), "precision": PRECISION}
    again = _rows(
        arm, SimulationRunner(arm.scenario, arm.model, lambda _pair, _arm: _scratch(), more=fcd)
    )
    # If only the second one failed, its FCD is not that of the record.
    return rows if again.failure == rows.failure else again


def _in_gui(arm: ArmOfPair, gui: "Gui") -> ArmRows:
    from harness.engine.traci import gui_simulation

    moment = gui.moment
    assert moment is not None

    def begin(path: Path, end_s: float | None) -> OwnSimulation:
        return gui_simulation(path, end_s, gui, moment, coloured=arm.arm is Arm.AV)

    runner = SimulationRunner(arm.scenario, arm.model, lambda _pair, _arm: _scratch(), begin)
    return _rows(arm, runner)


def _rows(arm: ArmOfPair, runner: SimulationRunner) -> ArmRows:
    outcome = runner.run_arm(arm.pair, arm.arm)
    tables = simulation_rows(arm.cell.number, [outcome])
    return ArmRows(tables, outcome.reason, outcome.traceback)


OWN_SIMULATION = Simulation(
    run=_run,
    in_this_process=_in_this_process,
    with_outputs=_with_outputs,
    in_gui=_in_gui,
    check=_check,
    network=lambda scenario: setting_of(scenario).config.net,
)
