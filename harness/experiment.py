"""One experiment from scenario to run folder: the way of the data in one page."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.comparison import Summary, summarise
from harness.encounter import Ending
from harness.engine.protocol import Engine
from harness.execution import PairRunner
from harness.interaction import InteractionModel, load_model
from harness.measures import Outcome
from harness.network import CrossingGeometry, network_for
from harness.resources import shipped_directory
from harness.results import (
    CELLS,
    EPISODES,
    MANIFEST,
    PAIRS,
    PEDESTRIANS,
    SCHEMA,
    TRACES,
    EventLog,
    episode_rows,
    new_run_folder,
    pair_columns,
    pair_rows,
    pedestrian_rows,
    summary_row,
    trace_rows,
    versions,
    write_json,
    write_summary,
    write_table,
)
from harness.scenario import Scenario

_BOOTSTRAP = 5
"""Keys the resampling apart from the streams of ``seeding``, which begin with the same seed."""

CELL = 0


@dataclass(frozen=True)
class Run:
    """A finished run: where it lies and what came out."""

    folder: Path
    scenario: Scenario
    summary: Summary
    failures: list[tuple[int, str, str]]
    """(pair, arm, reason) of every episode the engine failed in."""


def geometry_of(scenario: Scenario) -> CrossingGeometry:
    """The crosswalk a scenario takes place at."""
    return CrossingGeometry(**scenario.crossing.model_dump())


def network_of(scenario: Scenario) -> Path:
    """The SUMO network of a scenario: the shipped one, or built into the cache."""
    return network_for(geometry_of(scenario), shipped_directory("networks") / "cctc")


def sumo_engine(scenario: Scenario, sumo_seed: int = 1) -> Callable[[], Engine]:
    """Makes SUMO engines for a scenario; SUMO is imported when the first one is made."""
    net = network_of(scenario)

    def make() -> Engine:
        from harness.engine.sumo import libsumo_engine

        return libsumo_engine(
            net, scenario.vehicle(), scenario.crosswalk(), scenario.experiment.step_s, sumo_seed
        )

    return make


def run_experiment(
    scenario: Scenario,
    name: str,
    *,
    out: Path | None = None,
    traces: bool = False,
    progress: Callable[[int], None] = lambda _: None,
    make_engine: Callable[[], Engine] | None = None,
) -> Run:
    """Run one cell and write its run folder.

    Args:
        scenario: what to run.
        name: names the default folder.
        out: the folder; default ``runs/<name>-<next free number>``.
        traces: keep every step in ``traces.parquet``.
        progress: called with the number of finished pairs.
        make_engine: another engine than SUMO (tests).

    Raises:
        InputError: model, strategies or folder are refused; nothing has been written then.
    """
    model = load_model(scenario.model.name, scenario.model.path)
    runner = PairRunner(scenario, model, make_engine or sumo_engine(scenario))
    folder = new_run_folder(out, name)
    log = EventLog(folder)
    log.write("started", pairs=scenario.experiment.pairs)
    begin = time.perf_counter()
    try:
        outcomes = _collect(runner, scenario.experiment.pairs, progress)
    finally:
        runner.close()
    failures = [
        (outcome.pair, outcome.arm.value, outcome.record.reason or "")
        for outcome in outcomes
        if outcome.record.ending is Ending.ENGINE_FAILED
    ]
    for pair, arm, reason in failures:
        log.write("failed", cell=CELL, pair=pair, arm=arm, reason=reason)
    rate = scenario.experiment.pairs / (time.perf_counter() - begin)
    log.write("simulated", pairs=scenario.experiment.pairs, pairs_per_s=round(rate, 1))
    summary = _write(folder, scenario, model, outcomes, traces)
    log.write("finished")
    return Run(folder, scenario, summary, failures)


def _collect(runner: PairRunner, pairs: int, progress: Callable[[int], None]) -> list[Outcome]:
    outcomes = []
    for outcome in runner.run(range(pairs)):
        outcomes.append(outcome)
        progress(outcome.pair + 1)
    return outcomes


def _write(
    folder: Path,
    scenario: Scenario,
    model: InteractionModel,
    outcomes: list[Outcome],
    traces: bool,
) -> Summary:
    """The manifest last: a folder that has one is complete."""
    episodes = episode_rows(CELL, outcomes)
    write_table(folder / "cells.parquet", CELLS, {"cell": [CELL]})
    write_table(folder / "episodes.parquet", EPISODES, episodes)
    write_table(folder / "pedestrians.parquet", PEDESTRIANS, pedestrian_rows(CELL, outcomes))
    write_table(folder / "pairs.parquet", PAIRS, pair_rows(CELL, episodes))
    if traces:
        write_table(folder / "traces.parquet", TRACES, trace_rows(CELL, outcomes))
    summary = summarise(
        pair_columns(episodes),
        scenario.experiment.timeout_s,
        np.random.default_rng((scenario.experiment.seed, _BOOTSTRAP)),
    )
    write_summary(folder / "summary.csv", [summary_row(summary)])
    write_json(folder / MANIFEST, _manifest(scenario, model, outcomes))
    return summary


def _manifest(
    scenario: Scenario, model: InteractionModel, outcomes: list[Outcome]
) -> dict[str, Any]:
    endings = [outcome.record.ending for outcome in outcomes]
    return {
        "schema": SCHEMA,
        "scenario": scenario.model_dump(),
        "seed": scenario.experiment.seed,
        "versions": versions(),
        "model": {"name": model.name, "sha256": model.sha256},
        "counts": {
            "pairs": scenario.experiment.pairs,
            "episodes": len(outcomes),
            **{ending.value: endings.count(ending) for ending in Ending},
        },
    }
