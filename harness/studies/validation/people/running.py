"""Simulates the experiments with measured people and returns their findings."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import get_args

import numpy as np

from harness.core.encounter import Behaviour
from harness.core.errors import InputError, unknown_name
from harness.episode.arms import asks_model, check_arms
from harness.episode.traffic.closed_forms import (
    critical_headway_s,
    group_headway_s,
    revised_hcm_delay_s,
)
from harness.model.interaction import ModelUseCounter, load_model
from harness.scenario import Options, Setting
from harness.strategies.registry import find_strategy
from harness.studies.validation.people import measured as shipped
from harness.studies.validation.people.findings import Held, PeopleFindings, Row, held
from harness.studies.validation.people.measured import GapCell, SitePeriod
from harness.studies.validation.people.scenes import (
    Scene,
    check_settings,
    first_scene,
    gap_scene,
    site_scenario,
)
from harness.studies.validation.people.simulating import Job, Kind, Outcome, simulate
from harness.studies.workers.execution import call_each
from harness.studies.workers.pool import LocalPool, workers_for
from harness.studies.workers.this_process import ThisProcess

TRIALS, HOURS = 1_000, 6
"""Default numbers of simulated trials of each cell, and of hours of each site-period."""

_QUARTILES = (0.25, 0.5, 0.75)

Progress = Callable[[int, int, str], None]


def validate_people(
    behaviour: str,
    drivers: Sequence[str],
    settings: Sequence[Setting] = (),
    *,
    trials: int = TRIALS,
    hours: int = HOURS,
    seed: int = 1,
    zebra: bool = True,
    workers: int | None = None,
    progress: Progress = lambda _done, _planned, _what: None,
) -> PeopleFindings:
    """Simulate measured experiments with a behaviour of pedestrians and with drivers.

    Args:
        behaviour: ``pedestrians.behaviour``.
        drivers: names of strategies.
        settings: keys of the tables ``ALLOWED``.
        trials: simulated trials of each cell, ≥ 1.
        hours: simulated hours of each site-period; 0 leaves them out.
        seed: seed of all random numbers.
        zebra: whether a zebra crossing is there when driver and pedestrian meet.  Without it, no
            measured figure is shipped.
        workers: number of processes; None uses all cores, 0 only this one.  The findings do not
            depend on it.
        progress: called with the numbers of done and planned cells, and the unit.

    Raises:
        InputError: the behaviour, a driver or a setting is refused.
        HarnessError: an episode or an hour failed.
    """
    if behaviour not in get_args(Behaviour):
        raise unknown_name("--behaviour", "behaviour", behaviour, get_args(Behaviour))
    if not drivers:
        raise InputError("--drivers", "names no driver", "e.g. human_yield,human_gmm")
    for name in drivers:
        find_strategy(name, "--drivers")
    check_settings(settings)
    jobs = list(_jobs(behaviour, drivers, settings, (trials, hours), seed, zebra))
    for job in jobs:
        if job.kind == "first":
            scenario = job.scene.scenario
            check_arms(scenario, load_model(scenario.model.name, scenario.model.path))
    outcomes = _simulated(jobs, workers, progress)
    return PeopleFindings(
        behaviour=behaviour,
        drivers=tuple(drivers),
        seed=seed,
        trials=trials,
        hours=hours,
        held=tuple(_held(jobs, outcomes, drivers, zebra)),
    )


def _jobs(
    behaviour: str,
    drivers: Sequence[str],
    settings: Sequence[Setting],
    amount: tuple[int, int],
    seed: int,
    zebra: bool,
) -> Iterator[Job]:
    """Yield the cells of every experiment, the longest first."""
    trials, hours = amount
    if hours:
        for driver in drivers:
            for number, site in enumerate(shipped.site_periods()):
                scenario = site_scenario(site, behaviour, driver, settings, seed)
                yield Job("waits", number, driver, Scene(scenario, 0.0), hours)
    for number, gap in enumerate(shipped.gap_cells()):
        scene = gap_scene(gap, behaviour, settings, seed)
        yield Job("yielding" if gap.yields else "gaps", number, "", scene, trials)
    for driver in drivers:
        for number, cell in enumerate(shipped.first_cells()):
            scene = first_scene(cell, behaviour, driver, settings, seed, zebra)
            yield Job("first", number, driver, scene, trials)


def _simulated(
    jobs: Sequence[Job], workers: int | None, progress: Progress
) -> dict[tuple[str, int, str], Outcome]:
    count = workers_for(len(jobs), Options(workers=workers))
    executor = ThisProcess() if workers == 0 else LocalPool(count)
    outcomes: dict[tuple[str, int, str], Outcome] = {}
    tasks = iter(jobs)
    try:
        for job, future in call_each(executor, simulate, lambda: next(tasks, None)):
            outcomes[job.kind, job.cell, job.driver] = future.result()
            progress(len(outcomes), len(jobs), "cells")
    finally:
        executor.stop()
    return outcomes


def _held(
    jobs: Sequence[Job],
    outcomes: dict[tuple[str, int, str], Outcome],
    drivers: Sequence[str],
    zebra: bool,
) -> Iterator[Held]:
    """Yield the experiments in the order in which they are shown."""
    cells = [(job.cell, outcomes[job.kind, job.cell, job.driver]) for job in jobs if not job.driver]
    gaps = shipped.gap_cells()
    steady = [_gap_row(gaps[cell], found) for cell, found in cells if not gaps[cell].yields]
    yield held(shipped.GAPS, "", steady)
    quartiles = [
        row for cell, found in cells if gaps[cell].yields for row in _start_rows(gaps[cell], found)
    ]
    yield held(shipped.YIELDING, "", quartiles)
    for driver in drivers:
        rows = []
        for number, cell in enumerate(shipped.first_cells()):
            found = outcomes["first", number, driver]
            share = cell.share if zebra else None
            trials = cell.trials if zebra else None
            name = f"{cell.time_to_arrival_s:g} s to arrival"
            rows.append(
                Row(name, "", share, trials, *_share(found.values), contacts=found.contacts)
            )
        experiment = shipped.FIRST if zebra else shipped.FIRST_WITHOUT_ZEBRA
        yield held(experiment, driver, rows, _model_limits(jobs, "first", driver))
    for driver in drivers:
        rows = [
            _wait_row(site, outcomes["waits", number, driver])
            for number, site in enumerate(shipped.site_periods())
            if ("waits", number, driver) in outcomes
        ]
        if rows:
            yield held(shipped.WAITS, driver, rows, _model_limits(jobs, "waits", driver))


def _model_limits(jobs: Sequence[Job], kind: Kind, driver: str) -> tuple[float, float] | None:
    """The limits of the model's data, if the driver asks it for faster or farther vehicles."""
    for job in jobs:
        scenario = job.scene.scenario
        if (job.kind, job.driver) == (kind, driver) and asks_model(scenario):
            support = ModelUseCounter(load_model(scenario.model.name, scenario.model.path))
            fastest_mps, farthest_m = support.speeds_mps[1], support.ranges_m[1]
            ego = scenario.ego
            if ego.initial_speed_mps > fastest_mps or ego.trigger_range_m > farthest_m:
                return fastest_mps, farthest_m
    return None


