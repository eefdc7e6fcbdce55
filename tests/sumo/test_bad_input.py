"""Bad input through the command line: exit code 2, one line, no traceback, nothing half-written.

Most go through ``harness.cli.app.main`` in this process, which is all the console script calls; a
few in a process of their own, to see what a user sees.
"""

import json
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from harness.model.interaction.file import SHIPPED
from harness.scenario import Options, Setting, parse_variation, read_scenario_file, study_of
from harness.studies.batch.experiment import run_study
from tests.batches import here, printed, refusal

Refuse = Callable[..., str]


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


# --- scenario ------------------------------------------------------------------------------------


def test_unknown_key(refused: Refuse, tmp_path: Path) -> None:
    line = refused("run", "cctc", "--set", "pedestrians.flow=3")
    says(line, "pedestrians.flow", "unknown key", "flow_per_hour")
    (tmp_path / "mine.toml").write_text("[ego]\nspeed_mps = 5.0\n")
    says(refused("run", "mine.toml"), "mine.toml", "ego.speed_mps", "unknown key")


def test_wrong_type(refused: Refuse) -> None:
    line = refused("run", "cctc", "--set", "pedestrians.flow_per_hour=many")
    says(line, "pedestrians.flow_per_hour", "'many'", "number")
    says(refused("run", "cctc", "--pairs", "some"), "--pairs", "integer")


@pytest.mark.parametrize(
    ("setting", "parts"),
    [
        ("pedestrians.near_side_share=1.5", ["1.5", "less than or equal to 1"]),
        ("ego.initial_speed_mps=-3", ["-3", "greater than 0"]),
        ("ego.trigger_range_m=2", ["2 m", "3.5 m"]),
        ("experiment.step_s=0.00015", ["0.00015", "0.001"]),
        ("experiment.timeout_s=inf", ["inf", "finite"]),
        ("ego.length_m=" + "9" * 400, ["number"]),
    ],
)
def test_value_out_of_range(refused: Refuse, setting: str, parts: list[str]) -> None:
    says(refused("run", "cctc", "--set", setting), setting.split("=")[0], *parts)


def test_options_are_named_as_the_user_wrote_them(refused: Refuse) -> None:
    says(refused("run", "cctc", "--pairs", 0), "--pairs", "0")
    says(refused("run", "cctc", "--seed", -1), "--seed", "-1")


def test_missing_or_broken_file(refused: Refuse, tmp_path: Path) -> None:
    says(refused("run", "none.toml"), "none.toml", "no such scenario")
    says(refused("run", "ccct"), "did you mean 'cctc'")
    says(refused("run", tmp_path), "is a folder")
    says(refused("run", "x" * 300), "xxx")  # longer than a file's name can be
    (tmp_path / "broken.toml").write_text("[ego\nlength")
    says(refused("run", "broken.toml"), "broken.toml", "not a TOML file")


# --- strategies ----------------------------------------------------------------------------------


def test_unknown_strategy(refused: Refuse) -> None:
    line = refused("run", "cctc", "--set", "arms.av=soft_yeild")
    says(line, "arms.av", "'soft_yeild'", "did you mean 'soft_yield'")
    line = refused("run", "cctc", "--set", "strategies.nobody.x=1")
    says(line, "--set strategies.nobody.x", "drives in no cell", "soft_yield or human_gmm")


@pytest.mark.parametrize(
    ("setting", "parts"),
    [
        ("strategies.soft_yield.p4=1", ["strategies.soft_yield.p4", "unknown parameter"]),
        ("strategies.soft_yield.p1=fast", ["strategies.soft_yield.p1", "'fast'", "number"]),
        ("strategies.soft_yield.p1=true", ["strategies.soft_yield.p1", "True", "number"]),
        ("strategies.soft_yield.p1=inf", ["strategies.soft_yield.p1", "inf"]),
        ("strategies.soft_yield.p1=" + "9" * 400, ["strategies.soft_yield.p1"]),
        ("strategies.constant_speed.gap=1", ["strategies.constant_speed.gap", "drives in no"]),
        ("strategies.human_gmm.reading=both", ["'both'", "'marginal'", "given_time_advantage"]),
        ("strategies.human_gmm.decision_interval_s=-1", ["decision_interval_s", "-1"]),
        ("strategies.human_gmm.decision_interval_s=0.25", ["decision_interval_s", "0.25"]),
        ("strategies.human_gmm.model=x", ["strategies.human_gmm.model"]),
    ],
)
def test_wrong_strategy_parameter(refused: Refuse, setting: str, parts: list[str]) -> None:
    says(refused("run", "cctc", "--pairs", 2, "--set", setting), *parts)


# --- model ---------------------------------------------------------------------------------------


