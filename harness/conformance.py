"""What every strategy must keep to, whichever it is: small scenes on the plain engine.

The same checks hold the built-in strategies (tests/conformance) and a user's own
(``harness strategies --check``).
"""

import copy
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
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
from harness.scenario import ExperimentSection, Scenario, Setting, load_scenario, validate
from harness.strategies.parameters import check_parameters, parameters_of
from harness.strategies.registry import find_strategy, table_key

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
    # They step off when the ego is at R = 2.5 m, 0.5 m before the crosswalk.
    "one steps off as it passes": Scene(((5.5, Side.FAR, 0.6),)),
    "some wait at the kerb": Scene(((3.8, Side.NEAR, 1.2), (4.5, Side.FAR, 1.2)), kerb_wait_s=2.0),
    "a fast, weak ego": Scene(
        ((0.0, Side.NEAR, 1.0), (2.0, Side.FAR, 1.0)),
        {"initial_speed_mps": 16.0, "trigger_range_m": 60.0, "max_deceleration_mps2": 2.0},
    ),
}


LIMIT_S = 60.0
"""How long all checks together may take."""


class _BrokenRuleError(Exception):
    """A check's finding, in one line; ``observation`` is what the strategy was shown there."""

    def __init__(self, problem: str, observation: Observation | None = None) -> None:
        super().__init__(problem)
        self.observation = observation


class _StoppedError(_BrokenRuleError):
    """A scene could not be played to its end; ``rule`` is the check that this belongs to."""

    def __init__(self, problem: str, rule: str, observation: Observation | None = None) -> None:
        super().__init__(problem, observation)
        self.rule = rule


@dataclass(frozen=True)
class RuleResult:
    """What one check found; ``problem`` is None where the strategy passed.

    ``observation`` is what the strategy was shown when it broke the rule, None where no single
    one is to blame.  ``checked`` is False where the check could not be made, for a reason that
    another one has found; ``problem`` says which.
    """

    check: str
    problem: str | None
    checked: bool = True
    observation: Observation | None = None


class _Observed:
    """Hands observations on to a strategy and keeps its answers.

    Where it answers None, which only SUMO could carry out, the speed is kept.
    """

    def __init__(self, strategy: Strategy) -> None:
        self.strategy = strategy
        self.answers: list[Any] = []
        self.observations: list[Observation] = []
        self.changed: Observation | None = None
        self.asked_at_s: float | None = None
        """When it was asked what it has not answered: by then it is thinking, or has raised."""

    def decide(self, observation: Observation, /) -> float:
        """The strategy's answer; its observation is compared with itself before."""
        before = repr(observation)
        self.observations.append(observation)
        self.asked_at_s = monotonic()
        answer = self.strategy.decide(observation)
        self.asked_at_s = None
        if self.changed is None and repr(observation) != before:
            self.changed = observation
        self.answers.append(answer)
        return 0.0 if answer is None else answer


class Subject:
    """A strategy under check.

    Args:
        name: as in ``arms.av``.
        scenario: says the crosswalk, the ego where a scene says nothing, and the parameters.
        model: the interaction model, for strategies that ask for it.
    """

    def __init__(self, name: str, scenario: Scenario, model: InteractionModel) -> None:
        self.name, self._model = name, model
        self._base = scenario.model_dump(include={"crossing", "ego", "strategies"})
        self.parameters = scenario.strategies.get(name, {})
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
                **self._base,
                "ego": {**self._base["ego"], **chosen.ego},
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
            last = watched.observations[-1] if watched.observations else None
            raise _StoppedError(f"{scene}, step {step_s:g} s: {trace.reason}", rule, last)
        return trace, watched

    def stopped(self, problem: str, rule: str) -> _StoppedError:
        """What is found where the strategy takes too long, with what it was shown last."""
        seen = [] if self.watched is None else self.watched.observations
        return _StoppedError(problem, rule, seen[-1] if seen else None)

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
    known = subject.parameters
    missing = [p.name for p in parameters_of(subject.factory) if p.required and p.name not in known]
    if missing:
        raise _BrokenRuleError(f"no default for {', '.join(missing)}")


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
                    raise _BrokenRuleError(what, observation)


def _crosses_an_empty_road(subject: Subject) -> None:
    for step_s in STEPS_S:
        trace, watched = subject.play("nobody", step_s)
        if trace.ending is not Ending.CROSSED:
            what = f"step {step_s:g} s: {trace.ending} with nobody there"
            raise _BrokenRuleError(what, watched.observations[-1])


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
            raise _BrokenRuleError(f"{scene}: changed the observation", watched.changed)


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


def _refuse_difference(where: str, one: _Observed, other: _Observed) -> None:
    """Refuse answers that are not the same, with the first of them and what was shown there."""
    answers = zip(one.answers, other.answers, other.observations, strict=False)
    for step, (a, b, observation) in enumerate(answers):
        if repr(a) != repr(b):
            raise _BrokenRuleError(f"{where}: {a!r} and {b!r} at step {step}", observation)
    if len(one.answers) != len(other.answers):
        raise _BrokenRuleError(f"{where}: {len(one.answers)} and {len(other.answers)} steps")


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


def check_strategy(
    strategy: str | type,
    model: InteractionModel | None = None,
    scenario: Scenario | str | Path = "cctc",
    settings: Mapping[str, Any] | Sequence[Setting] = (),
    limit_s: float = LIMIT_S,
) -> list[RuleResult]:
    """Hold a strategy against every check.

    Args:
        strategy: as in ``arms.av``: a built-in name, an entry point, ``package.module:Class``, or
            a class.
        model: the interaction model, for strategies that ask for it; None: the scenario's.
        scenario: says the crosswalk, the ego where a scene says nothing, and the strategy's
            parameters; who comes is the scenes' business.
        settings: changes to it, where it is no ``Scenario``.
        limit_s: of wall time, for all checks together.

    Raises:
        InputError: there is no such strategy, or the scenario, a setting or a parameter is refused.
    """
    name = validate({"arms": {"av": strategy}}, "strategy").arms.av
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario, settings)
    section = scenario.model
    subject = Subject(name, scenario, model or load_model(section.name, section.path))
    check_parameters(subject.factory, subject.parameters, table_key(name))
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
    begun_s = monotonic()
    while not wait([done], timeout=min(0.1, DECIDE_LIMIT_S)).done:
        stopped: _StoppedError | None = None
        if subject.hangs():
            stopped = subject.stopped(f"decide took more than {DECIDE_LIMIT_S:g} s", _SURVIVES)
        elif monotonic() - begun_s > limit_s:
            stopped = subject.stopped(f"not finished after {limit_s:g} s in all", "")
        if stopped is not None:
            return _verdicts(dict.fromkeys(CHECKS, stopped) | found)
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
            RuleResult(
                check,
                problem if checked else f"not checked: {problem}",
                checked,
                error.observation if error is not None and checked else None,
            )
        )
    return verdicts
