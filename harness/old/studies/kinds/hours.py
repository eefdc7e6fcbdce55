"""Simulates hours of traffic in the one SUMO of the process."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from harness.encounter.traffic.pairing import ArmKey, HourOutcome, HourRunner
from harness.engine.network import network_of, place_of
from harness.engine.road import SumoRoad
from harness.engine.shared import following_of, road_for
from harness.old.store.hour_tables import hour_rows
from harness.old.store.hour_traces import hour_trace_rows
from harness.old.studies.kinds.outputs import SUMO_FILES, outputs_in
from harness.old.studies.kinds.simulation import ArmOfPair, ArmRows, Simulation
from harness.old.studies.kinds.tasks import Task, TaskResult
from harness.old.studies.kinds.watchdog import watchdog

if TYPE_CHECKING:
    from harness.engine.traci import Gui

HOUR_FILES = SUMO_FILES | {"--queue-output": "queues.xml"}
"""SUMO's output files of an hour of traffic, without ``DETECTORS``."""

DETECTORS = "e2.xml"

_PERIOD_S = "1"
"""Period in which SUMO writes positions and queues of an hour.  Every step would be too much."""

_PERIODS = dict.fromkeys(("--device.fcd.period", "--queue-output.period"), _PERIOD_S)


def _run(task: Task) -> tuple[TaskResult, ...]:
    """Run every pair of a task and its twins; the watchdog's limit applies to each hour."""
    known: dict[ArmKey, HourOutcome] = {}
    results = []
    with watchdog(task.hang_after_s, task.stack_file) as watch:
        for each in task.each:
            runner = _runner(each)
            outcomes = list(runner.run(each.pairs, watch.alive, known))
            known |= {runner.key(outcome.arm, outcome.pair): outcome for outcome in outcomes}
            results.append(_result_of(each, outcomes))
    return tuple(results)


def _runner(task: Task) -> HourRunner:
    scenario = task.scenario
    return HourRunner(scenario, task.model, lambda: road_for(scenario), paths=task.traces)


def _result_of(task: Task, outcomes: list[HourOutcome]) -> TaskResult:
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
    tables = hour_rows(task.cell, outcomes)
    if task.traces:
        tables |= hour_trace_rows(task.cell, outcomes)
    return TaskResult(tables, failures)


def _in_this_process(arm: ArmOfPair) -> ArmRows:
    return _run_arm(arm, lambda: road_for(arm.scenario))


def _with_outputs(arm: ArmOfPair, folder: Path) -> ArmRows:
    from harness.engine.sumo import libsumo_road

    scenario = arm.scenario
    place = place_of(scenario), scenario.vehicle(), scenario.crosswalk()
    road = libsumo_road(
        *place,
        scenario.experiment.step_s,
        following_of(scenario),
        outputs=outputs_in(folder, HOUR_FILES) | _PERIODS,
        detectors=folder / DETECTORS,
    )
    return _run_once(arm, road)


def _in_gui(arm: ArmOfPair, gui: "Gui") -> ArmRows:
    from harness.engine.traci import gui_road

    scenario = arm.scenario
    place = place_of(scenario), scenario.vehicle(), scenario.crosswalk()
    step_s, following = scenario.experiment.step_s, following_of(scenario)
    return _run_once(arm, gui_road(*place, step_s, following, gui))


def _run_once(arm: ArmOfPair, road: SumoRoad) -> ArmRows:
    """Run an arm on a road and close the road.  The arm fails if the simulation is lost."""
    try:
        rows = _run_arm(arm, lambda: road)
        return rows if road.lost else replace(rows, failure=None)
    finally:
        if not road.closed:
            road.close()


def _run_arm(arm: ArmOfPair, get_road: Callable[[], SumoRoad]) -> ArmRows:
    outcome = HourRunner(arm.scenario, arm.model, get_road).run_arm(arm.pair, arm.arm)
    return ArmRows(hour_rows(arm.cell.number, [outcome]), outcome.reason, outcome.traceback)


HOUR_SIMULATION = Simulation(
    run=_run,
    in_this_process=_in_this_process,
    with_outputs=_with_outputs,
    in_gui=_in_gui,
    check=network_of,
    network=network_of,
)
