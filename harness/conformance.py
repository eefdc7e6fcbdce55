"""What every strategy must keep to, whichever it is: small scenes on the plain engine.

The same checks hold the built-in strategies (tests/conformance) and a user's own
(``harness strategies --check``).
"""

import copy
import inspect
import math
from collections.abc import Callable, Mapping
from concurrent.futures import Future, wait
from dataclasses import dataclass
from numbers import Real
from threading import Thread
from time import monotonic
from types import MappingProxyType
from typing import Any, NamedTuple

from harness.encounter import Arrival, Ending, Observation, Side, Strategy, Trace
from harness.engine.plain import PlainEngine
from harness.episode.arms import make_strategy
from harness.episode.cell_constants import constants_of
from harness.episode.loop import run_episode
from harness.errors import in_one_line
from harness.interaction import InteractionModel, load_model
from harness.scenario import ExperimentSection, Scenario, validate
from harness.strategies.parameters import parameters_of
from harness.strategies.registry import find_strategy

STEPS_S = (0.1, 0.05)

DECIDE_LIMIT_S = ExperimentSection().decide_limit_s
"""How long one answer may take, as in a run."""

Walker = tuple[float, Side, float]
"""Arrival time (s), side, walking speed (m/s)."""


class Scene(NamedTuple):
    """People who come, whatever the ego does, and what differs from the paper's ego."""

    walkers: tuple[Walker, ...]
    ego: Mapping[str, float] = MappingProxyType({})
    kerb_wait_s: float = 0.0


def _crowd(count: int) -> tuple[Walker, ...]:
    sides = tuple(Side)
    return tuple((0.7 * i, sides[i % 2], 0.6 + 0.37 * (i % 5)) for i in range(count))


SCENES: dict[str, Scene] = {
    "nobody": Scene(()),
    "one from the near side": Scene(((0.0, Side.NEAR, 1.2),)),
    "one from the far side, slow": Scene(((0.0, Side.FAR, 0.5),)),
    "one runs": Scene(((4.0, Side.NEAR, 3.0),)),
    "many from both sides": Scene(_crowd(25)),
    "a crowd at once": Scene(tuple((1.0, side, 1.3) for side in (*Side,) * 10)),
    # From the near kerb the lane's far edge is passed after 4.5 m, 3 s; first seen at R = 10 m.
    "already past the lane when first seen": Scene(
        ((0.0, Side.NEAR, 1.5), (0.5, Side.NEAR, 1.4)), {"detection_range_m": 10.0}
    ),
    # He steps off when the ego is at R = 2.5 m, 0.5 m before the crosswalk.
    "one steps off as it passes": Scene(((5.5, Side.FAR, 0.6),)),
    "some wait at the kerb": Scene(((3.8, Side.NEAR, 1.2), (4.5, Side.FAR, 1.2)), kerb_wait_s=2.0),
    "a fast, weak ego": Scene(
        ((0.0, Side.NEAR, 1.0), (2.0, Side.FAR, 1.0)),
        {"initial_speed_mps": 16.0, "trigger_range_m": 60.0, "max_deceleration_mps2": 2.0},
    ),
}


class _BrokenRuleError(Exception):
    """A check's finding, in one line."""


class _StoppedError(_BrokenRuleError):
    """A scene could not be played to its end; ``rule`` is the check that this belongs to."""

    def __init__(self, problem: str, rule: str) -> None:
        super().__init__(problem)
        self.rule = rule


@dataclass(frozen=True)
class RuleResult:
    """What one check found; ``problem`` is None where the strategy passed.

    ``checked`` is False where the check could not be made, for a reason that another one has
    found; ``problem`` says which.
    """

    check: str
    problem: str | None
    checked: bool = True


class _Observed:
    """Hands observations on to a strategy and keeps its answers.

    Where it answers None, which only SUMO could carry out, the speed is kept.
    """

    def __init__(self, strategy: Strategy) -> None:
        self.strategy = strategy
        self.answers: list[Any] = []
        self.changed: str | None = None
        self.asked_at_s: float | None = None
        """When it was asked what it has not answered: by then it is thinking, or has raised."""

    def decide(self, observation: Observation, /) -> float:
        """The strategy's answer; its observation is compared with itself before."""
        before = repr(observation)
        self.asked_at_s = monotonic()
        answer = self.strategy.decide(observation)
        self.asked_at_s = None
        if self.changed is None and repr(observation) != before:
            self.changed = f"the observation at t = {observation.time_s:.3f} s"
        self.answers.append(answer)
        return 0.0 if answer is None else answer


