"""Model files: whatever is in them, they are used as a model or refused in one line."""

import copy
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from harness.batch import experiment
from harness.cli import batch
from harness.interaction import load_model, read_model
from harness.resources import shipped_directory
from harness.scenario import Scenario
from tests.fuzz.command import done_or_refused, in_this_process
from tests.fuzz.hostile import (
    NAMES,
    VALUES,
    accepted_or_refused_in_one_line,
    cases,
    cut_and_flipped,
)

SHIPPED = shipped_directory("models") / f"{Scenario().model.name}.json"
CONTENT = SHIPPED.read_bytes()
DOCUMENT = json.loads(CONTENT)
ARRAYS = ("weights", "locations", "scale_matrices", "lower", "upper")
WAYS_OF_USE = ("walking", "show", "json", "run")
WAYS = st.sampled_from(WAYS_OF_USE)


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where the commands are given; a run ends when it has a manifest."""
    folder = tmp_path_factory.mktemp("models")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        in_this_process(patch)
        patch.setattr(experiment, "_carry_out", lambda *_: None)
        patch.setattr(batch, "_report", lambda *_: None)
        yield folder


@pytest.fixture(scope="module")
def path(folder: Path) -> Path:
    return folder / "hostile.json"


def works(path: Path) -> None:
    """A model that is accepted answers with speeds inside its box."""
    model = read_model(path)
    speeds = model.walking_speed(np.array([0.1, 0.9]), np.full(2, 30.0), np.full(2, 5.0))
    assert np.isfinite(speeds).all()
    assert (speeds >= model.mixture.lower[2]).all()
    assert (speeds <= model.mixture.upper[2]).all()


def used(path: Path, way: str) -> None:
    """Use a model file in one of the ways there are."""
    out = path.parent / "out"
    if way == "walking":
        accepted_or_refused_in_one_line(lambda: works(path))
    elif way == "show":
        done_or_refused("model", "show", path, inside=out)
    elif way == "json":
        done_or_refused("model", "show", path, "--json", inside=out)
    elif way == "plots":
        done_or_refused("model", "show", path, "--plots", out, inside=out)
    else:
        done_or_refused("run", "cctc", "--set", "model.path=hostile.json", "--out", out, inside=out)
    shutil.rmtree(out, ignore_errors=True)


@cases("model", 3_000)
@given(cut_and_flipped(CONTENT), WAYS)
def test_cut_off_or_changed_bytes(path: Path, content: bytes, way: str) -> None:
    path.write_bytes(content)
    used(path, way)


@cases("model", 2_500)
@given(st.sampled_from([*DOCUMENT, "more"]), VALUES, WAYS)
def test_any_value_at_any_key(path: Path, key: str, value: Any, way: str) -> None:
    path.write_text(json.dumps({**DOCUMENT, key: value}), encoding="utf-8")
    used(path, way)


@cases("model", 2_500)
@given(st.sampled_from(ARRAYS), st.integers(0, 1000), st.floats(), WAYS)
@example("scale_matrices", 0, 1e300, "show")
@example("upper", 1, 1e300, "show")
def test_any_number_in_any_array(path: Path, key: str, where: int, number: float, way: str) -> None:
    document = copy.deepcopy(DOCUMENT)
    array = np.array(document[key], dtype=float)
    array.flat[where % array.size] = number
    document[key] = array.tolist()
    path.write_text(json.dumps(document), encoding="utf-8")
    used(path, way)


@cases("model", 1_000)
@given(st.sampled_from(list(DOCUMENT["provenance"])), VALUES, WAYS)
def test_any_value_in_the_card(path: Path, key: str, value: Any, way: str) -> None:
    card = {**DOCUMENT["provenance"], key: value}
    path.write_text(json.dumps({**DOCUMENT, "provenance": card}), encoding="utf-8")
    used(path, way)


@cases("model", 30)
@given(st.sampled_from(["name", "weights", "locations"]), VALUES, NAMES)
@example("name", "$\\frac{$", "")
def test_figures_of_any_model(path: Path, key: str, value: Any, name: str) -> None:
    path.write_text(json.dumps({**DOCUMENT, "name": name, key: value}), encoding="utf-8")
    used(path, "plots")


@cases("model", 500)
@given(NAMES)
def test_any_name_of_a_shipped_model(name: str) -> None:
    accepted_or_refused_in_one_line(lambda: load_model(name))


@cases("model", 500)
@given(NAMES)
def test_any_path(path: Path, name: str) -> None:
    accepted_or_refused_in_one_line(lambda: load_model("x", str(path.parent / name)))
    done_or_refused("model", "show", "--", name, inside=path.parent)


def nested(depth: int) -> str:
    return "[" * depth + "]" * depth


UNUSUAL = {
    "empty": b"",
    "UTF-16 cut off": CONTENT.decode().encode("utf-16")[:-3],
    "no text": b"\xff\xfe\xfd",
    "not a number": CONTENT.replace(b'"schema"', b'"schema": NaN, "schema"', 1)[:20],
    "deep list": f'{{"provenance": {nested(50_000)}}}'.encode(),
    "rather deep list": f'{{"provenance": {nested(300)}}}'.encode(),
    "digits": b'{"schema": ' + b"9" * 5_000 + b"}",
    "exponent": b'{"schema": 1e999999999}',
    "escape sequence": json.dumps({**DOCUMENT, "name": "\x1b[2J"}).encode(),
    "surrogate": json.dumps({**DOCUMENT, "name": "\ud800"}).encode(),
    "no text for a name": json.dumps({**DOCUMENT, "name": [1]}).encode(),
}


@pytest.mark.parametrize("name", UNUSUAL)
def test_unusual_files_are_refused(path: Path, name: str) -> None:
    path.write_bytes(UNUSUAL[name])
    for way in (*WAYS_OF_USE, "plots"):
        used(path, way)
    assert not done_or_refused("model", "show", path, inside=path.parent / "out")


def test_what_is_no_regular_file_is_refused(folder: Path) -> None:
    (folder / "folder.json").mkdir()
    (folder / "loop.json").symlink_to("loop.json")
    os.mkfifo(folder / "pipe.json")
    for name in ("folder.json", "loop.json", "pipe.json", "/dev/zero", "x" * 5000 + ".json"):
        assert not done_or_refused("model", "show", name, inside=folder / "out")