def shipped_model() -> dict[str, Any]:
    file = sorted(SHIPPED.glob("*.json"))[0]
    document: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return document


def without(key: str) -> Callable[[dict[str, Any]], object]:
    return lambda model: model.pop(key)


def put(key: str, value: object) -> Callable[[dict[str, Any]], object]:
    return lambda model: model.update({key: value})


def matrix(*entries: float) -> Callable[[dict[str, Any]], object]:
    """The first scale matrix becomes diagonal, with its first rows as given."""

    def change(model: dict[str, Any]) -> None:
        diagonal = [*entries, 1.0, 1.0, 1.0, 1.0][:4]
        model["scale_matrices"][0] = [
            [value if i == j else 0.0 for j in range(4)] for i, value in enumerate(diagonal)
        ]

    return change


def asymmetric(model: dict[str, Any]) -> None:
    model["scale_matrices"][0][0][1] += 0.01


BROKEN_MODELS: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "no weights": (without("weights"), "weights"),
    "no schema": (without("schema"), "schema"),
    "no bounds": (without("upper"), "upper"),
    "another schema": (put("schema", 99), "99"),
    "unknown key": (put("wieghts", []), "wieghts"),
    "other variables": (put("variables", ["a", "b", "c", "d"]), "variables"),
    "weights do not sum": (lambda m: m["weights"].__setitem__(0, 0.9), "weights"),
    "a negative weight": (put("weights", [-0.5, 1.5] + [0.0] * 8), "weights"),
    "no components": (lambda m: m.update(weights=[], locations=[], scale_matrices=[]), ""),
    "one location less": (lambda m: m["locations"].pop(), "shape"),
    "three variables": (lambda m: [row.pop() for row in m["locations"]], "shape"),
    "ragged": (lambda m: m["locations"][0].pop(), "locations"),
    "text for a number": (lambda m: m["locations"][0].__setitem__(0, "x"), "locations"),
    "not a number": (lambda m: m["locations"][0].__setitem__(0, float("nan")), "not a JSON"),
    "not positive definite": (matrix(-1.0), "scale"),
    "singular": (matrix(0.0), "scale"),
    "asymmetric": (asymmetric, "scale"),
    "an empty box": (lambda m: m["upper"].__setitem__(1, 0.1), "upper"),
    "an infinite box": (lambda m: m["upper"].__setitem__(1, float("inf")), "not a JSON"),
    "no positive floor": (lambda m: m["lower"].__setitem__(2, 0.0), "lower"),
}


@pytest.mark.parametrize("name", BROKEN_MODELS)
def test_broken_model(refused: Refuse, tmp_path: Path, name: str) -> None:
    change, part = BROKEN_MODELS[name]
    model = shipped_model()
    change(model)
    (tmp_path / "model.json").write_text(json.dumps(model))
    line = refused("run", "cctc", "--pairs", 2, "--set", "model.path=model.json")
    says(line, "model.json", part)


def test_model_file_that_is_none(refused: Refuse, tmp_path: Path) -> None:
    for content in (b"{", b"[]", b"", b"\xff\xfe", b"[" * 100_000):
        (tmp_path / "model.json").write_bytes(content)
        line = refused("run", "cctc", "--set", "model.path=model.json")
        says(line, "model.json", "model.json: not a JSON" if content != b"[]" else "not accepted")
    says(refused("run", "cctc", "--set", "model.path=none.json"), "none.json", "cannot be read")
    says(refused("run", "cctc", "--set", "model.path=."), "cannot be read")
    says(refused("run", "cctc", "--set", "model.name=best"), "model.name", "'best'")


# --- folders -------------------------------------------------------------------------------------


