"""Small scenes that many tests play: given walkers, given strategy, given engine."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from harness import Arm, EgoView, Observation, PedestrianView, Side, Strategy
from harness.core.errors import InputError
from harness.core.vocabulary import Arrival, Ending, Trace, Walk
from harness.encounter import loop
from harness.encounter.arrivals import planned_arrivals
from harness.encounter.cell_constants import constants_of
from harness.encounter.pairing import PairRunner
from harness.encounter.walkers import ChooseSpeed
from harness.engine.plain import PlainEngine
from harness.engine.protocol import Engine
from harness.measures import EpisodeRecord, Outcome, measure
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario, validate
from harness.strategies.perception.encounter_view import Perception

Walker = tuple[float, Side, float]
"""When they step off (or arrive), from where, how fast they walk in m/s."""


def scenario(**sections: dict[str, Any]) -> Scenario:
    """The paper's scenario (its kerb rule and step) with changes by section."""
    tree: dict[str, dict[str, Any]] = {"pedestrians": {"kerb_wait_s": 0.0}}
    for name, values in sections.items():
        tree.setdefault(name, {}).update(values)
    return validate(tree, "test")


def outcome_of(trace: Trace) -> Outcome:
    """A trace as the AV's episode of pair 0, measured."""
    return Outcome(0, Arm.AV, "test", measure([trace])[0], trace)


def plans(scene: Scenario, pairs: int = 4_000) -> list[tuple[Arrival, ...]]:
    """Who comes in the first pairs of a scenario."""
    return [planned_arrivals(scene, pair) for pair in range(pairs)]


def on_plain(scene: Scenario, model: InteractionModel) -> PairRunner:
    """Runs pairs of a scenario on the plain engine."""
    step_s = scene.experiment.step_s
    return PairRunner(scene, model, lambda: PlainEngine(scene.vehicle(), step_s))


class Recorder:
    """Keeps what it is shown and drives by a function of it."""

    def __init__(self, command: Callable[[Observation], Any] = lambda _: 0.0) -> None:
        self.seen: list[Observation] = []
        self._command = command

    def decide(self, observation: Observation, /) -> Any:
        self.seen.append(observation)
        return self._command(observation)


def shown(
    scene: Scenario, range_m: float, speed: float, *people: PedestrianView, time_s: float = 0.0
) -> Observation:
    """What a driver is shown of the ego at R and of these people."""
    ego, constants = EgoView(range_m, speed, 0.0), (scene.vehicle(), scene.crosswalk())
    return Observation(time_s, scene.experiment.step_s, ego, *constants, people)


def braking_steps(trace: Trace) -> list[int]:
    return np.flatnonzero(np.diff(trace.speed_mps) < -1e-9).tolist()


def episode(
    scene: Scenario,
    strategy: Strategy,
    arrivals: Sequence[Arrival],
    choose_speed: ChooseSpeed = lambda *_: 1.2,
    perception: Perception | None = None,
    engine: Engine | None = None,
) -> Trace:
    """One episode, on the plain engine unless another is given."""
    engine = engine or PlainEngine(scene.vehicle(), scene.experiment.step_s)
    begun = loop.Episode(engine, arrivals, choose_speed, constants_of(scene), perception)
    return loop.drive(begun, strategy)


def play(
    strategy: Strategy,
    walkers: Sequence[Walker],
    scene: Scenario | None = None,
    engine: Engine | None = None,
) -> Trace:
    """One episode with walkers by their arrival."""
    arrivals = [Arrival(i, at, side, 0.5) for i, (at, side, _) in enumerate(walkers)]
    speed = lambda who, *_: walkers[who.index][2]  # noqa: E731
    return episode(scene or scenario(), strategy, arrivals, speed, engine=engine)


def drive(
    accelerations: Sequence[float],
    walkers: Sequence[Walker] = (),
    *,
    speed: float = 5.0,
    step: float = 0.1,
    ending: Ending = Ending.CROSSED,
    reason: str | None = None,
    scene: Scenario | None = None,
) -> Trace:
    """An episode from R0 = 30 m with one acceleration for each step."""
    scene = scene or scenario()
    x, speeds = [-30.0], [speed]
    for acceleration in accelerations:
        x.append(x[-1] + speeds[-1] * step + acceleration * step**2 / 2)
        speeds.append(speeds[-1] + acceleration * step)
    return Trace(
        vehicle=scene.vehicle(),
        crossing=scene.crosswalk(),
        step_s=step,
        x_m=np.array(x),
        speed_mps=np.array(speeds),
        walks=tuple(
            Walk(Arrival(i, start, side, 0.5), start, walking, 30.0, 5.0)
            for i, (start, side, walking) in enumerate(walkers)
        ),
        ending=ending,
        reason=reason,
    )


def refuses(words: str, call: Callable[[], object]) -> None:
    """A call that is refused in such words."""
    with pytest.raises(InputError, match=words):
        call()


def refusal_of(call: Callable[[], object], *parts: str) -> InputError:
    """The error of a call that is refused in one line which has these parts."""
    with pytest.raises(InputError) as caught:
        call()
    line = str(caught.value)
    assert [part for part in ("", *parts) if part not in line or "\n" in line] == [], line
    return caught.value


def record(*args: Any, **kwargs: Any) -> EpisodeRecord:
    """The record of such a drive."""
    return measure([drive(*args, **kwargs)])[0]
