"""The generated pages say something of everything there is."""

import re
from collections.abc import Callable

import pytest

from docs.hooks import reference
from harness.scenario import Scenario

SECTIONS = dict(reference.sections_of(Scenario))


def test_every_section_and_key_is_found() -> None:
    assert {"[crossing]", "[[crossing.obstacles]]", "[pedestrians.walking_speed]"} <= {*SECTIONS}
    names = {name.strip("[]").partition(".")[0] for name in SECTIONS}
    assert names == {*Scenario.model_fields} - {"strategies"}
    row = "| `duration_s` | number > 0, ≤ 604,800 | s | `3600.0` | "
    assert row in reference.keys_page()


@pytest.mark.parametrize("section", SECTIONS.values(), ids=lambda section: section.__name__)
def test_every_key_says_what_it_is(section: type) -> None:
    said = {key for name, key in reference.meanings_of_keys() if name == section.__name__}
    assert said == {*section.model_fields}  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "page", [reference.keys_page, reference.columns_page, reference.commands_page]
)
def test_nothing_is_taken_for_html(page: Callable[[], str]) -> None:
    assert "<" not in re.sub("`[^`]*`", "", page())
