"""Checks whether a strategy keeps the rules that make results repeatable.

It plays small scenes on the plain engine, all in one order and again in the reverse order.  Each
rule is a row of ``STRATEGY_RULES``.  Built-in strategies and those of users undergo the same
checks.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, wait
from itertools import zip_longest
from pathlib import Path
from threading import Thread
from types import MappingProxyType
from typing import Any, NamedTuple

from harness.core.errors import Parameter, checked, in_one_line
from harness.core.vocabulary import SPEED_ROUNDING, Arm, Arrival, Ending, Observation, Side, Trace
from harness.encounter.arms import make_strategy
from harness.encounter.cell_constants import constants_of
from harness.encounter.loop import Episode, drive
from harness.engine.plain import PlainEngine
from harness.model.interaction import InteractionModel, load_model
from harness.scenario import Scenario, Setting, load_scenario, validate
from harness.strategies.parameters import check_parameters
from harness.strategies.program import is_program
from harness.strategies.registry import find_strategy, table_key

LIMIT_S = 60.0
"""Wall-time limit in s for all checks together."""


class Scene(NamedTuple):
    """People (arrival in s, side, speed in m/s) who do not react, and the ego's own parameters."""

    walkers: tuple[tuple[float, Side, float], ...]
    ego: Mapping[str, float] = MappingProxyType({})
    kerb_wait_s: float = 0.0


_EMPTY, _NEAR, _FAR = "an empty road", Side.NEAR, Side.FAR
_WEAK = {"initial_speed_mps": 16.0, "trigger_range_m": 60.0, "max_deceleration_mps2": 2.0}
_SHORT = {"detection_range_m": 10.0}

# fmt: off
SCENES = MappingProxyType[str, Scene]({
    _EMPTY: Scene(()),
    "a slow pedestrian from the far side": Scene(((0.0, _FAR, 0.5),)),
    "a running pedestrian": Scene(((4.0, _NEAR, 3.0),)),
    "many pedestrians at the same time": Scene(tuple((1.0, side, 1.3) for side in (*Side,) * 10)),
    # The first pedestrian leaves the lane after 4.5 m, in 3 s; the ego sees them from R = 10 m.
    "one past the lane when first seen": Scene(((0.0, _NEAR, 1.5), (0.5, _NEAR, 1.4)), _SHORT),
    # They step off when the ego is at R = 2.5 m, 0.5 m before the crosswalk.
    "a pedestrian who steps off as the ego passes": Scene(((5.5, _FAR, 0.6),)),
    "pedestrians who wait": Scene(((3.8, _NEAR, 1.2), (4.5, _FAR, 1.2)), kerb_wait_s=2.0),
    "a fast ego with weak brakes": Scene(((0.0, _NEAR, 1.0), (2.0, _FAR, 1.0)), _WEAK),
})
# fmt: on

_PLAYS = [(scene, step_s) for scene in SCENES for step_s in (0.1, 0.05)]
_PLAYS += [(scene, 0.1) for scene in reversed(SCENES)]
_KEPT = ("actuation", "crossing", "ego", "strategies")


class BrokenRuleError(Exception):
    """A broken rule, in one line; ``rule`` is set if a scene could not be played to its end."""

    def __init__(self, problem: str, seen: Sequence[Observation] = (), rule: str = "") -> None:
        super().__init__(" ".join(problem.split()))
        self.observation, self.rule = (seen[-1] if seen else None), rule


class Verdict(NamedTuple):
    """Whether a strategy keeps a rule.

    ``problem`` is None if it does.  If another rule's problem prevented the check, ``checked`` is
    False and ``problem`` repeats that problem.  ``observation`` is the one that broke the rule.
    """

    rule: str
    why: str
    problem: str | None = None
    checked: bool = True
    observation: Observation | None = None

    @property
    def row(self) -> dict[str, str]:
        """What a table says of it."""
        return {
            "rule": self.rule,
            "kept": "yes" if self.problem is None else "no" if self.checked else "-",
            "problem": self.problem or "",
            "shown": "" if self.observation is None else str(self.observation),
            "why": self.why,
        }


