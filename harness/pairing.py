"""Runs pairs of one cell: makes the strategies, lets both arms meet the same pedestrians."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.encounter import Arm, Arrival, Ending, Side, Strategy, Trace, Walk
from harness.engine.protocol import Engine
from harness.episode import Episode, Rules, failed_episode, run_episode
from harness.errors import InputError, StrategyError, in_one_line
from harness.interaction import InteractionModel
from harness.measures import Outcome, measure
from harness.plan import planned_arrivals
from harness.scenario import Scenario
from harness.seeding import stream
from harness.strategies.parameters import check_complete, check_parameters, needs
from harness.strategies.registry import find_strategy, prepare, table_key
from harness.walkers import ChooseSpeed

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
        self._rules = Rules(
            vehicle=scenario.vehicle(),
            crossing=scenario.crosswalk(),
            kerb_wait_s=scenario.pedestrians.kerb_wait_s,
            step_s=scenario.experiment.step_s,
            timeout_s=scenario.experiment.timeout_s,
            behaviour=scenario.pedestrians.behaviour,
        )
        self._speeds = _WalkingSpeeds(model, self._rules, scenario.model.pedestrian_reading)
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

    def run_arm(self, pair: int, arm: Arm, other_engine: Engine) -> Outcome:
        """One arm of a pair alone, exactly as in ``run``.

        Args:
            pair: index of the pair.
            arm: which arm.
            other_engine: where the AV's arm runs first if the human's needs its walking speeds.
        """
        self._engine = None
        arrivals = planned_arrivals(self._scenario, pair)
        self._speeds.foresee([arrivals])
        choose: ChooseSpeed = self._speeds
        if arm is Arm.HUMAN and self._scenario.pedestrians.pairing == "speed":
            self._engine = other_engine
            automated = self._run_arm(Arm.AV, pair, arrivals, self._speeds)
            choose = _SpeedsOfOtherArm(automated.walks, self._model)
            self._engine = None
        trace = self._run_arm(arm, pair, arrivals, choose)
        return Outcome(pair, arm, self._strategy_name(arm), measure([trace])[0], trace)

    def _run_pair(self, pair: int, arrivals: tuple[Arrival, ...]) -> list[tuple[Arm, Trace]]:
        automated = self._run_arm(Arm.AV, pair, arrivals, self._speeds)
        choose: ChooseSpeed = self._speeds
        if self._scenario.pedestrians.pairing == "speed":
            choose = _SpeedsOfOtherArm(automated.walks, self._model)
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


def make_strategy(scenario: Scenario, name: str, pair: int, model: InteractionModel) -> Strategy:
    """A fresh strategy object for one episode; whatever its class has to prepare is prepared."""
    factory = find_strategy(name, "arms")
    parameters = scenario.strategies.get(name, {})
    prepare(factory, parameters)
    given: dict[str, Any] = {"model": model, "step_s": scenario.experiment.step_s}
    wanted = needs(factory)
    if "rng" in wanted:
        given["rng"] = stream(scenario.experiment.seed, "strategy", pair)
    return factory(**{key: given[key] for key in wanted}, **parameters)


def check_arms(scenario: Scenario, model: InteractionModel) -> None:
    """Refuse unknown strategies and parameters before anything runs.

    Raises:
        InputError: naming the key of the scenario.
    """
    for name in scenario.strategies:
        where = table_key(name)
        check_parameters(find_strategy(name, where), scenario.strategies[name], where)
    for key, name in scenario.arms.model_dump().items():
        where = table_key(name)
        factory = find_strategy(name, f"arms.{key}")
        check_complete(factory, scenario.strategies.get(name, {}), where)
        try:
            make_strategy(scenario, name, 0, model)
        except InputError as error:
            parameter = error.where.removeprefix(f"{name}.")
            raise InputError(f"{where}.{parameter}", error.problem, error.allowed) from None
        except Exception as error:
            raise InputError(where, f"cannot be made: {in_one_line(error)}") from None


class _WalkingSpeeds:
    """f(v_p | 1/R, v), or f(v_p | R, v, L), at each pedestrian's quantile.

    Whoever steps off at the trigger sees (R0, v0) in every episode: those speeds are worked out
    together, which is many times faster and gives the same bits.
    """

    def __init__(self, model: InteractionModel, rules: Rules, reading: str) -> None:
        self._model = model
        self._on_curve = reading == "curve"
        # From each kerb to the centre of the ego's lane, L of whoever steps off there.
        centre_m = rules.crossing.lane_centre_m
        self._lateral_m = {Side.NEAR: centre_m, Side.FAR: rules.crossing.length_m - centre_m}
        self._at_trigger = (rules.vehicle.trigger_range_m, rules.vehicle.initial_speed_mps)
        self._foreseen: dict[tuple[float, Side], float] = {}

    def foresee(self, planned: Iterable[tuple[Arrival, ...]]) -> None:
        first = [
            arrival
            for arrivals in planned
            for arrival in arrivals
            if arrival.arrival_s == 0 and arrival.quantile is not None
        ]
        self._foreseen = {}
        if first:
            keys = [(_quantile_of(arrival), arrival.side) for arrival in first]
            lateral = [self._lateral_m[arrival.side] for arrival in first]
            speeds = self._speeds([key for key, _ in keys], lateral, *self._at_trigger)
            self._foreseen = dict(zip(keys, speeds.tolist(), strict=True))

    def __call__(
        self, arrival: Arrival, range_m: float, speed_mps: float, lateral_m: float | None = None
    ) -> float:
        quantile = _quantile_of(arrival)
        key = (quantile, arrival.side)
        if (range_m, speed_mps) == self._at_trigger and lateral_m is None and key in self._foreseen:
            return self._foreseen[key]
        if range_m <= 0:
            return self._model.walking_speed_unconditional(quantile)
        if lateral_m is None:
            lateral_m = self._lateral_m[arrival.side]
        return float(self._speeds([quantile], [lateral_m], range_m, speed_mps)[0])

    def _speeds(
        self,
        quantile: Sequence[float],
        lateral_m: Sequence[float],
        range_m: float,
        speed_mps: float,
    ) -> NDArray[np.float64]:
        quantiles, laterals = np.array(quantile), np.array(lateral_m)
        range_of, speed_of = np.full(len(quantiles), range_m), np.full(len(quantiles), speed_mps)
        # Past the ego's lane there is no L: the curve says nothing there.
        if self._on_curve and (laterals > 0).all():
            speeds = self._model.walking_speed_on_curve(quantiles, range_of, laterals, speed_of)
            if not np.isnan(speeds).any():
                return speeds
            # Where no walking speed fits the box, L says nothing and is left out.
            marginal = self._model.walking_speed(quantiles, range_of, speed_of)
            return np.where(np.isnan(speeds), marginal, speeds)
        return self._model.walking_speed(quantiles, range_of, speed_of)


def _quantile_of(arrival: Arrival) -> float:
    """His quantile; timed pedestrians, who have none, never choose a speed."""
    assert arrival.quantile is not None
    return arrival.quantile


class _SpeedsOfOtherArm:
    """Pairing by speed: what the pedestrian did in the AV's arm, whoever comes now."""

    def __init__(self, walks: tuple[Walk, ...], model: InteractionModel) -> None:
        self._speeds = {walk.arrival.index: walk.speed_mps for walk in walks}
        self._model = model

    def __call__(
        self,
        arrival: Arrival,
        range_m: float,  # noqa: ARG002
        speed_mps: float,  # noqa: ARG002
        lateral_m: float | None = None,  # noqa: ARG002
    ) -> float:
        speed = self._speeds.get(arrival.index)
        if speed is None:
            return self._model.walking_speed_unconditional(_quantile_of(arrival))
        return speed
