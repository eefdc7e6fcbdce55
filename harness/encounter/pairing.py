"""The simulation of pairs of one cell, in which both arms meet the same pedestrians."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from harness.core.errors import InputError, StrategyError, in_one_line
from harness.core.seeding import Given
from harness.core.vocabulary import Arm, Arrival, Ending, Trace, ignore
from harness.encounter.arms import check_arms, make_strategy, uses_of
from harness.encounter.arrivals import already_walking, planned_arrivals
from harness.encounter.cell_constants import constants_of
from harness.encounter.loop import Episode, drive, failed
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.engine.protocol import Engine
from harness.measures import Outcome, measure
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario
from harness.strategies.perception.sensor import sensor_of

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
        check_arms(scenario, model)

    def run(
        self,
        pairs: Iterable[int],
        begins: Begins = ignore,
        on_pair: Callable[[], None] = ignore,
        known: Mapping[ArmOfPair, Outcome] = MappingProxyType({}),
        arms: Sequence[Arm] = tuple(Arm),
        asks: Callable[[int, Arm], None] = ignore,
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
            made = dict(zip(traces, self._outcomes(traces, traces.values()), strict=True))
            for pair in chunk:
                for arm in arms:
                    yield known.get((arm, pair)) or made[arm, pair]

    def run_arm_given(
        self,
        arm: Arm,
        pairs: Iterable[tuple[int, Given]],
        on_episode: Callable[[], None] = ignore,
        begins: Begins = ignore,
    ) -> Iterator[Outcome]:
        """Simulate one arm of every pair with some given uniforms.

        Args:
            arm: the arm.
            pairs: index of each pair, which keys the streams, and its given uniforms.
            on_episode: called after every simulated episode.
            begins: called with every episode before its strategy drives.
        """
        self._engine = None
        keys, traces = [], []
        for pair, given in pairs:
            keys.append((arm, pair))
            traces.append(self._run_arm(arm, pair, self._people(pair, given), begins))
            on_episode()
        return self._outcomes(keys, traces)

    def run_arm(self, pair: int, arm: Arm) -> Outcome:
        """Simulate one arm of a pair, exactly as in ``run``."""
        (outcome,) = self.run([pair], arms=[arm])
        return outcome

    def hung(self, arm: Arm, pair: int, reason: str) -> Outcome:
        """The outcome of an episode whose strategy did not answer in time."""
        trace = failed(self._nothing(arm), StrategyError(reason))
        return next(self._outcomes([(arm, pair)], [trace]))

    def begin(self, pair: int) -> Episode:
        """The AV's episode of a pair; the caller drives it and ends it."""
        self._engine = None
        return self._episode(Arm.AV, self._people(pair))

    def _outcomes(self, keys: Iterable[ArmOfPair], traces: Iterable[Trace]) -> Iterator[Outcome]:
        measured = [*traces]
        for (arm, pair), trace, record in zip(keys, measured, measure(measured), strict=True):
            yield Outcome(pair, arm, self._scenario.arms.driver(arm), record, trace)

    def _people(self, pair: int, given: Given | None = None) -> "_People":
        """All pedestrians of a pair, also the ones who are on the crosswalk at the trigger."""
        drawn = self._scenario.pedestrians.drawn
        if drawn and pair >= len(drawn):
            raise InputError("pair", f"{pair}", f"below {len(drawn)}, those of pedestrians.drawn")
        number = drawn[pair].episode if drawn else pair
        if given is None:
            given = drawn[pair].uniforms if drawn else {}
        coming = planned_arrivals(self._scenario, number, given)
        walking = self._speeds.unconditional
        present = already_walking(self._scenario, number, walking, len(coming))
        return _People(number, given, (*present, *coming))

    def _episode(self, arm: Arm, people: "_People") -> Episode:
        """A new episode on the engine, which is asked for if there is none."""
        self._engine = self._engine or self._get_engine()
        shown, sensor = None, self._sensors[arm]
        if sensor is not None:
            from harness.strategies.perception.encounter_view import Perception

            shown = Perception(sensor, people.arrivals, people.number, people.given)
        return Episode(self._engine, people.arrivals, self._speeds, self._rules[arm], shown)

    def _nothing(self, arm: Arm) -> Trace:
        """The trace of an episode that could not begin."""
        rules, none = self._rules[arm], np.array([])
        return Trace(
            vehicle=rules.vehicle,
            crossing=rules.crossing,
            step_s=rules.step_s,
            x_m=none,
            speed_mps=none,
            walks=(),
            ending=Ending.FAILED,
        )

    def _run_arm(self, arm: Arm, pair: int, people: "_People", begins: Begins) -> Trace:
        """The trace of one arm; a failure of the strategy is part of it."""
        episode = self._episode(arm, people)
        try:
            strategy = make_strategy(
                self._scenario, arm, people.number, self._model, given=people.given
            )
        except (Exception, SystemExit) as error:
            what = f"the strategy could not be made: {in_one_line(error)}"
            return failed(self._nothing(arm), StrategyError(what, error))
        self._speeds.model_use.begin()
        begins(pair, arm, episode)
        trace = drive(episode, strategy)
        try:
            uses = self._speeds.model_use.counts.joined(uses_of(strategy))
            trace = replace(trace, conditionings=uses)
        except StrategyError as error:
            trace = failed(trace, error)
        if trace.ending is Ending.FAILED:
            # The next episode needs a new simulation.
            episode.engine.close()
            self._engine = None
        return trace


class _People(NamedTuple):
    """The pedestrians of a pair; ``number`` keys the streams of uniforms that are not given."""

    number: int
    given: Given
    arrivals: tuple[Arrival, ...]
