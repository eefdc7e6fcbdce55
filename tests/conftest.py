"""Fixtures shared by all tests."""

import os
import sys
from collections.abc import Callable, Iterator

import pytest
from hypothesis import settings

from harness.engine.protocol import Engine
from harness.model.interaction import InteractionModel, load_model
from harness.scenario import Scenario
from tests.densities import Joint

# pytest-xdist gives its workers 80 columns; screens are tested as in a pipe.
os.environ.pop("COLUMNS", None)
# Every core has a worker already: threads of its arithmetic would wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Many processes are started: what they import is compiled once.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Properties have the same examples each time; `make test-all` looks for fresh ones.
settings.register_profile("fixed", deadline=None, derandomize=True, database=None)
settings.register_profile("fresh", deadline=None)
settings.load_profile("fixed")

MakeEngine = Callable[[Scenario], Engine]


@pytest.fixture(scope="session")
def model() -> InteractionModel:
    """The shipped interaction model that scenarios use by default."""
    return load_model(Scenario().model.name)


@pytest.fixture(scope="session")
def joint(model: InteractionModel) -> Joint:
    """Its density, written out."""
    return Joint(model.mixture)


def close_all() -> None:
    """End this process's one simulation, whoever keeps it open."""
    # tests/unit needs no SUMO: what was not imported has nothing open.
    if shared := sys.modules.get("harness.engine.shared"):
        shared.close_engine()


@pytest.fixture
def sumo() -> MakeEngine:
    """Gives a SUMO engine for a scenario; this process's one simulation is kept open."""
    from harness.engine.shared import open_engine  # tests/unit needs no SUMO

    return open_engine


@pytest.fixture
def no_simulation() -> Iterator[None]:
    """For tests that start libsumo themselves: nothing of this process runs meanwhile."""
    close_all()
    yield
    close_all()


@pytest.fixture(scope="module", autouse=True)
def _nothing_is_left_open() -> Iterator[None]:
    """A process has one simulation: that of a module does not stand in the next one's way."""
    yield
    close_all()
