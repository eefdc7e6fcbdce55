"""Every named fault can be put where it belongs, so that the runner can try it."""

import ast
from typing import Any

import pytest

from benchmarks.named_faults import CHECKOUT, faults

FEWEST = 143


def test_there_are_enough_and_each_has_a_name_of_its_own() -> None:
    names = [fault["name"] for fault in faults()]
    assert len(names) >= FEWEST
    assert len({*names}) == len(names)


@pytest.mark.parametrize("fault", faults(), ids=lambda fault: fault["name"])
def test_a_fault_changes_one_place_and_is_tried_by_tests_that_exist(fault: dict[str, Any]) -> None:
    text = (CHECKOUT / fault["file"]).read_text("utf-8")
    assert text.count(fault["find"]) == 1
    changed = text.replace(fault["find"], fault["replace"])
    assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(text))
    assert fault["tests"]
    for test in fault["tests"]:
        path, _, name = test.partition("::")
        assert f"def {name}" in (CHECKOUT / path).read_text("utf-8")
