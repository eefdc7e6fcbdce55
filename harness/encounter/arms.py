"""A scenario in; the strategies of both arms out, checked before a run, new for each episode."""

from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from harness.core.documents import as_plain
from harness.core.errors import InputError, in_one_line
from harness.core.seeding import Given, GivenFirst, Purpose, stream
from harness.core.vocabulary import NO_MODEL_USE, Arm, ModelUse, Strategy
from harness.encounter.driver import attribute_of
from harness.model.interaction import InteractionModel, ModelUseCounter, check_support
from harness.scenario import Scenario
from harness.strategies.parameters import check_parameters, knows_the_model, needs
from harness.strategies.perception.sensor import sensor_of
from harness.strategies.registry import STRATEGIES, find_strategy, table_key


def draws_from(scenario: Scenario, driver: Arm) -> Purpose:
    """The purpose of the stream from which a driver draws.

    ``arms.av`` has its own stream, so it never gets the numbers that decide how the human driver
    drives in the same pair.  If both arms name the same strategy, both draw the same numbers.
    """
    alike = scenario.arms.av == scenario.arms.human
    return "strategy" if alike or driver is Arm.HUMAN else "av_strategy"


def arm_key(scenario: Scenario, arm: Arm) -> str | None:
    """What an arm's episodes depend on besides the people, the road and the model, as text.

    Cells with the same people, road and model share the episodes of an arm if their keys are equal:
    the same strategy with the same parameters and stream, the same sensor, the same vehicle.  A
    user's own strategy has no key, because it may depend on more.
    """
    name = scenario.arms.driver(arm)
    if name not in STRATEGIES:
        return None
    drives = name, as_plain(scenario.strategies.get(name, {})), draws_from(scenario, arm)
    return repr((arm, drives, sensor_of(scenario, arm), scenario.vehicle(arm)))


def draws_numbers(scenario: Scenario, driver: Arm) -> bool:
    """Whether a driver's strategy uses random numbers."""
    return "rng" in needs(find_strategy(scenario.arms.driver(driver), "arms"))


def make_strategy(
    scenario: Scenario,
    driver: Arm,
    pair: int,
    model: InteractionModel,
    *vehicle: int,
    given: Given = MappingProxyType({}),
) -> Strategy:
    """A new strategy object for one episode, or for one ``vehicle`` of a pair with several.

    Args:
        scenario: has the strategies of both arms, their parameters, the seed and the step.
        driver: selects ``arms.av`` or ``arms.human``, independently of the simulated arm.
        pair: keys the stream of its draws, together with ``vehicle``.
        model: the interaction model, for strategies that need it.
        given: the first draws, by purpose.
    """

    def draws_of() -> np.random.Generator:
        purpose = draws_from(scenario, driver)
        rng = stream(scenario.experiment.seed, purpose, pair, *vehicle)
        state = rng.bit_generator.state
        # Its numbers without its seed, from which a strategy could compute who comes.
        bits: np.random.BitGenerator = np.random.PCG64(rng.integers(2**63, size=4))
        bits.state = state
        first = given.get(purpose, ())
        return GivenFirst(bits, first) if first else np.random.Generator(bits)

    return named_strategy(scenario, scenario.arms.driver(driver), model, draws_of)


def named_strategy(
    scenario: Scenario, name: str, model: InteractionModel, rng: Callable[[], np.random.Generator]
) -> Strategy:
    """A new object of the strategy with this name, with the scenario's parameters.

    Args:
        scenario: has the parameters and the step.
        name: name of the strategy.
        model, rng: arguments for strategies that need them.

    Raises:
        InputError: there is no such strategy; its constructor may raise anything else.
    """
    factory = find_strategy(name, "arms")
    parameters = as_plain(scenario.strategies.get(name, {}))
    given = {"model": lambda: model, "step_s": lambda: scenario.experiment.step_s, "rng": rng}
    return factory(**{key: given[key]() for key in needs(factory)}, **parameters)


def uses_of(strategy: Strategy) -> ModelUse:
    """How often a strategy has asked the model, if it counts that in ``model_use``.

    Raises:
        StrategyError: the strategy raised an exception.
    """
    counter = attribute_of(strategy, "model_use")
    return counter.counts if isinstance(counter, ModelUseCounter) else NO_MODEL_USE


def asks_model(scenario: Scenario) -> bool:
    """Whether the model is used with the ego's state, for walking speeds or for a driver."""
    arms = scenario.arms.model_dump().items()
    if any(knows_the_model(find_strategy(name, f"arms.{key}")) for key, name in arms):
        return True
    return scenario.walks_by_model and scenario.model.pedestrian_reading != "unconditional"


def check_arms(scenario: Scenario, model: InteractionModel) -> None:
    """Refuse unknown strategies and parameters before anything runs.

    A state at the trigger that lies outside the data of a model in use is refused too.

    Raises:
        InputError: something is refused; names the key of the scenario.
    """
    # A simulation's roads are checked with it.
    asks = scenario.simulation is None and asks_model(scenario)
    if asks and not scenario.model.extrapolate:
        check_support(model, scenario.ego.trigger_range_m, scenario.ego.initial_speed_mps)
    for name in scenario.strategies:
        where = table_key(name)
        check_parameters(find_strategy(name, where), scenario.strategies[name], where)
    for key, name in scenario.arms.model_dump().items():
        where = table_key(name)
        factory = find_strategy(name, f"arms.{key}")
        check_parameters(factory, scenario.strategies.get(name, {}), where)
        try:
            make_strategy(scenario, Arm(key), 0, model)
        except InputError as error:
            raise error.at(f"{where}.{error.where}") from None
        except (Exception, SystemExit) as error:
            raise InputError(where, f"cannot be made: {in_one_line(error)}") from None
