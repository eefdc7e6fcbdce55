"""Takes one cell of an experiment and returns what happened in it; it runs in a worker."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from harness.core.encounter import Arm, Ending, Trace
from harness.core.errors import HarnessError
from harness.engine.shared import open_engine, road_for
from harness.episode.arms import check_arms, make_strategy
from harness.episode.arrivals import planned_arrivals
from harness.episode.cell_constants import constants_of
from harness.episode.loop import run_episode
from harness.episode.traffic.pairing import SUMO_DRIVER, HourRunner
from harness.episode.walking_speeds import WalkingSpeeds
from harness.measures import measure
from harness.model.interaction import load_model
from harness.scenario import Scenario
from harness.store.hour_tables import hour_rows
from harness.studies.validation.people.scenes import EvenBraking, Scene

Kind = Literal["gaps", "yielding", "first", "waits"]


@dataclass(frozen=True, slots=True)
class Job:
    """A cell to simulate: ``trials`` episodes of a scene, or hours of a scenario."""

    kind: Kind
    cell: int
    driver: str
    scene: Scene
    trials: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """What happened in a cell.

    ``values`` are one number for each trial: when the person set off, infinite if they did not
    (``gaps``, ``yielding``); whether the pedestrian was first (``first``); or each wait in s
    (``waits``).  ``contacts`` counts trials with a contact.
    """

    values: tuple[float, ...]
    contacts: int = 0


def simulate(job: Job) -> Outcome:
    """Simulate one cell.

    Raises:
        HarnessError: an episode or an hour failed.
    """
    if job.kind == "waits":
        return Outcome(tuple(_waits(job.scene.scenario, job.trials)))
    traces = list(episodes(job.scene, job.trials))
    if job.kind == "first":
        contacts = sum(record.contact_time_s is not None for record in measure(traces))
        return Outcome(tuple(float(pedestrian_first(trace)) for trace in traces), contacts)
    starts = (trace.walks[0].start_s for trace in traces)
    from_s = job.scene.looks_from_s
    return Outcome(tuple(math.inf if start is None else start - from_s for start in starts))


def episodes(scene: Scene, trials: int) -> Iterator[Trace]:
    """Simulate trials of a scene with one person, each with numbers of its own.

    The plain engine simulates them, unless SUMO's own drivers or pedestrians take part.
    """
    scenario, rules = scene.scenario, constants_of(scene.scenario)
    model = load_model(scenario.model.name, scenario.model.path)
    check_arms(scenario, model)
    speeds = WalkingSpeeds(scenario, model)
    by_sumo = scenario.pedestrians.behaviour == "sumo" or scenario.arms.human == SUMO_DRIVER
    engine = open_engine(scenario, "sumo" if by_sumo else "plain")
    for trial in range(trials):
        (person,) = planned_arrivals(scenario, trial)
        person = person._replace(looks_from_s=scene.looks_from_s)
        strategy = (
            EvenBraking() if scene.brakes else make_strategy(scenario, Arm.HUMAN, trial, model)
        )
        trace = run_episode(engine, strategy, [person], speeds, rules)
        if trace.ending is Ending.ENGINE_FAILED:
            raise HarnessError(f"{scenario.arms.human}: {trace.reason}")
        yield trace


def pedestrian_first(trace: Trace) -> bool:
    """Whether the person reached the path of the car before its front reached the crossing line."""
    walk = trace.walks[0]
    if walk.start_s is None or not walk.speed_mps:
        return False
    to_path_m = trace.crossing.to_lane_m(walk.arrival.side) - trace.vehicle.width_m / 2
    reaches_s = walk.start_s + to_path_m / walk.speed_mps
    passed = np.flatnonzero(trace.x_m >= 0)
    if not len(passed):
        return True
    after = int(passed[0])
    before_m, x_m = float(trace.x_m[after - 1]), float(trace.x_m[after])
    front_s = (after - 1 - before_m / (x_m - before_m)) * trace.step_s
    return reaches_s < front_s


def _waits(scenario: Scenario, hours: int) -> Iterator[float]:
    """The wait of every pedestrian of some hours, in s."""
    model = load_model(scenario.model.name, scenario.model.path)
    runner = HourRunner(scenario, model, lambda: road_for(scenario))
    for pair in range(hours):
        outcome = runner.run_arm(pair, Arm.HUMAN)
        if outcome.reason is not None:
            raise HarnessError(f"{scenario.arms.human}: {outcome.reason}")
        delays = hour_rows(0, [outcome])["pedestrians"]["delay_s"].to_pylist()
        yield from (delay for delay in delays if delay is not None)
