"""Scenario files: whatever is in them, they are run or refused in one line."""

import copy
import math
import os
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import assume, example, given, strategies as st

from harness.batch import experiment
from harness.batch.batch import recall_batch
from harness.cli import batch
from harness.network.build import CACHE_VARIABLE
from harness.resources import shipped_directory
from harness.results.reading import read_manifest
from tests.fuzz.command import done_or_refused, in_this_process
from tests.fuzz.hostile import NAMES, VALUES, cases, cut_and_flipped

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


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where the commands are given; networks that are built are kept there too."""
    folder = tmp_path_factory.mktemp("scenarios")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv(CACHE_VARIABLE, str(folder / "networks"))
        in_this_process(patch)
        yield folder


@pytest.fixture
def nothing_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run ends when its folder has a manifest; no episode is run."""
    monkeypatch.setattr(experiment, "_carry_out", lambda *_: None)
    monkeypatch.setattr(batch, "_report", lambda *_: None)


def begun(folder: Path, *words: object) -> None:
    """A run that begins has a manifest by which it could be resumed; else nothing is left."""
    out = folder / "out"
    if done_or_refused(*words, "--out", out, inside=folder):
        recall_batch(read_manifest(out))
    else:
        assert not out.exists()
    shutil.rmtree(out, ignore_errors=True)


COMMANDS = st.sampled_from(
    [("run",), ("run", "--pairs", "2"), ("sweep",), ("sweep", "--vary", "experiment.seed=1,2")]
)


@cases("scenario", 2_500)
@given(cut_and_flipped(CCTC), COMMANDS)
@pytest.mark.usefixtures("nothing_runs")
def test_cut_off_or_changed_bytes(folder: Path, content: bytes, command: tuple[str, ...]) -> None:
    (folder / "hostile.toml").write_bytes(content)
    begun(folder, *command, "hostile.toml")


@cases("scenario", 3_500)
@given(st.sampled_from(KEYS), VALUES, COMMANDS)
@example(("experiment", "pairs"), 10**400, ("run",))
@example(("strategies", "constant_speed"), {"x": {}}, ("run",))
@pytest.mark.usefixtures("nothing_runs")
def test_any_value_at_any_key(
    folder: Path, key: tuple[str, str], value: Any, command: tuple[str, ...]
) -> None:
    tree = copy.deepcopy(TREE)
    tree.setdefault(key[0], {})[key[1]] = value
    (folder / "hostile.toml").write_bytes(written(tree))
    begun(folder, *command, "hostile.toml")


@cases("scenario", 1_500)
@given(st.dictionaries(st.one_of(NAMES, st.sampled_from(list(TREE))), VALUES, max_size=4), COMMANDS)
@pytest.mark.usefixtures("nothing_runs")
def test_any_tables(folder: Path, tree: dict[str, Any], command: tuple[str, ...]) -> None:
    (folder / "hostile.toml").write_bytes(written(tree))
    begun(folder, *command, "hostile.toml")


@cases("scenario", 1_500)
@given(
    st.one_of(NAMES, st.text(max_size=60)),
    st.sampled_from([f"{a}.{b}" for a, b in KEYS]),
    st.sampled_from(["{text}", "{key}={text}", "{text}={text}"]),
    st.sampled_from([("run", "--set"), ("sweep", "--vary")]),
)
@pytest.mark.usefixtures("nothing_runs")
def test_any_option(folder: Path, text: str, key: str, form: str, command: tuple[str, str]) -> None:
    begun(folder, command[0], "cctc", command[1], form.format(text=text, key=key))


@cases("scenario", 500)
@given(NAMES)
@example("../../x")
@pytest.mark.usefixtures("nothing_runs")
def test_any_name_of_the_file(folder: Path, name: str) -> None:
    """It becomes the name of the run's folder, below ``runs`` and nowhere else."""
    path = folder / "named" / f"{name}.toml"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(CCTC)
    except (OSError, ValueError):
        assume(False)
    if done_or_refused("run", path, inside=folder / "runs"):
        (made,) = (folder / "runs").iterdir()
        assert (made / "manifest.json").is_file()
        shutil.rmtree(made)
    path.unlink()


EXTREMES: dict[str, list[Any]] = {
    "crossing.latitude_deg": [-80.0, 84.0, 0.0],
    "crossing.longitude_deg": [-180.0, 180.0],
    "crossing.bearing_deg": [0.0, 359.999999],
    "crossing.length_m": [4.0, 40.0],
    "crossing.width_m": [1.0, 20.0],
    "ego.initial_speed_mps": [5e-324, 0.01, 60.0],
    "ego.trigger_range_m": [3.5, 22.0, 300.0],
    "ego.detection_range_m": [5e-324, 1e308],
    "ego.length_m": [1.0, 25.0],
    "ego.width_m": [0.5, 2.0],
    "ego.max_acceleration_mps2": [5e-324, 20.0],
    "ego.max_deceleration_mps2": [5e-324, 20.0],
    "ego.resume_acceleration_mps2": [5e-324, 20.0],
    "pedestrians.flow_per_hour": [0.0, 5e-324, 100_000.0],
    "pedestrians.max_count": [0, 1, 10**400],
    "pedestrians.near_side_share": [0.0, 5e-324, 1.0],
    "pedestrians.kerb_wait_s": [0.0, 1e308],
    "pedestrians.pairing": ["speed"],
    "pedestrians.behaviour": ["gap_acceptance", "reactive", "sumo"],
    "pedestrians.gap_acceptance.distribution": ["logistic"],
    "pedestrians.gap_acceptance.mean_s": [5e-324, 1e-160, 1e308],
    "pedestrians.gap_acceptance.std_s": [0.0, 5e-324, 1e308],
    "model.pedestrian_reading": ["curve"],
    "arms.av": ["hard_yield", "gap_yield", "emergency_brake", "constant_speed", "sumo_driver"],
    "arms.human": ["sumo_driver", "soft_yield"],
    "experiment.seed": [0, 2**63 - 1],
    "experiment.step_s": [0.02, 1.0],
    "limits.mu0": [5e-324, 1e308],
    "conflicts.ttc_s": [0.0, 1e308],
    "conflicts.drac_mps2": [0.0, 1e308],
}
"""Values a scenario may just have."""