def _gap_row(cell: GapCell, found: Outcome) -> Row:
    """The share that sets off before the time gap is over."""
    started = [float(start < cell.time_gap_s) for start in found.values]
    return Row(_name(cell), "", cell.share, cell.trials, *_share(started))


def _start_rows(cell: GapCell, found: Outcome) -> Iterator[Row]:
    """The quartiles of setting off; undefined if fewer set off than the quartile needs.

    The standard error is half the distance between the order statistics one standard deviation of
    the share below and above the quantile.
    """
    starts = np.sort(found.values)
    count = len(starts)
    for share, start_s in zip(_QUARTILES, cell.quartiles_s, strict=True):
        reach = math.sqrt(share * (1 - share) / count)
        low, middle, high = (
            float(starts[min(count - 1, max(0, math.ceil(at * count) - 1))])
            for at in (share - reach, share, share + reach)
        )
        value = middle if math.isfinite(middle) else None
        error = (high - low) / 2 if math.isfinite(high) else None
        name = f"{100 * share:.0f} % set off, s"
        yield Row(_name(cell), name, start_s, cell.trials, value, error, count)


def _wait_row(site: SitePeriod, found: Outcome) -> Row:
    """The mean wait of pedestrians."""
    waits = np.array(found.values)
    mean = float(waits.mean()) if len(waits) else None
    error = float(waits.std(ddof=1) / math.sqrt(len(waits))) if len(waits) > 1 else None
    name = f"site {site.site}, {site.day}"
    form = handbook_wait_s(site)
    return Row(name, "mean wait, s", site.delay_s, None, mean, error, len(waits), form)


def handbook_wait_s(site: SitePeriod) -> float:
    """The mean wait by NCHRP 17-87's revised form with t_s = 0, in s."""
    flow, people = site.vehicles_per_hour / 3600, site.pedestrians_per_hour / 3600
    headway_s = critical_headway_s(site.length_m, site.length_m / site.crossing_time_s, 0.0)
    group_s = group_headway_s(flow, people, headway_s, 4.0)
    return revised_hcm_delay_s(flow, group_s, site.lanes, site.yield_rate)


def _share(values: Sequence[float]) -> tuple[float, float, int]:
    """The share of ones, its standard error, and the number of trials."""
    share, count = sum(values) / len(values), len(values)
    return share, math.sqrt(share * (1 - share) / count), count


def _name(cell: GapCell) -> str:
    return f"{cell.time_gap_s:g} s, {cell.speed_mph:g} mph"
