"""Runs the episodes of a risk: points in standard normal space to scores, in a worker process."""

import math
from dataclasses import dataclass

import numpy as np

from harness.encounter import Arm, Ending, FloatArray, Trace
from harness.engine.shared import open_engine
from harness.episode.arms import draws_of
from harness.episode.pairing import PairRunner
from harness.episode.ties import Asked, tie_s
from harness.interaction import InteractionModel
from harness.measures.agreement import difference
from harness.risk.event import Event
from harness.risk.space import Space
from harness.scenario import EngineName, Scenario
from harness.seeding import Given, has_drawn_more
from harness.workers.watchdog import watchdog

_scene = ""
_runners: dict[bool, PairRunner] = {}


@dataclass(frozen=True)
class Question:
    """What is asked: of which scenario, which arm, which event; ``in_sumo``: by SUMO's engine."""

    scenario: Scenario
    model: InteractionModel
    arm: Arm
    event: Event
    space: Space
    in_sumo: bool


@dataclass(frozen=True)
class Episodes:
    """Some episodes of a batch from its ``first``-th on: their numbers and states (n, width).

    ``compare``: the other engine runs them too, and the answer says which records differ.
    """

    question: Question
    first: int
    numbers: tuple[int, ...]
    z: FloatArray
    compare: bool
    hang_after_s: float


@dataclass(frozen=True)
class Scores:
    """What became of them: ``score`` of shape (n, gradings), NaN where the episode failed.

    ``passed_s`` (n,) is when the ego's front reached the centre line, NaN where it did not.
    ``timed_out``, ``reasons`` (of a failure) and ``differs`` (what two engines' records are unequal
    in) have an entry for each episode, None where there is nothing to say; ``by_a_tie`` says
    whether they are unequal by a tie of the strategy, ``drew_more`` whether the strategy drew more
    random numbers than those that are given.
    """

    score: FloatArray
    passed_s: FloatArray
    timed_out: tuple[bool, ...]
    reasons: tuple[str | None, ...]
    differs: tuple[str | None, ...]
    by_a_tie: tuple[bool, ...]
    drew_more: tuple[bool, ...]


def run_episodes(task: Episodes) -> Scores:
    """Run every episode of a task, in its order."""
    question = task.question
    given = [
        (number, question.space.given(z, number))
        for number, z in zip(task.numbers, task.z, strict=True)
    ]
    with watchdog(task.hang_after_s, None) as watch:
        alive = watch.alive
        drew_more: list[bool] = []

        def ended(rng: np.random.Generator | None) -> None:
            alive()
            number, known = given[len(drew_more)]
            drew_more.append(
                rng is not None
                and has_drawn_more(
                    rng, draws_of(question.scenario, question.arm, number, given=known)
                )
            )

        runner = _runner_of(question, question.in_sumo)
        outcomes = list(runner.run_arm_given(question.arm, given, ended))
        records = [outcome.record for outcome in outcomes]
        differs: list[str | None] = [None] * len(records)
        by_a_tie = [False] * len(records)
        if task.compare:
            runner = _runner_of(question, not question.in_sumo)
            others = runner.run_arm_given(question.arm, given, lambda _: alive())
            for at, other in enumerate(others):
                if (words := difference(records[at], other.record)) is not None:
                    tie = _tie_s(question, *given[at])
                    alive()
                    when = "" if tie is None else f"tie at {tie:.3f} s, "
                    differs[at] = f"episode {task.numbers[at]}: {when}{words}"
                    by_a_tie[at] = tie is not None
    return Scores(
        np.array([question.event.scores(record) for record in records]),
        np.array([_passed_s(outcome.trace) for outcome in outcomes]),
        tuple(record.ending is Ending.TIMED_OUT for record in records),
        tuple(record.reason for record in records),
        tuple(differs),
        tuple(by_a_tie),
        tuple(drew_more),
    )


def _tie_s(question: Question, number: int, given: Given) -> float | None:
    """When a tie of the strategy made the two engines' records of an episode differ, if one did."""
    asked: tuple[list[Asked], list[Asked]] = ([], [])
    for heard, in_sumo in zip(asked, (False, True), strict=True):
        _runner_of(question, in_sumo).run_arm(number, question.arm, given=given, asked=heard)
    return tie_s(*asked)


def _passed_s(trace: Trace) -> float:
    """When the ego's front reached the centre line, between steps by interpolation."""
    beyond = np.flatnonzero(trace.x_m >= 0.0)
    if len(beyond) == 0 or beyond[0] == 0:
        return math.nan
    after = int(beyond[0])
    before_m, after_m = trace.x_m[after - 1], trace.x_m[after]
    return float(trace.step_s * (after - 1 - before_m / (after_m - before_m)))


def _runner_of(question: Question, in_sumo: bool) -> PairRunner:
    """The runner of a scenario; made again only when the scenario changes."""
    global _scene
    scenario = question.scenario
    scene = repr((scenario, question.model.sha256))
    if scene != _scene:
        _runners.clear()
        _scene = scene
    if in_sumo not in _runners:
        name: EngineName = "sumo" if in_sumo else "plain"
        _runners[in_sumo] = PairRunner(
            scenario, question.model, lambda: open_engine(scenario, name)
        )
    return _runners[in_sumo]
