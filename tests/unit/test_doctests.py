"""The examples in docstrings run, and give what they say."""

import doctest
import importlib
from pathlib import Path

import pytest

HARNESS = Path(__file__).parents[2] / "harness"
MODULES = [
    ".".join(path.relative_to(HARNESS.parent).with_suffix("").parts)
    for path in sorted(HARNESS.rglob("*.py"))
    if ">>>" in path.read_text("utf-8")
]


@pytest.mark.parametrize("module", MODULES)
def test_examples(module: str) -> None:
    found = doctest.testmod(importlib.import_module(module), optionflags=doctest.ELLIPSIS)
    assert found.attempted > 0
    assert found.failed == 0
