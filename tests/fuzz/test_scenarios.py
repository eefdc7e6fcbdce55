"""Scenario files: whatever is in them, they load or are refused in one line."""

import copy
import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, strategies as st

from harness.resources import shipped_directory
from harness.scenario import (
    parse_setting,
    parse_variation,
    read_scenario_file,
    single_cell,
    study_of,
)
from tests.fuzz.hostile import NAMES, VALUES, accepted_or_refused_in_one_line, cut_and_flipped

CCTC = (shipped_directory("scenarios") / "cctc.toml").read_bytes()
TREE = tomllib.loads(CCTC.decode())
KEYS = [(table, key) for table, values in TREE.items() for key in values] + [
    ("pedestrians", "behaviour"),
    ("pedestrians", "timed"),
    ("pedestrians", "gap_acceptance"),
    ("model", "path"),
    ("strategies", "constant_speed"),
    ("limits", "mu0"),
    ("conflicts", "ttc_s"),
    ("sweep", "cells"),
    ("sweep", "arms"),
]


def toml(value: Any) -> str:
    """A value as TOML, where it has it; what TOML lacks becomes text."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return "nan" if math.isnan(value) else repr(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, list):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{quoted(k)} = {toml(v)}" for k, v in value.items()) + "}"
    return quoted("" if value is None else value)


def quoted(text: str) -> str:
    """A TOML basic string; what it must not hold is escaped."""
    plain = {'"': '\\"', "\\": "\\\\"}
    return (
        '"'
        + "".join(
            plain.get(c, c if c.isprintable() and ord(c) < 0xD800 else f"\\U{ord(c):08X}")
            for c in text
        )
        + '"'
    )


def written(tree: dict[str, Any]) -> bytes:
    lines = [f"{quoted(table)} = {toml(values)}" for table, values in tree.items()]
    return "\n".join(lines).encode("utf-8", errors="replace")


def read(path: Path) -> None:
    """Everything of a scenario file that is checked before anything runs."""
    file = read_scenario_file(path)
    if file.sweep is None:
        single_cell(file)
    else:
        study_of(file, [])


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenarios") / "hostile.toml"


@given(cut_and_flipped(CCTC))
def test_cut_off_or_changed_bytes(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    accepted_or_refused_in_one_line(lambda: read(path))


@given(st.sampled_from(KEYS), VALUES)
@example(("experiment", "pairs"), 10**400)
@example(("strategies", "constant_speed"), {"x": {}})
def test_any_value_at_any_key(path: Path, key: tuple[str, str], value: Any) -> None:
    tree = copy.deepcopy(TREE)
    tree.setdefault(key[0], {})[key[1]] = value
    path.write_bytes(written(tree))
    accepted_or_refused_in_one_line(lambda: read(path))


@given(st.dictionaries(st.one_of(NAMES, st.sampled_from(list(TREE))), VALUES, max_size=4))
def test_any_tables(path: Path, tree: dict[str, Any]) -> None:
    path.write_bytes(written(tree))
    accepted_or_refused_in_one_line(lambda: read(path))


@given(st.one_of(NAMES, st.text(max_size=60)), st.sampled_from([f"{a}.{b}" for a, b in KEYS]))
def test_any_option(text: str, key: str) -> None:
    for option in (text, f"{key}={text}", f"{text}={text}"):
        accepted_or_refused_in_one_line(
            lambda option=option: read_scenario_file("cctc", [parse_setting(option)]).scenario()
        )
        accepted_or_refused_in_one_line(
            lambda option=option: study_of(read_scenario_file("cctc"), [parse_variation(option)])
        )


def test_what_is_written_here_is_toml() -> None:
    assert tomllib.loads(written(TREE).decode()) == TREE
