"""The rules for all strategies.  Each is a function that raises if a strategy breaks it."""

import copy
import inspect
import math
from collections.abc import Callable
from numbers import Real
from typing import Any

from harness.core.encounter import SPEED_ROUNDING, Ending
from harness.old.studies.conformance.subject import (
    EMPTY_ROAD,
    IS_FINITE,
    SCENES,
    STEPS_S,
    SURVIVES,
    BrokenRuleError,
    Observed,
    Subject,
)
from harness.strategies.parameters import parameters_of

HAS_DEFAULTS = "every parameter has a default"


def _has_defaults(subject: Subject) -> None:
    given = subject.parameters
    missing = [p.name for p in parameters_of(subject.factory) if p.required and p.name not in given]
    if missing:
        raise BrokenRuleError(f"no default for {', '.join(missing)}")


def _survives(subject: Subject) -> None:
    for scene in SCENES:
        for step_s in STEPS_S:
            subject.play(scene, step_s)


def _is_finite(subject: Subject) -> None:
    for scene in SCENES:
        for step_s in STEPS_S:
            _, watched = subject.play(scene, step_s)
            for answer, observation in zip(watched.answers, watched.observations, strict=True):
                number = isinstance(answer, Real) and not isinstance(answer, bool)
                if answer is not None and not (number and math.isfinite(answer)):
                    what = f"{scene}, step {step_s:g} s: returned {answer!r}"
                    raise BrokenRuleError(what, observation)


def _crosses_an_empty_road(subject: Subject) -> None:
    for step_s in STEPS_S:
        trace, watched = subject.play(EMPTY_ROAD, step_s)
        if trace.ending is not Ending.CROSSED:
            what = f"step {step_s:g} s: {trace.ending} although the road was empty"
            raise BrokenRuleError(what, watched.observations[-1])


def _is_deterministic(subject: Subject) -> None:
    for scene in SCENES:
        first, second = (subject.play(scene, 0.1)[1] for _ in range(2))
        _refuse_difference(scene, first, second)


def _forgets(subject: Subject) -> None:
    alone = {scene: subject.play(scene, 0.1)[1] for scene in SCENES}
    for scene in reversed(SCENES):
        again = subject.play(scene, 0.1)[1]
        _refuse_difference(f"{scene}, after others", alone[scene], again)


def _leaves_alone(subject: Subject) -> None:
    for scene in SCENES:
        _, watched = subject.play(scene, 0.1)
        if watched.changed:
            raise BrokenRuleError(f"{scene}: changed the observation", watched.changed)


def _keeps_nothing_in_its_class(subject: Subject) -> None:
    """Raise if state is kept in the class.

    The next episode would see that state, so results would depend on the number of workers.
    """
    subject.play(EMPTY_ROAD, 0.1)
    before = _class_state(subject.factory)
    for scene in SCENES:
        subject.play(scene, 0.1)
        after = _class_state(subject.factory)
        for name in before.keys() | after.keys():
            if repr(before.get(name)) != repr(after.get(name)):
                raise BrokenRuleError(f"{scene}: changed the class attribute {name}")


def _class_state(strategy: Any) -> dict[str, Any]:
    return {
        name: copy.copy(value)
        for name, value in vars(strategy).items()
        if not name.startswith("__") and not inspect.isroutine(value)
    }


def _refuse_difference(where: str, first: Observed, second: Observed) -> None:
    """Raise if the answers differ, with the observation at the first difference."""
    answers = zip(first.answers, second.answers, second.observations, strict=False)
    for step, (a, b, observation) in enumerate(answers):
        if repr(a) != repr(b):
            raise BrokenRuleError(f"{where}: {a!r} and {b!r} at step {step}", observation)
    if len(first.answers) != len(second.answers):
        raise BrokenRuleError(f"{where}: {len(first.answers)} and {len(second.answers)} steps")


def _keeps_to_the_limit(subject: Subject) -> None:
    """Raise if the ego exceeds the speed limit (v0 if there is none), because that saves time."""
    for scene in SCENES:
        trace, watched = subject.play(scene, 0.1)
        v0_mps = trace.vehicle.initial_speed_mps
        limit_mps = max(subject.road_limit_mps or v0_mps, v0_mps)
        speeding = trace.speed_mps > limit_mps * (1 + SPEED_ROUNDING)
        if speeding.any():
            step, fastest = int(speeding.argmax()), float(trace.speed_mps.max())
            what = f"{scene}: drove at {fastest:.3g} m/s, above the limit of {limit_mps:g} m/s"
            raise BrokenRuleError(what, watched.observations[max(step - 1, 0)])


CHECKS: dict[str, Callable[[Subject], None]] = {
    "remembers nothing of other episodes": _forgets,
    "stores nothing in its class": _keeps_nothing_in_its_class,
    "the same episode twice gives the same answers": _is_deterministic,
    HAS_DEFAULTS: _has_defaults,
    SURVIVES: _survives,
    IS_FINITE: _is_finite,
    "crosses an empty road": _crosses_an_empty_road,
    "keeps to the road's speed limit, or to v0 without a limit": _keeps_to_the_limit,
    "does not change its observation": _leaves_alone,
}
"""Every check by its rule; the checks of memory are first, because they need a new class."""
