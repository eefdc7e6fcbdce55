"""Plays a small scene with a strategy on the plain engine; returns the trace and all answers."""

from collections.abc import Mapping
from time import monotonic
from types import MappingProxyType
from typing import Any, NamedTuple

from harness.core.encounter import Arm, Arrival, Ending, Observation, Side, Strategy, Trace
from harness.core.errors import in_one_line
from harness.encounter.arms import make_strategy
from harness.encounter.cell_constants import constants_of
from harness.encounter.loop import run_episode
from harness.engine.plain import PlainEngine
from harness.model.interaction import InteractionModel
from harness.scenario import ExperimentSection, Scenario, validate
from harness.strategies.registry import find_strategy

STEPS_S = (0.1, 0.05)

DECIDE_LIMIT_S = ExperimentSection().decide_limit_s
"""Wall-time limit in s for one answer, as in a run."""

Walker = tuple[float, Side, float]
"""Arrival time (s), side, walking speed (m/s)."""


class Scene(NamedTuple):
    """Pedestrians who do not react to the ego, and the ego's changed parameters."""

    walkers: tuple[Walker, ...]
    ego: Mapping[str, float] = MappingProxyType({})
    kerb_wait_s: float = 0.0


def _crowd(count: int) -> tuple[Walker, ...]:
    sides = tuple(Side)
    return tuple((0.7 * i, sides[i % 2], 0.6 + 0.37 * (i % 5)) for i in range(count))


EMPTY_ROAD = "an empty road"

SCENES: dict[str, Scene] = {
    EMPTY_ROAD: Scene(()),
    "a pedestrian from the near side": Scene(((0.0, Side.NEAR, 1.2),)),
    "a slow pedestrian from the far side": Scene(((0.0, Side.FAR, 0.5),)),
    "a running pedestrian": Scene(((4.0, Side.NEAR, 3.0),)),
    "many pedestrians from both sides": Scene(_crowd(25)),
    "many pedestrians at the same time": Scene(tuple((1.0, side, 1.3) for side in (*Side,) * 10)),
    # The first pedestrian leaves the lane after 4.5 m, in 3 s; the ego sees them from R = 10 m.
    "a pedestrian past the lane when first seen": Scene(
        ((0.0, Side.NEAR, 1.5), (0.5, Side.NEAR, 1.4)), {"detection_range_m": 10.0}
    ),
    # They step off when the ego is at R = 2.5 m, 0.5 m before the crosswalk.
    "a pedestrian who steps off as the ego passes": Scene(((5.5, Side.FAR, 0.6),)),
    "pedestrians who wait at the kerb": Scene(
        ((3.8, Side.NEAR, 1.2), (4.5, Side.FAR, 1.2)), kerb_wait_s=2.0
    ),
    "a fast ego with weak brakes": Scene(
        ((0.0, Side.NEAR, 1.0), (2.0, Side.FAR, 1.0)),
        {"initial_speed_mps": 16.0, "trigger_range_m": 60.0, "max_deceleration_mps2": 2.0},
    ),
}


SURVIVES = "plays every scene to its end"
IS_FINITE = "answers with a finite number"
"""If a scene cannot be played to its end, the strategy broke one of these two rules."""


class BrokenRuleError(Exception):
    """The problem that a check found, in one line, with the observation that led to it."""

    def __init__(self, problem: str, observation: Observation | None = None) -> None:
        super().__init__(problem)
        self.observation = observation


class StoppedError(BrokenRuleError):
    """A scene could not be played to its end; ``rule`` is the broken rule."""

    def __init__(self, problem: str, rule: str, observation: Observation | None = None) -> None:
        super().__init__(problem, observation)
        self.rule = rule


class Observed:
    """Passes observations to a strategy and records its answers.

    The answer None, SUMO's own driver, means constant speed here, except in a vehicle that obeys
    late: SUMO does not drive that one.
    """

    def __init__(self, strategy: Strategy) -> None:
        self.strategy = strategy
        self.answers: list[Any] = []
        self.observations: list[Observation] = []
        self.changed: Observation | None = None
        self.call_began_s: float | None = None
        """Start of the call that has not returned; None between calls."""

    def decide(self, observation: Observation, /) -> float | None:
        """Return the strategy's answer; ``changed`` records an observation that it changed."""
        before = repr(observation)
        self.observations.append(observation)
        self.call_began_s = monotonic()
        answer = self.strategy.decide(observation)
        self.call_began_s = None
        if self.changed is None and repr(observation) != before:
            self.changed = observation
        self.answers.append(answer)
        return answer


class Subject:
    """A strategy under check.

    Args:
        name: the strategy's name, as in ``arms.av``.
        scenario: gives the crosswalk, the ego, its actuation and the strategy's parameters.
        model: the interaction model for strategies that use it.
    """

    def __init__(self, name: str, scenario: Scenario, model: InteractionModel) -> None:
        self.name, self._model = name, model
        self._base = scenario.model_dump(include={"actuation", "crossing", "ego", "strategies"})
        self.parameters = scenario.strategies.get(name, {})
        self.road_limit_mps = scenario.crossing.road_speed_limit_mps
        self.factory = find_strategy(name, "--check")
        self.decide_limit_s = DECIDE_LIMIT_S
        self.current: Observed | None = None
        """The strategy object of the present scene; None between scenes."""

    def play(self, scene: str, step_s: float) -> tuple[Trace, Observed]:
        """Play an episode with a new strategy object.

        Raises:
            StoppedError: the strategy could not be made, raised an exception, or did not answer
                with a number.
        """
        chosen = SCENES[scene]
        scenario = validate(
            {
                **self._base,
                "actuation": {**self._base["actuation"], "human": True},
                "ego": {**self._base["ego"], **chosen.ego},
                "arms": {"human": self.name},
                "pedestrians": {"kerb_wait_s": chosen.kerb_wait_s},
                "experiment": {"step_s": step_s},
            },
            "conformance",
        )
        try:
            observed = Observed(make_strategy(scenario, Arm.HUMAN, 0, self._model))
        except (Exception, SystemExit) as error:
            raise StoppedError(f"cannot be made: {in_one_line(error)}", SURVIVES) from None
        self.current = observed
        trace = _run(scenario, observed, chosen.walkers)
        self.current = None
        if trace.ending is Ending.ENGINE_FAILED:
            rule = IS_FINITE if observed.call_began_s is None else SURVIVES
            last = observed.observations[-1] if observed.observations else None
            raise StoppedError(f"{scene}, step {step_s:g} s: {trace.reason}", rule, last)
        return trace, observed

    def stopped(self, problem: str, rule: str) -> StoppedError:
        """Return the error for a strategy that takes too long, with its last observation."""
        observations = [] if self.current is None else self.current.observations
        return StoppedError(problem, rule, observations[-1] if observations else None)

    def hangs(self) -> bool:
        """Return whether the current call takes too long.  Another thread calls this."""
        call_began_s = None if self.current is None else self.current.call_began_s
        return call_began_s is not None and monotonic() - call_began_s > self.decide_limit_s


def _run(scenario: Scenario, strategy: Strategy, walkers: tuple[Walker, ...]) -> Trace:
    arrivals = [Arrival(i, at, side, 0.5) for i, (at, side, _) in enumerate(walkers)]
    return run_episode(
        PlainEngine(scenario.vehicle(), scenario.experiment.step_s),
        strategy,
        arrivals,
        lambda who, *_: walkers[who.index][2],
        constants_of(scenario, Arm.HUMAN),
    )
