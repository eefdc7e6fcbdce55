"""Unit tests need no module of SUMO: all are blocked while they run."""

import sys
from collections.abc import Iterator

import pytest


@pytest.fixture(scope="package", autouse=True)
def _without_sumo() -> Iterator[None]:
    blocked = {name: sys.modules.get(name) for name in ("libsumo", "traci", "sumolib", "sumo")}
    sys.modules.update(dict.fromkeys(blocked))
    yield
    for name, module in blocked.items():
        del sys.modules[name]
        if module is not None:
            sys.modules[name] = module
