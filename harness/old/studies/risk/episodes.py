"""Runs the episodes of a risk estimate in a worker: from states in normal space to scores."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from harness.core.encounter import Contact, Ending, FloatArray, Trace
from harness.core.seeding import has_drawn_more
from harness.encounter.arms import draws_of
from harness.encounter.pairing import PairRunner
from harness.engine.shared import open_engine
from harness.measures import Outcome, measure
from harness.old.studies.kinds.watchdog import watchdog
from harness.old.studies.risk.asking import Question
from harness.old.studies.risk.event import GRADINGS, Event
from harness.scenario import EngineName

_current: tuple[str, PairRunner] | None = None
"""The runner of the current scenario, after what it depends on."""


@dataclass(frozen=True)
class Episodes:
    """Consecutive episodes of a batch from index ``first`` on; states have shape (n, width).

    ``asked`` is as for ``Evaluate``.  ``in_full`` asks for everything that a score has.
    """

    question: Question
    first: int
    numbers: tuple[int, ...]
    z: FloatArray
    asked: tuple[int, ...] | None
    in_full: bool
    hang_after_s: float


class Score(NamedTuple):
    """The outcome of one episode.

    Attributes:
        score: one score for each grading of the event; NaN if the episode failed.
        passed_s: time at which the ego's front reached the centre line; NaN if it did not.
        passed_mps: its speed then; NaN if it did not.
        timed_out: whether the time limit ended the episode.
        reason: reason of a failure; else None.
        culprit: place of the pedestrian to whom the event is due; −1 if there is none in the crowd.
        own: the scores with the asked pedestrians alone.
        drew_more: whether the strategy drew more random numbers than the sampled ones.

    The others are known of tasks ``in_full`` alone:
        speeds_mps: walking speed of each pedestrian by index; None if they did not walk.
        culprit_index: index of the pedestrian to whom the event is due; None if there is none.
        contact: what of the vehicle touched someone; None without a contact.
    """

    score: tuple[float, ...]
    passed_s: float
    passed_mps: float
    timed_out: bool = False
    reason: str | None = None
    drew_more: bool = False
    culprit: int = -1
    own: tuple[float, ...] = (math.inf,) * GRADINGS
    speeds_mps: tuple[float | None, ...] = ()
    culprit_index: int | None = None
    contact: Contact | None = None


def failed(reason: str) -> Score:
    """Return the score of an episode that killed its worker."""
    return Score((math.nan,) * GRADINGS, math.nan, math.nan, reason=reason)


def run_episodes(task: Episodes) -> list[Score]:
    """Run every episode of a task, in its order."""
    question = task.question
    inputs = [
        (number, question.space.given(z, number))
        for number, z in zip(task.numbers, task.z, strict=True)
    ]
    drew_more: list[bool] = []
    with watchdog(task.hang_after_s, None) as watch:

        def ended(rng: np.random.Generator | None) -> None:
            watch.alive()
            number, uniforms = inputs[len(drew_more)]
            unused = draws_of(question.scenario, question.arm, number, given=uniforms)
            drew_more.append(rng is not None and has_drawn_more(rng, unused))

        runner = _runner_of(question)
        outcomes = list(runner.run_arm_given(question.arm, inputs, ended))
        scores = [
            Score(
                question.event.scores(outcome.record),
                *_passage(outcome.trace),
                outcome.record.ending is Ending.TIMED_OUT,
                outcome.record.reason,
                drew_more=more,
            )
            for outcome, more in zip(outcomes, drew_more, strict=True)
        ]
        if question.space.marks:
            scores = [
                score._replace(
                    culprit=question.space.place_of(z, _culprit(question.event, outcome))
                )
                for score, z, outcome in zip(scores, task.z, outcomes, strict=True)
            ]
        if task.asked is not None:
            own = _own(question, task.z, task.asked, outcomes)
            scores = [score._replace(own=each) for score, each in zip(scores, own, strict=True)]
        if task.in_full:
            scores = [
                score._replace(
                    speeds_mps=_speeds_mps(outcome.trace),
                    culprit_index=_culprit(question.event, outcome),
                    contact=outcome.record.contact,
                )
                for score, outcome in zip(scores, outcomes, strict=True)
            ]
    return scores


def _speeds_mps(trace: Trace) -> tuple[float | None, ...]:
    """Return the walking speed of each pedestrian by index; None if they did not walk."""
    end_s = trace.step_s * (len(trace.x_m) - 1)
    walked = {
        walk.arrival.index: walk.speed_mps
        for walk in trace.walks
        if walk.start_s is not None and walk.start_s < end_s
    }
    return tuple(walked.get(number) for number in range(max(walked, default=-1) + 1))


def _passage(trace: Trace) -> tuple[float, float]:
    """Return time and speed at which the ego's front reached the centre line, interpolated."""
    beyond = np.flatnonzero(trace.x_m >= 0.0)
    if len(beyond) == 0 or beyond[0] == 0:
        return math.nan, math.nan
    after = int(beyond[0])
    before_m, after_m = trace.x_m[after - 1], trace.x_m[after]
    steps = after - 1 - before_m / (after_m - before_m)
    speed_mps = np.interp(steps, (after - 1, after), trace.speed_mps[after - 1 : after + 1])
    return float(trace.step_s * steps), float(speed_mps)


def _culprit(event: Event, outcome: Outcome) -> int | None:
    """Return the index of the pedestrian to whom the event is due: whom the ego hit first.

    Without a contact it is the first one with whom alone the same motion of the ego would be in
    the event.  None if the episode is not in the event, or if there is nobody like that.
    """
    record, trace = outcome.record, outcome.trace
    if not event.holds(record):
        return None
    if record.contact_index is not None:
        return record.contact_index
    alone = measure([replace(trace, walks=(walk,)) for walk in trace.walks])
    return next(
        (
            walk.arrival.index
            for walk, their in zip(trace.walks, alone, strict=True)
            if event.holds(their)
        ),
        None,
    )


def _own(
    question: Question, z: FloatArray, asked: tuple[int, ...], outcomes: list[Outcome]
) -> list[tuple[float, ...]]:
    """Return the scores that each episode would have if only the asked pedestrians were there."""
    own = [(math.inf,) * GRADINGS] * len(outcomes)
    rows, traces = [], []
    for row, (state, place, outcome) in enumerate(zip(z, asked, outcomes, strict=True)):
        walks = tuple(
            walk
            for walk in outcome.trace.walks
            if question.space.place_of(state, walk.arrival.index) == place
        )
        if walks and outcome.record.ending is not Ending.ENGINE_FAILED:
            rows.append(row)
            traces.append(replace(outcome.trace, walks=walks))
    for row, record in zip(rows, measure(traces), strict=True):
        own[row] = question.event.scores(record)
    return own


def _runner_of(question: Question) -> PairRunner:
    """Return the runner of a scenario; a new one is made only if the scenario changes."""
    global _current
    scenario = question.scenario
    scene = repr((scenario, question.model.sha256, question.in_sumo))
    if _current is None or _current[0] != scene:
        name: EngineName = "sumo" if question.in_sumo else "plain"
        runner = PairRunner(scenario, question.model, lambda: open_engine(scenario, name))
        _current = scene, runner
    return _current[1]
