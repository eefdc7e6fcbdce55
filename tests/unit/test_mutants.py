"""Mutants of a module of five lines, whose fates are known by reading it and its test."""

from pathlib import Path

import pytest

from benchmarks.mutants import CHECKOUT, mutants, rooms, verdict

MODULE = """\
def grown(count: int = 0, *, name: str = "é") -> int:
    while count < 3:
        count = count + 1
    return count if name else -2
"""

TEST = """\
from toy import grown

def test_grown() -> None:
    assert grown() == 3
"""


def test_what_is_changed(tmp_path: Path) -> None:
    (tmp_path / "toy.py").write_text(MODULE, encoding="utf-8")
    found = [*mutants(tmp_path / "toy.py", tmp_path)]
    assert sorted((one.line, one.before, one.after) for one in found) == [
        (1, "0", "(1)"),
        (2, "3", "(4)"),
        (2, "count < 3", "(count <= 3)"),
        (2, "count < 3", "(count >= 3)"),
        (2, "count < 3", "(not (count < 3))"),
        (3, "1", "(2)"),
        (3, "count + 1", "(count - 1)"),
        (4, "-2", "(2)"),
        (4, "2", "(3)"),
        (4, "count if name else -2", "(None)"),
        (4, "name", "(not (name))"),
    ]


@pytest.mark.slow
def test_what_becomes_of_them(tmp_path: Path) -> None:
    module = tmp_path / "toy.py"
    module.write_text(MODULE, encoding="utf-8")
    (tmp_path / "test_toy.py").write_text(TEST, encoding="utf-8")
    by_fault = {one.after: one for one in mutants(module, tmp_path)}
    fates = {
        "(1)": ("SURVIVED", 60.0),  # From 1 it grows to 3, too.
        "(count <= 3)": ("killed", 60.0),
        "(count - 1)": ("NO ANSWER", 2.0),
    }
    for fault, (fate, limit_s) in fates.items():
        assert verdict(tmp_path, by_fault[fault], ["test_toy.py"], limit_s) == fate
        assert module.read_text("utf-8") == MODULE


@pytest.mark.parametrize("name", rooms())
def test_rooms_name_what_there_is(name: str) -> None:
    for pattern in rooms()[name].modules:
        assert [*CHECKOUT.glob(pattern)], pattern
    for test in rooms()[name].tests:
        assert (CHECKOUT / test.partition("::")[0]).exists(), test
