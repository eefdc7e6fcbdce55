"""Memory has a bound, and `make test` has a sample of the cases."""

import resource
from collections.abc import Iterator

import psutil
import pytest

from tests.fuzz import hostile

_MEMORY = 6 * 2**30
"""Address space beyond what is mapped already: more is no small file's fair share."""


def pytest_configure(config: pytest.Config) -> None:
    """A sample of the cases in `make test`, all of them in `make test-all`."""
    hostile.full = config.option.markexpr != "not slow"


@pytest.fixture(scope="package", autouse=True)
def _bounded_memory() -> Iterator[None]:
    mapped = psutil.Process().memory_info().vms
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (mapped + _MEMORY, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)