class Play:
    """A scene that a new object of a strategy plays: its observations, answers and trace."""

    def __init__(self, scene: str, step_s: float) -> None:
        self.scene, self.step_s = scene, step_s
        self.observations: list[Observation] = []
        self.answers: list[Any] = []
        self._decide: Callable[[Observation], float]
        self.trace: Trace

    def by(self, strategy: str, base: Scenario, model: InteractionModel) -> "Play":
        """Play it with the parameters, crosswalk, ego and actuation of a scenario.

        Raises:
            BrokenRuleError: the strategy cannot be made, raised, or answered without a number.
        """
        chosen, tree = SCENES[self.scene], base.model_dump(include={*_KEPT})
        tree["actuation"]["human"] = True
        tree["ego"] |= chosen.ego
        tree |= {"arms": {"human": strategy}, "experiment": {"step_s": self.step_s}}
        tree["pedestrians"] = {"kerb_wait_s": chosen.kerb_wait_s}
        scenario = validate(tree, "checks")
        try:
            self._decide = make_strategy(scenario, Arm.HUMAN, 0, model).decide
        except (Exception, SystemExit) as error:
            why = f"cannot be made: {in_one_line(error)}"
            raise BrokenRuleError(why, rule=_SURVIVES) from None
        episode = Episode(
            PlainEngine(scenario.vehicle(), self.step_s),
            [Arrival(i, at, side, 0.5) for i, (at, side, _) in enumerate(chosen.walkers)],
            lambda who, *_: chosen.walkers[who.index][2],
            constants_of(scenario, Arm.HUMAN),
        )
        self.trace = drive(episode, self)
        if self.trace.ending is Ending.FAILED:
            raise self.stopped(str(self.trace.reason))
        return self

    def decide(self, observation: Observation, /) -> float:
        """The strategy's answer, which is noted."""
        self.observations.append(observation)
        answer = self._decide(observation)
        self.answers.append(answer)
        return answer

    def stopped(self, problem: str) -> BrokenRuleError:
        """The error for a scene that does not come to its end."""
        answered = len(self.answers) == len(self.observations)
        return self.broke(problem, -1, _IS_FINITE if answered else _SURVIVES)

    def broke(self, problem: str, at: int, rule: str = "") -> BrokenRuleError:
        """The error for a rule that is broken here, at an observation."""
        seen = self.observations[at:][:1]
        return BrokenRuleError(f"{self.scene}, step {self.step_s:g} s: {problem}", seen, rule)


@checked
def check_strategy(
    strategy: str | type,
    model: InteractionModel | None = None,
    scenario: Scenario | str | Path = "cctc",
    settings: Mapping[str, Any] | Sequence[Setting] = (),
    limit_s: float = LIMIT_S,
) -> tuple[Verdict, ...]:
    """Check every rule of a strategy.

    Args:
        strategy: a built-in name, ``package.module:Class``, or a class, as in
            ``arms.av``.
        model: the interaction model for strategies that use it; None means the scenario's.
        scenario: gives the crosswalk, the ego, its actuation and the strategy's parameters.  The
            scenes give the pedestrians and may change the ego.
        settings: changes to the scenario.
        limit_s: wall-time limit for all scenes together.

    Returns:
        A verdict for each rule.

    Raises:
        InputError: the strategy does not exist, or the scenario, a setting or a parameter is
            invalid.
    """
    name = validate({"arms": {"av": strategy}}, "strategy").arms.av
    scenario = load_scenario(scenario, settings)
    model = model or load_model(scenario.model.name, scenario.model.path)
    factory, given = find_strategy(name, Parameter("strategy")), scenario.strategies.get(name, {})
    check_parameters(factory, given, table_key(name))
    plays: list[Play] = []
    done: Future[None] = Future()

    def play_all() -> None:
        try:
            for play in _PLAYS:
                plays.append(Play(*play))
                plays[-1].by(name, scenario, model)
            done.set_result(None)
        except BaseException as error:
            done.set_exception(error)

    # A daemon thread that hangs does not keep the process alive.
    Thread(target=play_all, daemon=True).start()
    if not wait([done], timeout=limit_s).done:
        if plays and plays[0].answers:
            late = plays[-1].stopped(f"not all scenes were played within {limit_s:g} s")
        else:
            problem = f"no answer to the first observation within {limit_s:g} s"
            if is_program(name):
                problem += ": is the program's output flushed?"
            late = BrokenRuleError(problem, rule=_SURVIVES)
        return _verdicts([], late)
    error = done.exception()
    if error is not None and not isinstance(error, BrokenRuleError):
        raise error
    return _verdicts(plays, error)


