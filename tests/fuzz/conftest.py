"""How many cases: a sample in `make test`, 10,000 of each in `make test-all`."""

import pytest
from hypothesis import HealthCheck, settings

SAMPLE, FULL = 40, 10_000

_QUIET = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large]


def pytest_configure(config: pytest.Config) -> None:
    """The same cases each time: what fails here fails everywhere."""
    many = FULL if config.option.markexpr != "not slow" else SAMPLE
    settings.register_profile(
        "fuzz",
        max_examples=many,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=_QUIET,
    )
    settings.load_profile("fuzz")