class Subject:
    """A strategy under check.

    Args:
        name: as in ``arms.av``.
        model: the interaction model, for strategies that ask for it.
    """

    def __init__(self, name: str, model: InteractionModel) -> None:
        self.name, self._model = name, model
        self.factory = find_strategy(name, "--check")
        self.watched: _Observed | None = None
        """The object of the scene that is being played."""

    def play(self, scene: str, step_s: float) -> tuple[Trace, _Observed]:
        """One episode with a fresh object.

        Raises:
            _BrokenRuleError: the strategy could not be made, raised, or gave no number.
        """
        chosen = SCENES[scene]
        scenario = validate(
            {
                "ego": dict(chosen.ego),
                "pedestrians": {"kerb_wait_s": chosen.kerb_wait_s},
                "experiment": {"step_s": step_s},
            },
            "conformance",
        )
        try:
            watched = _Observed(make_strategy(scenario, self.name, 0, self._model))
        except Exception as error:
            raise _StoppedError(f"cannot be made: {in_one_line(error)}", _SURVIVES) from None
        self.watched = watched
        trace = _run(scenario, watched, chosen.walkers)
        self.watched = None
        if trace.ending is Ending.ENGINE_FAILED:
            rule = _IS_FINITE if watched.asked_at_s is None else _SURVIVES
            raise _StoppedError(f"{scene}, step {step_s:g} s: {trace.reason}", rule)
        return trace, watched

    def hangs(self) -> bool:
        """Whether it has been thinking for too long; another thread asks."""
        asked_at_s = None if self.watched is None else self.watched.asked_at_s
        return asked_at_s is not None and monotonic() - asked_at_s > DECIDE_LIMIT_S


def _run(scenario: Scenario, strategy: Strategy, walkers: tuple[Walker, ...]) -> Trace:
    arrivals = [Arrival(i, at, side, 0.5) for i, (at, side, _) in enumerate(walkers)]
    return run_episode(
        PlainEngine(scenario.vehicle(), scenario.experiment.step_s),
        strategy,
        arrivals,
        lambda who, *_: walkers[who.index][2],
        constants_of(scenario),
    )


def _has_defaults(subject: Subject) -> None:
    missing = [p.name for p in parameters_of(subject.factory) if p.required]
    if missing:
        raise _BrokenRuleError(f"no default for {', '.join(missing)}")


def _survives(subject: Subject) -> None:
    for scene in SCENES:
        for step_s in STEPS_S:
            subject.play(scene, step_s)


def _is_finite(subject: Subject) -> None:
    for scene in SCENES:
        for step_s in STEPS_S:
            for answer in subject.play(scene, step_s)[1].answers:
                number = isinstance(answer, Real) and not isinstance(answer, bool)
                if answer is not None and not (number and math.isfinite(answer)):
                    raise _BrokenRuleError(f"{scene}, step {step_s:g} s: returned {answer!r}")


def _crosses_an_empty_road(subject: Subject) -> None:
    for step_s in STEPS_S:
        trace, _ = subject.play("nobody", step_s)
        if trace.ending is not Ending.CROSSED:
            raise _BrokenRuleError(f"step {step_s:g} s: {trace.ending} with nobody there")


def _is_deterministic(subject: Subject) -> None:
    for scene in SCENES:
        first, second = (subject.play(scene, 0.1)[1].answers for _ in range(2))
        if repr(first) != repr(second):
            raise _BrokenRuleError(f"{scene}: {_difference(first, second)}")


def _forgets(subject: Subject) -> None:
    alone = {scene: subject.play(scene, 0.1)[1].answers for scene in SCENES}
    for scene in reversed(SCENES):
        again = subject.play(scene, 0.1)[1].answers
        if repr(again) != repr(alone[scene]):
            raise _BrokenRuleError(f"{scene}, after others: {_difference(alone[scene], again)}")


