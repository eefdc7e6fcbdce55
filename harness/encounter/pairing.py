"""The simulation of pairs of one cell, in which both arms meet the same pedestrians."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from harness.core.encounter import Arm, Arrival, Ending, Observation, Strategy, Trace
from harness.core.errors import StrategyError, in_one_line
from harness.core.seeding import Given
from harness.encounter.arms import check_arms, draws, draws_of, named_strategy
from harness.encounter.arrivals import already_walking, planned_arrivals
from harness.encounter.cell_constants import constants_of
from harness.encounter.loop import Episode, drive, failed_episode
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.engine.protocol import Engine
from harness.measures import Outcome, measure
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario
from harness.strategies.human_gmm import HumanDriver
from harness.strategies.perception.sensor import sensor_of

if TYPE_CHECKING:
    from harness.strategies.perception.perception import Perception

CHUNK_PAIRS = 50
"""Number of pairs that are measured together; results do not depend on it."""

ArmOfPair = tuple[Arm, int]
"""An episode of a cell."""

Begins = Callable[[int, Arm, Episode], None]
"""A callback with the pair, the arm and the episode that begins."""


class PairRunner:
    """Runs pairs of one cell on one engine, one after another.

    Args:
        scenario: the cell.
        model: the interaction model, for walking speeds and for strategies that need it.
        get_engine: returns an open engine for this scenario.  It is called at the beginning of a
            run and again after an engine failed and was closed.  The caller closes the last one.

    Raises:
        InputError: a strategy is unknown, or its parameters are refused.
    """

    def __init__(
        self, scenario: Scenario, model: InteractionModel, get_engine: Callable[[], Engine]
    ) -> None:
        self._scenario, self._model, self._get_engine = scenario, model, get_engine
        self._engine: Engine | None = None
        self._rules = {arm: constants_of(scenario, arm) for arm in Arm}
        self._sensors = {arm: sensor_of(scenario, arm) for arm in Arm}
        self._speeds = WalkingSpeeds(scenario, model)
        self.decisions_s: list[float] | None = None
        """If it is a list, the wall time of each decision is added to it."""
        check_arms(scenario, model)

    def run(
        self,
        pairs: Iterable[int],
        begins: Begins = lambda _pair, _arm, _episode: None,
        on_pair: Callable[[], None] = lambda: None,
        known: Mapping[ArmOfPair, Outcome] = MappingProxyType({}),
        arms: Sequence[Arm] = tuple(Arm),
        asks: Callable[[int, Arm], None] = lambda _pair, _arm: None,
    ) -> Iterator[Outcome]:
        """Simulate both arms of every pair in the given order, the AV's first.

        Args:
            pairs: indices of the pairs.
            begins: called with every episode before its strategy drives.
            on_pair: called after every simulated pair; the outcomes come later, in chunks.
            known: outcomes of episodes that are not simulated again.
            arms: the arms to simulate, if not both.
            asks: called with pair and arm before an episode's strategy is made.
        """
        remaining = iter(pairs)
        self._engine = None
        while chunk := list(islice(remaining, CHUNK_PAIRS)):
            traces: dict[ArmOfPair, Trace] = {}
            for pair in chunk:
                people = self._people(pair)
                for arm in arms:
                    if (arm, pair) not in known:
                        asks(pair, arm)
                        traces[arm, pair] = self._run_arm(arm, pair, people, begins)
                on_pair()
            records = dict(zip(traces, measure(list(traces.values())), strict=True))
            for pair in chunk:
                for arm in arms:
                    key, name = (arm, pair), self._scenario.arms.driver(arm)
                    yield known.get(key) or Outcome(pair, arm, name, records[key], traces[key])

    def hung(self, arm: Arm, pair: int, reason: str) -> Outcome:
        """The outcome of an episode whose strategy did not answer in time."""
        trace = failed_episode(StrategyError(reason), self._rules[arm])
        return Outcome(pair, arm, self._scenario.arms.driver(arm), measure([trace])[0], trace)

    def run_arm_given(
        self,
        arm: Arm,
        pairs: Sequence[tuple[int, Given]],
        on_episode: Callable[[np.random.Generator | None], None],
        begins: Begins = lambda _pair, _arm, _episode: None,
    ) -> Iterator[Outcome]:
        """Simulate one arm of every pair with some given uniforms.

        Args:
            arm: the arm.
            pairs: index of each pair, which keys the streams, and its given uniforms.
            on_episode: called after every simulated episode with the generator that the strategy
                drew from, or None if it uses no random numbers.
            begins: called with every episode before its strategy drives.
        """
        self._engine = None
        drawing = draws(self._scenario, arm)
        traces = []
        for pair, given in pairs:
            people = self._people(pair, given)
            rng = draws_of(self._scenario, arm, people.number, given=given) if drawing else None
            traces.append(self._run_arm(arm, pair, people, begins, rng))
            on_episode(rng)
        for (pair, _), trace, record in zip(pairs, traces, measure(traces), strict=True):
            yield Outcome(pair, arm, self._scenario.arms.driver(arm), record, trace)

    def begin(self, pair: int) -> Episode:
        """The AV's episode of a pair; the caller drives it and ends it."""
        self._engine = self._get_engine()
        people = self._people(pair)
        perception = self._perception(Arm.AV, people)
        speeds = self._speeds
        return Episode(self._engine, people.arrivals, speeds, self._rules[Arm.AV], perception)

    def run_arm(
        self,
        pair: int,
        arm: Arm,
        begins: Begins = lambda _pair, _arm, _episode: None,
    ) -> Outcome:
        """Simulate one arm of a pair, exactly as in ``run``.

        Args:
            pair: index of the pair.
            arm: the arm.
            begins: called with the episode before its strategy drives.
        """
        self._engine = None
        trace = self._run_arm(arm, pair, self._people(pair), begins)
        name = self._scenario.arms.driver(arm)
        return Outcome(pair, arm, name, measure([trace])[0], trace)

    def _people(self, pair: int, given: Given | None = None) -> "_People":
        """All pedestrians of a pair, also the ones who are on the crosswalk at the trigger."""
        drawn = self._scenario.pedestrians.drawn
        number = drawn[pair].episode if drawn else pair
        given = drawn[pair].uniforms if drawn and given is None else given or {}
        coming = planned_arrivals(self._scenario, number, given)
        walking = self._speeds.unconditional
        present = already_walking(self._scenario, number, walking, len(coming))
        return _People(number, given, (*present, *coming))

    def _run_arm(
        self,
        arm: Arm,
        pair: int,
        people: "_People",
        begins: Begins = lambda _pair, _arm, _episode: None,
        rng: np.random.Generator | None = None,
    ) -> Trace:
        if self._engine is None:
            self._engine = self._get_engine()
        scenario, number = self._scenario, people.number
        try:
            strategy = named_strategy(
                scenario,
                scenario.arms.driver(arm),
                self._model,
                lambda: rng or draws_of(scenario, arm, number, given=people.given),
            )
        except (Exception, SystemExit) as error:
            what = f"the strategy could not be made: {in_one_line(error)}"
            return failed_episode(StrategyError(what, error), self._rules[arm])
        perception = self._perception(arm, people)
        speeds = self._speeds
        speeds.model_use.begin()
        episode = Episode(self._engine, people.arrivals, speeds, self._rules[arm], perception)
        begins(pair, arm, episode)
        timed_s = self.decisions_s
        driver = strategy if timed_s is None else TimedStrategy(strategy, timed_s)
        trace = drive(episode, driver)
        conditionings = speeds.model_use.counts
        if isinstance(strategy, HumanDriver):
            conditionings = conditionings.joined(strategy.model_use.counts)
        trace = replace(trace, conditionings=conditionings)
        if trace.ending is Ending.ENGINE_FAILED:
            # The next episode needs a new simulation.
            self._engine.close()
            self._engine = None
        return trace

    def _perception(self, arm: Arm, people: "_People") -> "Perception | None":
        sensor = self._sensors[arm]
        if sensor is None:
            return None
        from harness.strategies.perception.perception import Perception

        return Perception(sensor, people.arrivals, people.number, people.given)


class _People(NamedTuple):
    """The pedestrians of a pair; ``number`` keys the streams of uniforms that are not given."""

    number: int
    given: Given
    arrivals: tuple[Arrival, ...]


class TimedStrategy:
    """Drives as a strategy does, and adds the wall time of each decision to ``decisions_s``."""

    def __init__(self, strategy: Strategy, decisions_s: list[float]) -> None:
        self._strategy, self._decide, self._note = strategy, strategy.decide, decisions_s.append

    @property
    def fallback(self) -> bool:
        """See ``Strategy``."""
        return bool(getattr(self._strategy, "fallback", False))

    def decide(self, observation: Observation) -> float:
        """See ``Strategy.decide``."""
        begin_s = perf_counter()
        command = self._decide(observation)
        self._note(perf_counter() - begin_s)
        return command
