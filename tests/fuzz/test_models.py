"""Model files: whatever is in them, they load as a model or are refused in one line."""

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from harness.interaction import load_model, read_model
from harness.resources import shipped_directory
from harness.scenario import Scenario
from tests.fuzz.hostile import NAMES, VALUES, accepted_or_refused_in_one_line, cut_and_flipped

SHIPPED = shipped_directory("models") / f"{Scenario().model.name}.json"
CONTENT = SHIPPED.read_bytes()
DOCUMENT = json.loads(CONTENT)
ARRAYS = ("weights", "locations", "scale_matrices", "lower", "upper")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("models") / "hostile.json"


def works(path: Path) -> None:
    """A model that is accepted answers with speeds inside its box."""
    model = read_model(path)
    speeds = model.walking_speed(np.array([0.1, 0.9]), np.full(2, 30.0), np.full(2, 5.0))
    assert np.isfinite(speeds).all()
    assert (speeds >= model.mixture.lower[2]).all()
    assert (speeds <= model.mixture.upper[2]).all()


@given(cut_and_flipped(CONTENT))
def test_cut_off_or_changed_bytes(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    accepted_or_refused_in_one_line(lambda: works(path))


@given(st.sampled_from([*DOCUMENT, "more"]), VALUES)
def test_any_value_at_any_key(path: Path, key: str, value: Any) -> None:
    path.write_text(json.dumps({**DOCUMENT, key: value}), encoding="utf-8")
    accepted_or_refused_in_one_line(lambda: works(path))


@given(st.sampled_from(ARRAYS), st.integers(0, 1000), st.floats())
def test_any_number_in_any_array(path: Path, key: str, where: int, number: float) -> None:
    document = copy.deepcopy(DOCUMENT)
    array = np.array(document[key], dtype=float)
    array.flat[where % array.size] = number
    document[key] = array.tolist()
    path.write_text(json.dumps(document), encoding="utf-8")
    accepted_or_refused_in_one_line(lambda: works(path))


@given(NAMES)
def test_any_name_of_a_shipped_model(name: str) -> None:
    accepted_or_refused_in_one_line(lambda: load_model(name))


@given(NAMES)
def test_any_path(path: Path, name: str) -> None:
    accepted_or_refused_in_one_line(lambda: load_model("x", str(path.parent / name)))