@cases("scenario", 600)
@given(
    st.lists(st.sampled_from(list(EXTREMES)), min_size=1, max_size=5, unique=True),
    st.integers(0, 2**32),
)
def test_what_is_accepted_runs_to_its_end(folder: Path, keys: list[str], which: int) -> None:
    """No extreme hangs, breaks a report, or leaves a run that cannot be read."""
    out = folder / "out"
    settings = []
    for key in keys:
        value = EXTREMES[key][which % len(EXTREMES[key])]
        settings += ["--set", f"{key}={toml(value)}"]
    short = ["--set", "experiment.timeout_s=20", "--pairs", "2", "--out", out]
    # Exit code 1 says that the engine gave an episode up.
    if done_or_refused("run", "cctc_flow", *short, *settings, inside=folder, codes=(0, 1, 2)):
        done_or_refused("export", out, "--csv", inside=out, codes=(0,))
    shutil.rmtree(out, ignore_errors=True)


def deep(nesting: int) -> str:
    return "[" * nesting + "]" * nesting


UNUSUAL = {
    "empty": b"",
    "NUL": b"[experiment]\npairs = 1\x00\n",
    "UTF-16": CCTC.decode().encode("utf-16"),
    "latin-1": "# \u00e9\n".encode("latin-1"),
    "lone surrogate": b'[arms]\nav = "\xed\xa0\x80"\n',
    "escaped surrogate": b'[arms]\nav = "\\ud800"\n',
    "twice": b"[experiment]\npairs = 1\npairs = 2\n",
    "deep list": f"[experiment]\npairs = {deep(5_000)}\n".encode(),
    "rather deep list": f"[experiment]\npairs = {deep(300)}\n".encode(),
    "deep key": f"strategies.a{'.a' * 3_000} = 1\n".encode(),
    "deep table": f"[strategies.soft_yield{'.a' * 900}]\n".encode(),
    "digits": f"[experiment]\nseed = {'9' * 5_000}\n".encode(),
    "hexadecimal digits": f"[experiment]\nseed = 0x{'f' * 5_000}\n".encode(),
    "long float": f"[experiment]\nstep_s = 0.{'1' * 100_000}\n".encode(),
    "date": b"[strategies.soft_yield]\np1 = 2020-01-01\n",
    "not a number": b"[strategies.soft_yield]\np1 = nan\n",
    "model is a device": b'[model]\npath = "/dev/zero"\n',
    "model is a folder": b'[model]\npath = "."\n',
    "many cells": b"[sweep.experiment]\nseed = ['0:99999:1']\npairs = ['1:99999:1']\n",
    "arrivals": b"[pedestrians]\nflow_per_hour = 1e308\n",
    "endless": b"[experiment]\ntimeout_s = 1e300\n",
    "tiny steps": b"[experiment]\nstep_s = 1e-9\n",
}


@pytest.mark.parametrize("name", UNUSUAL)
@pytest.mark.usefixtures("nothing_runs")
def test_unusual_files_are_refused(folder: Path, name: str) -> None:
    (folder / "hostile.toml").write_bytes(UNUSUAL[name])
    begun(folder, "sweep", "hostile.toml", "--vary", "ego.length_m=4,5")
    assert not done_or_refused("sweep", "hostile.toml", "--out", folder / "out", inside=folder)


@pytest.mark.usefixtures("nothing_runs")
def test_a_byte_order_mark_is_no_part_of_the_text(folder: Path) -> None:
    (folder / "bom.toml").write_bytes(b"\xef\xbb\xbf" + CCTC)
    assert done_or_refused("run", "bom.toml", "--out", folder / "out", inside=folder)


@pytest.mark.usefixtures("nothing_runs")
def test_what_is_no_regular_file_is_refused(folder: Path) -> None:
    (folder / "folder.toml").mkdir()
    (folder / "loop.toml").symlink_to("loop.toml")
    (folder / "nowhere.toml").symlink_to("nothing")
    os.mkfifo(folder / "pipe.toml")
    for name in ("folder.toml", "loop.toml", "nowhere.toml", "pipe.toml", "/dev/zero", "x" * 5000):
        assert not done_or_refused("run", name, inside=folder / "runs")
        assert not done_or_refused("run", "cctc", "--set", f"model.path={name}", inside=folder)


@pytest.mark.usefixtures("nothing_runs")
def test_deep_options_are_refused(folder: Path) -> None:
    values = (f"ego.length_m={deep(5_000)}", f"ego.length_m={'[' * 5_000}", f"a{'.a' * 3_000}=1")
    for text in values:
        assert not done_or_refused("run", "cctc", "--set", text, inside=folder)
        assert not done_or_refused("sweep", "cctc", "--vary", text, inside=folder)


def test_what_is_written_here_is_toml() -> None:
    assert tomllib.loads(written(TREE).decode()) == TREE
