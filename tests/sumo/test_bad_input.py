"""Bad input through the command line: exit code 2, one line, no traceback, nothing half-written.

Most go through ``harness.cli.app.main`` in this process, which is all that the console script
calls; a few in a process of their own, to see what a user sees.
"""

import json
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from harness.model.interaction import SHIPPED
from tests.batches import here, refusal, shell

Refuse = Callable[..., str]
Change = Callable[[dict[str, Any]], object]


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Refuse:
    """Runs the command line in an empty folder; returns the one line it was refused with."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> str:
        kept = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
        folders = {path for path in tmp_path.rglob("*") if path.is_dir()}
        line = refusal(*arguments)
        assert line.startswith("harness: ")
        # Nothing new, nothing changed, nothing half-written.
        assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == kept
        assert {path for path in tmp_path.rglob("*") if path.is_dir()} == folders
        return line

    return run


def says(line: str, *parts: str) -> None:
    for part in parts:
        assert part in line, line


REPLAY = "replay run --pair 0"
LONG = "x" * 300
"""A name longer than a file's may be."""

TWO_OF_THREE = ("--gui --debug", "--gui --out x", "--debug --out x")

REFUSED = [
    # Keys and values of a scenario: tests/unit/test_bad_scenarios.py has them all.
    ("run cctc --set pedestrians.flow=3", "--set pedestrians.flow", "unknown key", "flow_per_hour"),
    ("run mine.toml", "mine.toml", "ego.speed_mps", "unknown key"),
    # Options are named as the user wrote them.
    ("run cctc --pairs 0", "--pairs experiment.pairs: 0 is"),
    ("run cctc --vary ego.speed=1", "--vary ego.speed: unknown key"),
    ("run traffic --traces", "--traces: is not supported"),
    ("strategies --check nobody", "--check: unknown strategy"),
    ("run none.toml", "none.toml", "No such file"),
    ("run ccct", "did you mean 'cctc'"),
    (f"run {LONG}", "xxx"),
    # Files and folders.
    ("run cctc --set model.path=none.json", "none.json", "cannot be read"),
    ("run cctc --pairs 1 --out file", "--out", "file", "is a file"),
    # Not even root can make a folder under a file.
    ("run cctc --pairs 1 --out file/run", "--out", "cannot be written"),
    ("run cctc --pairs 1 --out mine", "--out", "already holds a run"),
    # A bad scenario does not even make the folder.
    ("run cctc --set arms.av=nobody --out new/one", "nobody"),
    *((f"{word} mine", "manifest.json", "as the run wrote it") for word in ("worst", "run")),
    ("network cctc --out file/net-of-mine", "file/net-of-mine"),
    # The command line itself.
    ("run", "Missing", "'scenario'"),
    ("run cctc --engine plan", "'--engine': 'plan' is not one of 'sumo', 'plain'"),
    ("replay run --pair 0 --arm mine", "'mine'", "'av', 'human', 'both'"),
    # No option of a replay or of a check is ignored.
    *((f"{REPLAY} {two}", "cannot be combined", "one of the three") for two in TWO_OF_THREE),
    (REPLAY, "--out, --gui, --debug", "one is missing"),
    ("replay run --pair 3-1 --debug", "--pair 3-1", "e.g. 7 or 1-20"),
    ("run cctc --dask a:1 --workers 2", "--workers", "--dask", "one of the two"),
    ("compare nowhere", "nowhere", "is not a run folder"),
]


@pytest.mark.parametrize("case", REFUSED, ids=lambda case: case[0][:60])
def test_refused(refused: Refuse, tmp_path: Path, case: tuple[str, ...]) -> None:
    (tmp_path / "mine.toml").write_text("[ego]\nspeed_mps = 5.0\n")
    (tmp_path / "file").write_text("kept")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "manifest.json").write_text("{}")
    (tmp_path / "mine" / "episodes.parquet").write_bytes(b"kept")
    says(refused(*case[0].split()), *case[1:])


def put(*place: Any) -> Change:
    """Puts the last of these where the others lead."""
    *path, last, value = place

    def change(model: Any) -> None:
        for key in path:
            model = model[key]
        model[last] = value

    return change


NO_JSON = "model.json: not a JSON"
BROKEN_MODELS: list[tuple[Change | bytes, str]] = [
    *((lambda m, key=key: m.pop(key), key) for key in ("weights", "schema", "upper")),
    (put("schema", 99), "99"),
    (put("wieghts", []), "wieghts"),
    (put("variables", ["a", "b", "c", "d"]), "variables"),
    (lambda m: m.update(weights=[], locations=[], scale_matrices=[]), ""),
    # What else is wrong with numbers: tests/unit/test_mixture_distribution.py.
    (put("weights", 0, 0.9), "weights"),
    (lambda m: [row.pop() for row in m["locations"]], "shape"),
    (lambda m: m["locations"][0].pop(), "locations"),
    (put("locations", 0, 0, "x"), "locations"),
    (put("locations", 0, 0, float("nan")), NO_JSON),
    (put("upper", 1, float("inf")), NO_JSON),
    (put("lower", 2, 0.0), "lower"),
    *((content, NO_JSON) for content in (b"{", b"", b"\xff\xfe", b"[" * 100_000)),
    (b"[]", "not accepted"),
]


@pytest.mark.parametrize(("change", "part"), BROKEN_MODELS, ids=range(len(BROKEN_MODELS)))
def test_broken_model(refused: Refuse, tmp_path: Path, change: Change | bytes, part: str) -> None:
    model = json.loads(min(SHIPPED.glob("*.json")).read_text(encoding="utf-8"))
    if not isinstance(change, bytes):
        change(model)
        change = json.dumps(model).encode()
    (tmp_path / "model.json").write_bytes(change)
    line = refused("run", "cctc", "--pairs", 2, "--set", "model.path=model.json")
    says(line, "model.json", part)


def test_alone_it_says_its_help_and_its_version() -> None:
    done = here()
    assert (done.returncode, done.stdout) == (2, "")
    lines = [line.strip() for line in done.stderr.splitlines()]
    assert "Commands:" in lines
    assert lines[0].endswith("[OPTIONS] COMMAND [ARGS]...")
    assert shell("--version").stdout == version("crosswalk-harness") + "\n"