def _leaves_alone(subject: Subject) -> None:
    for scene in SCENES:
        _, watched = subject.play(scene, 0.1)
        if watched.changed:
            raise _BrokenRuleError(f"{scene}: changed {watched.changed}")


def _keeps_nothing_in_its_class(subject: Subject) -> None:
    """State in the class would reach the next episode, and differ with the number of workers."""
    subject.play("nobody", 0.1)
    before = _class_state(subject.factory)
    for scene in SCENES:
        subject.play(scene, 0.1)
        after = _class_state(subject.factory)
        for name in before.keys() | after.keys():
            if repr(before.get(name)) != repr(after.get(name)):
                raise _BrokenRuleError(f"{scene}: changed {name} of the class")


def _class_state(strategy: Any) -> dict[str, Any]:
    return {
        name: copy.copy(value)
        for name, value in vars(strategy).items()
        if not name.startswith("__") and not inspect.isroutine(value)
    }


def _difference(one: list[Any], other: list[Any]) -> str:
    for step, (a, b) in enumerate(zip(one, other, strict=False)):
        if repr(a) != repr(b):
            return f"{a!r} and {b!r} at step {step}"
    return f"{len(one)} and {len(other)} steps"


_HAS_DEFAULTS = "every parameter has a default"
_SURVIVES = "survives nobody, many, people past its lane and behind it"
_IS_FINITE = "answers with a finite number or None"

CHECKS: dict[str, Callable[[Subject], None]] = {
    "remembers nothing of other episodes": _forgets,
    "keeps nothing in its class": _keeps_nothing_in_its_class,
    "the same episode twice gives the same answers": _is_deterministic,
    _HAS_DEFAULTS: _has_defaults,
    _SURVIVES: _survives,
    _IS_FINITE: _is_finite,
    "crosses an empty road": _crosses_an_empty_road,
    "leaves what it is given as it is": _leaves_alone,
}
"""Every check by what it demands; those of memory first, as it has to be empty for them."""


def check_strategy(name: str, model: InteractionModel | None = None) -> list[RuleResult]:
    """Hold a strategy with its default parameters against every check.

    Args:
        name: as in ``arms.av``: a built-in name, an entry point, or ``package.module:Class``.
        model: the interaction model, for strategies that ask for it; None: the shipped one.

    Raises:
        InputError: there is no such strategy.
    """
    subject = Subject(name, model or load_model(Scenario().model.name))
    found: dict[str, _BrokenRuleError | None] = {}
    done: Future[None] = Future()

    def check_all() -> None:
        try:
            _check_all(subject, found)
            done.set_result(None)
        except BaseException as error:
            done.set_exception(error)

    # A thread that hangs can be left behind, whatever it hangs in.
    Thread(target=check_all, daemon=True).start()
    while not wait([done], timeout=min(0.1, DECIDE_LIMIT_S)).done:
        if subject.hangs():
            hung = _StoppedError(f"decide took more than {DECIDE_LIMIT_S:g} s", _SURVIVES)
            return _verdicts(dict.fromkeys(CHECKS, hung) | found)
    done.result()
    return _verdicts(found)


def _check_all(subject: Subject, found: dict[str, _BrokenRuleError | None]) -> None:
    for check in CHECKS:
        try:
            CHECKS[check](subject)
        except _BrokenRuleError as error:
            found[check] = error
        else:
            found[check] = None


def _verdicts(found: Mapping[str, _BrokenRuleError | None]) -> list[RuleResult]:
    """What stopped several checks is the fault of one: the others were not made."""
    stopped = {check: error for check, error in found.items() if isinstance(error, _StoppedError)}
    verdicts = []
    for check in CHECKS:
        error = found[check]
        problem = None if error is None else " ".join(str(error).split())
        checked = True
        if isinstance(error, _StoppedError):
            same = [other for other in stopped if stopped[other].rule == error.rule]
            owner = error.rule if error.rule in same else same[0]
            if found[_HAS_DEFAULTS] not in (None, error):
                owner = _HAS_DEFAULTS
            checked = check == owner
        verdicts.append(
            RuleResult(check, problem if checked else f"not checked: {problem}", checked)
        )
    return verdicts
