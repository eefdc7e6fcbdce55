"""Fixtures shared by all tests."""

from collections.abc import Callable, Iterator

import pytest

from harness.engine.protocol import Engine
from harness.interaction import InteractionModel, load_model
from harness.network import place_of
from harness.scenario import Scenario

MakeEngine = Callable[[Scenario], Engine]


@pytest.fixture(scope="session")
def model() -> InteractionModel:
    """The shipped interaction model that scenarios use by default."""
    return load_model(Scenario().model.name)


_open: dict[str, Engine] = {}


def _close_all() -> None:
    for engine in _open.values():
        engine.close()
    _open.clear()


@pytest.fixture
def sumo() -> MakeEngine:
    """Gives a SUMO engine for a scenario; this process's one simulation is kept open."""
    from harness.engine.sumo import libsumo_engine  # tests/unit needs no SUMO

    def make(scenario: Scenario) -> Engine:
        key = repr((scenario.crossing, scenario.ego, scenario.experiment.step_s))
        if key not in _open:
            _close_all()
            _open[key] = libsumo_engine(
                place_of(scenario),
                scenario.vehicle(),
                scenario.crosswalk(),
                scenario.experiment.step_s,
            )
        return _open[key]

    return make


@pytest.fixture
def no_simulation() -> Iterator[None]:
    """For tests that start libsumo themselves: nothing of this process runs meanwhile."""
    _close_all()
    yield
    _close_all()


@pytest.fixture(scope="session", autouse=True)
def _close_at_the_end() -> Iterator[None]:
    yield
    _close_all()