def _verdicts(plays: Sequence[Play], stopped: BrokenRuleError | None) -> tuple[Verdict, ...]:
    """The verdict on each rule; what ended the plays is one fault, and the other rules wait."""
    verdicts = []
    for rule, why, check in STRATEGY_RULES:
        try:
            if stopped is not None:
                raise stopped
            check(plays)
            verdicts.append(Verdict(rule, why))
        except BrokenRuleError as error:
            here = error.rule in ("", rule)
            problem = str(error) if here else f"not checked: {error}"
            verdicts.append(Verdict(rule, why, problem, here, error.observation if here else None))
    return tuple(verdicts)


def _played(_plays: Sequence[Play]) -> None:
    """The rule holds if all scenes were played."""


def _same_answers(plays: Sequence[Play]) -> None:
    first: dict[tuple[str, float], Play] = {}
    for play in plays:
        before = first.setdefault((play.scene, play.step_s), play).answers
        for at, (a, b) in enumerate(zip_longest(before, play.answers)):
            if repr(a) != repr(b):
                raise play.broke(f"{a!r} the first time, and then {b!r} at step {at}", at)


def _crosses(plays: Sequence[Play]) -> None:
    for play in plays:
        if play.scene == _EMPTY and play.trace.ending is not Ending.CROSSED:
            raise play.broke(f"{play.trace.ending} although the road was empty", -1)


def _keeps_to_the_limit(plays: Sequence[Play]) -> None:
    for play in plays:
        allowed_mps = play.trace.vehicle.initial_speed_mps, play.trace.crossing.speed_limit_mps
        most_mps = max(each for each in allowed_mps if each is not None)
        speeding = play.trace.speed_mps > most_mps * (1 + SPEED_ROUNDING)
        if speeding.any():
            what = f"drove at {play.trace.speed_mps.max():.3g} m/s, above {most_mps:g} m/s"
            raise play.broke(what, max(int(speeding.argmax()) - 1, 0))


class StrategyRule(NamedTuple):
    """A rule, why it is one, and a function that raises ``BrokenRuleError`` if it is broken."""

    name: str
    why: str
    check: Callable[[Sequence[Play]], None]


_SURVIVES = "plays every scene to its end"
_IS_FINITE = "answers with a finite number"

# fmt: off
STRATEGY_RULES: tuple[StrategyRule, ...] = (
    StrategyRule(_SURVIVES, "an exception is a failed episode", _played),
    StrategyRule(_IS_FINITE, "anything else is a failed episode", _played),
    StrategyRule("crosses an empty road", "else each episode ends as a time-out", _crosses),
    StrategyRule("gives the same answers in the same scene, whatever it has played before",
         "else rows depend on the order of episodes and the number of workers", _same_answers),
    StrategyRule("keeps to the road's speed limit, or to v0 without a limit",
         "speeding saves the time that is measured", _keeps_to_the_limit),
)
# fmt: on
"""Every rule that a strategy has to keep."""
