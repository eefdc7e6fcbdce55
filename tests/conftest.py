"""Fixtures shared by all tests."""

from collections.abc import Callable, Iterator

import pytest

from harness.engine.protocol import Engine
from harness.experiment import sumo_engine
from harness.interaction import InteractionModel, load_model
from harness.scenario import Scenario

MakeEngine = Callable[[Scenario], Engine]


@pytest.fixture(scope="session")
def model() -> InteractionModel:
    """The shipped interaction model that scenarios use by default."""
    return load_model(Scenario().model.name)


@pytest.fixture(scope="session")
def sumo() -> Iterator[MakeEngine]:
    """Gives a SUMO engine for a scenario; the one simulation of this process is kept open."""
    current: dict[str, Engine] = {}

    def make(scenario: Scenario) -> Engine:
        key = repr((scenario.crossing, scenario.ego, scenario.experiment.step_s))
        if key not in current:
            for engine in current.values():
                engine.close()
            current.clear()
            current[key] = sumo_engine(scenario)()
        return current[key]

    yield make
    for engine in current.values():
        engine.close()
