"""How many cases: a sample in `make test`, at least 10,000 of each kind of file in full."""

import resource
from collections.abc import Iterator

import psutil
import pytest
from hypothesis import HealthCheck, Phase, settings

from tests.fuzz import hostile

_QUIET = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large]

_MEMORY = 6 * 2**30
"""Address space beyond what is mapped already: a case that wants more than that is no small file's
fair share."""


def pytest_configure(config: pytest.Config) -> None:
    """The same cases each time: what fails here fails everywhere."""
    hostile.full = config.option.markexpr != "not slow"
    settings.register_profile(
        "fuzz",
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=_QUIET,
        # A command is too slow for hundreds of attempts to fail with less.
        phases=[Phase.explicit, Phase.generate],
    )
    settings.load_profile("fuzz")


@pytest.fixture(scope="package", autouse=True)
def _bounded_memory() -> Iterator[None]:
    """An allocation without bounds fails, and fails the test, instead of filling the machine."""
    mapped = psutil.Process().memory_info().vms
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (mapped + _MEMORY, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)
