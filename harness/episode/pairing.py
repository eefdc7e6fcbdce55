"""Runs pairs of one cell: lets both arms meet the same pedestrians."""

from collections.abc import Callable, Iterable, Iterator
from itertools import islice

from harness.encounter import Arm, Arrival, Ending, Trace
from harness.engine.protocol import Engine
from harness.episode.arms import check_arms, make_strategy
from harness.episode.arrivals import planned_arrivals
from harness.episode.loop import Episode, failed_episode, run_episode
from harness.episode.rules import rules_of
from harness.episode.walkers import ChooseSpeed
from harness.episode.walking_speeds import SpeedsOfOtherArm, WalkingSpeeds
from harness.errors import StrategyError, in_one_line
from harness.interaction import InteractionModel
from harness.measures import Outcome, measure
from harness.scenario import Scenario

CHUNK_PAIRS = 50
"""Pairs measured together; results do not depend on it."""


class PairRunner:
    """Runs pairs of one cell on one engine, one after another.

    Args:
        scenario: the cell.
        model: the interaction model, for walking speeds and for strategies that ask for it.
        get_engine: gives an open engine for this scenario; asked at the beginning of a run and
            again after an engine failed (that one has been closed).  The caller closes the last.

    Raises:
        InputError: an arm names no strategy, or its parameters are refused.
    """

    def __init__(
        self, scenario: Scenario, model: InteractionModel, get_engine: Callable[[], Engine]
    ) -> None:
        self._scenario, self._model, self._get_engine = scenario, model, get_engine
        self._engine: Engine | None = None
        self._rules = rules_of(scenario)
        self._speeds = WalkingSpeeds(model, self._rules, scenario.model.pedestrian_reading)
        check_arms(scenario, model)

    def run(
        self, pairs: Iterable[int], on_pair: Callable[[], None] = lambda: None
    ) -> Iterator[Outcome]:
        """Both arms of every pair, AV first, in the order asked for.

        ``on_pair`` is called whenever a pair has been simulated: outcomes come a chunk at a time.
        """
        remaining = iter(pairs)
        self._engine = None
        while chunk := list(islice(remaining, CHUNK_PAIRS)):
            planned = {pair: planned_arrivals(self._scenario, pair) for pair in chunk}
            self._speeds.foresee(planned.values())
            episodes = []
            for pair, arrivals in planned.items():
                episodes += [(pair, arm, trace) for arm, trace in self._run_pair(pair, arrivals)]
                on_pair()
            records = measure([trace for _, _, trace in episodes])
            for (pair, arm, trace), record in zip(episodes, records, strict=True):
                yield Outcome(pair, arm, self._strategy_name(arm), record, trace)

    def begin(self, pair: int) -> Episode:
        """The AV's episode of a pair, for somebody else to drive; the caller ends the engine's."""
        self._engine = self._get_engine()
        arrivals = planned_arrivals(self._scenario, pair)
        self._speeds.foresee([arrivals])
        return Episode(self._engine, arrivals, self._speeds, self._rules)

    def run_arm(self, pair: int, arm: Arm, get_other: Callable[[], Engine]) -> Outcome:
        """One arm of a pair alone, exactly as in ``run``.

        Args:
            pair: index of the pair.
            arm: which arm.
            get_other: gives the engine on which the AV's arm runs first, where the human's needs
                its walking speeds.
        """
        self._engine = None
        arrivals = planned_arrivals(self._scenario, pair)
        self._speeds.foresee([arrivals])
        choose: ChooseSpeed = self._speeds
        if arm is Arm.HUMAN and self._scenario.pedestrians.pairing == "speed":
            self._engine = get_other()
            automated = self._run_arm(Arm.AV, pair, arrivals, self._speeds)
            choose = SpeedsOfOtherArm(automated.walks, self._model)
            self._engine = None
        trace = self._run_arm(arm, pair, arrivals, choose)
        return Outcome(pair, arm, self._strategy_name(arm), measure([trace])[0], trace)

    def _run_pair(self, pair: int, arrivals: tuple[Arrival, ...]) -> list[tuple[Arm, Trace]]:
        automated = self._run_arm(Arm.AV, pair, arrivals, self._speeds)
        choose: ChooseSpeed = self._speeds
        if self._scenario.pedestrians.pairing == "speed":
            choose = SpeedsOfOtherArm(automated.walks, self._model)
        human = self._run_arm(Arm.HUMAN, pair, arrivals, choose)
        return [(Arm.AV, automated), (Arm.HUMAN, human)]

    def _run_arm(
        self, arm: Arm, pair: int, arrivals: tuple[Arrival, ...], choose: ChooseSpeed
    ) -> Trace:
        if self._engine is None:
            self._engine = self._get_engine()
        name = self._strategy_name(arm)
        try:
            strategy = make_strategy(self._scenario, name, pair, self._model)
        except Exception as error:
            what = f"the strategy could not be made: {in_one_line(error)}"
            return failed_episode(StrategyError(what, error), self._rules)
        trace = run_episode(self._engine, strategy, arrivals, choose, self._rules)
        if trace.ending is Ending.ENGINE_FAILED:
            # Nothing of a broken simulation may reach the next episode.
            self._engine.close()
            self._engine = None
        return trace

    def _strategy_name(self, arm: Arm) -> str:
        arms = self._scenario.arms
        return arms.av if arm is Arm.AV else arms.human
