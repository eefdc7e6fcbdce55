"""Simulates encounters one after another in the one SUMO of the process."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from harness.core.encounter import Arm, Ending
from harness.engine.control import SumoEngine
from harness.engine.network import network_of, place_of
from harness.engine.protocol import Engine
from harness.engine.shared import engine_for, open_engine
from harness.episode.pairing import Begins, PairRunner
from harness.measures import Outcome
from harness.old.store.episode_tables import episode_rows, pedestrian_rows, trace_rows
from harness.old.store.tables import Tables
from harness.old.studies.kinds.outputs import outputs_in
from harness.old.studies.kinds.simulation import ArmOfPair, ArmRows, Simulation
from harness.old.studies.kinds.tasks import LoggedFailure, Task, TaskResult
from harness.old.studies.kinds.watchdog import Watch, watchdog
from harness.scenario import Scenario

if TYPE_CHECKING:
    from harness.engine.traci import Gui

_current: tuple[str, PairRunner] | None = None
"""The runner of the current cell, after what it depends on."""

_UNWATCHED: Begins = lambda _pair, _arm, _episode: None  # noqa: E731


def _run(task: Task) -> tuple[TaskResult, ...]:
    begin = perf_counter()
    results = tuple(_run_encounters(task))
    took_s = (perf_counter() - begin) / len(results)
    return tuple(replace(result, took_s=took_s) for result in results)


def _decide_limit_s(scenario: Scenario) -> float:
    return scenario.experiment.decide_limit_s


def _in_this_process(arm: ArmOfPair) -> ArmRows:
    return _run_arm(arm, lambda: engine_for(arm.scenario))


def _with_outputs(arm: ArmOfPair, folder: Path, watch: Watch) -> ArmRows:
    from harness.engine.sumo import libsumo_engine

    scenario = arm.scenario
    place = place_of(scenario), scenario.vehicle(), scenario.crosswalk()
    step_s = scenario.experiment.step_s
    engine = libsumo_engine(*place, step_s, outputs=outputs_in(folder))
    return _run_once(arm, engine, watch.begins)


def _in_gui(arm: ArmOfPair, gui: "Gui") -> ArmRows:
    from harness.engine.traci import gui_engine

    scenario = arm.scenario
    place = place_of(scenario), scenario.vehicle(), scenario.crosswalk()
    return _run_once(arm, gui_engine(*place, scenario.experiment.step_s, gui))


def _run_once(arm: ArmOfPair, engine: SumoEngine, begins: Begins = _UNWATCHED) -> ArmRows:
    """Run an arm on an engine and close the engine."""
    engine.automated = arm.arm is Arm.AV
    try:
        return _run_arm(arm, lambda: engine, begins)
    finally:
        if not engine.closed:
            engine.close()


def _run_arm(
    arm: ArmOfPair, get_engine: Callable[[], Engine], begins: Begins = _UNWATCHED
) -> ArmRows:
    runner = PairRunner(arm.scenario, arm.model, get_engine)
    outcome = runner.run_arm(arm.pair, arm.arm, begins)
    failed = outcome.trace.ending is Ending.ENGINE_FAILED
    failure = outcome.trace.reason if failed else None
    return ArmRows(_tables(arm.cell.number, [outcome]), failure, outcome.trace.traceback)


def _tables(cell: int, outcomes: list[Outcome]) -> Tables:
    return {
        "episodes": episode_rows(cell, outcomes),
        "pedestrians": pedestrian_rows(cell, outcomes),
    }


def _run_encounters(task: Task) -> Iterator[TaskResult]:
    limit_s = task.scenario.experiment.decide_limit_s
    with watchdog(task.hang_after_s, task.stack_file, limit_s) as watch:
        for each in task.each:
            runner, known = _runner_for(each), {}
            if each.hung is not None:
                arm, reason = each.hung
                known[arm, each.first_pair] = runner.hung(arm, each.first_pair, reason)
            arms = tuple(Arm) if each.only is None else (each.only,)
            runner.decisions_s = [] if each.timed else None
            outcomes = list(runner.run(each.pairs, watch.begins, watch.alive, known, arms))
            tables = _tables(each.cell, outcomes)
            if each.traces:
                tables["traces"] = trace_rows(each.cell, outcomes)
            failures = tuple(_failures(each.cell, outcomes))
            yield TaskResult(tables, failures, decisions_s=tuple(runner.decisions_s or ()))


def _failures(cell: int, outcomes: list[Outcome]) -> Iterator[LoggedFailure]:
    for outcome in outcomes:
        if outcome.record.ending is Ending.ENGINE_FAILED:
            yield {
                "cell": cell,
                "pair": outcome.pair,
                "arm": outcome.arm.value,
                "strategy": outcome.strategy,
                "reason": outcome.record.reason,
                "traceback": outcome.trace.traceback,
            }


def _runner_for(task: Task) -> PairRunner:
    """Return the runner of a cell.  It is made again only when the cell changes."""
    global _current
    scenario, engine = task.scenario, task.engine
    cell = repr((scenario, task.model.sha256, engine))
    if _current is None or _current[0] != cell:
        runner = PairRunner(scenario, task.model, lambda: open_engine(scenario, engine))
        _current = cell, runner
    return _current[1]


ENCOUNTER_SIMULATION = Simulation(
    run=_run,
    decide_limit_s=_decide_limit_s,
    in_this_process=_in_this_process,
    with_outputs=_with_outputs,
    in_gui=_in_gui,
    check=network_of,
    network=network_of,
)