def test_out_that_is_no_folder(refused: Refuse, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    says(refused("run", "cctc", "--pairs", 1, "--out", "file"), "--out", "file", "is a file")
    (tmp_path / "loop").symlink_to("loop")
    # Not even root can make a folder under a file, or under a link that leads to itself.
    says(refused("run", "cctc", "--pairs", 1, "--out", "file/run"), "--out", "cannot be written")
    says(refused("run", "cctc", "--pairs", 1, "--out", "loop/run"), "--out", "cannot be written")
    says(refused("run", "cctc", "--pairs", 1, "--out", "x" * 300), "--out")


def test_a_folder_that_holds_a_run(refused: Refuse, tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "manifest.json").write_text("{}")
    (folder / "episodes.parquet").write_bytes(b"kept")
    says(refused("run", "cctc", "--pairs", 1, "--out", folder), "--out", "already holds a run")


def test_a_bad_scenario_does_not_even_make_the_folder(refused: Refuse, tmp_path: Path) -> None:
    refused("run", "cctc", "--set", "arms.av=nobody", "--out", "new/one")
    assert not (tmp_path / "new").exists()


def test_export_of_what_is_no_run(refused: Refuse, tmp_path: Path) -> None:
    says(refused("export", tmp_path, "--csv"), "is not a run folder")
    says(refused("export", "nowhere", "--csv"), "nowhere")
    says(refused("export", "x" * 300, "--csv"), "xxx")
    says(refused("export", tmp_path), "--csv")


def test_export_of_a_damaged_run(refused: Refuse, tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text("{}")
    says(refused("export", tmp_path, "--csv"), "manifest.json", "format version None")


def test_a_run_that_was_broken_off(
    refused: Refuse, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    class BrokenOffError(Exception):
        pass

    def interrupt(*_: object) -> None:
        raise BrokenOffError

    monkeypatch.chdir(tmp_path)
    file = read_scenario_file("cctc", [Setting("experiment.pairs", 3)])
    study = study_of(file, [parse_variation("arms.av=constant_speed,hard_yield")])
    with pytest.raises(BrokenOffError):
        run_study(
            study, Options(traces=True, workers=1), out=Path("broken off"), progress=interrupt
        )
    before = sorted(tmp_path.rglob("*"))
    for command in (
        ["score", "broken off", "--out", "new"],
        ["replay", "broken off", "--pair", "0", "--out", "new"],
        ["compare", "broken off"],
        ["export", "broken off", "--csv"],
    ):
        says(refused(*command), "broken off", "is not finished", "harness resume 'broken off'")
        assert sorted(tmp_path.rglob("*")) == before


def test_network_into_a_file(refused: Refuse, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    says(refused("network", "cctc", "--out", "file"), "file")
    says(refused("network", "cctc", "--out", "file/net-of-mine"), "file/net-of-mine")


# --- the command line itself ---------------------------------------------------------------------


@pytest.mark.parametrize("group", [[], ["model"]])
def test_a_command_with_commands_of_its_own_alone_says_its_help(group: list[str]) -> None:
    done = here(*group)
    assert (done.returncode, done.stdout) == (2, "")
    lines = [line.strip() for line in done.stderr.splitlines()]
    assert "Commands:" in lines
    assert lines[0].endswith("[OPTIONS] COMMAND [ARGS]...")


def test_version() -> None:
    assert printed("--version") == version("crosswalk-harness") + "\n"


def test_unknown_options_and_commands(refused: Refuse) -> None:
    says(refused("run", "cctc", "--colour"), "--colour")
    says(refused("rum", "cctc"), "rum")
    says(refused("run").lower(), "scenario", "missing")
    says(refused("run", "cctc", "--set", "x"), "--set x", "not of the form key=value")
    says(refused("run", "cctc", "extra"), "extra")
    says(
        refused("run", "cctc", "--engine", "plan"),
        "'--engine': 'plan' is not one of 'sumo', 'plain'",
    )
    says(refused("replay", "run", "--pair", 0, "--arm", "mine"), "'mine'", "'av', 'human', 'both'")
    says(refused("network", "cctc"), "--out")


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "cctc", "--pairs", "2", "--set", "arms.av=nobody"],
        ["run", "cctc", "--pairs", "2", "--out", "../file/run", "--quiet"],
        ["run", "cctc", "--set", "ego.lenght_m=3", "--json"],
        ["rum"],
    ],
)
def test_in_a_process_of_its_own(arguments: list[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    here = tmp_path / "here"
    here.mkdir()
    result = subprocess.run(
        [sys.executable, "-m", "harness", *arguments],
        cwd=here,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert result.returncode == 2
    assert result.stdout == ""
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert result.stderr.startswith("harness: ")
    assert list(here.iterdir()) == []
    assert (tmp_path / "file").read_text() == "kept"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--gui", "--debug"), ("--debug: cannot be combined with --gui", "breakpoint()")),
        (("--gui", "--out", "x"), ("--out: cannot be combined with --gui", "--screenshots")),
        (("--debug", "--out", "x"), ("--out: cannot be combined with --debug",)),
        (("--pace", "2"), ("--pace: needs --gui",)),
        (("--gui", "--every", "1"), ("--every: needs --screenshots",)),
    ],
)
def test_no_option_of_a_replay_is_ignored(
    refused: Refuse, options: tuple[str, ...], words: tuple[str, ...]
) -> None:
    says(refused("replay", "run", "--pair", "0", *options), *words)


def test_options_of_a_check_are_not_ignored_without_one(refused: Refuse) -> None:
    says(refused("strategies", "--set", "ego.lane=0"), "--set: needs --check")
    says(refused("strategies", "--scenario", "cctc_flow"), "--scenario: needs --check")
