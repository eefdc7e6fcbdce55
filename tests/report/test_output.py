"""What reaches stdout: with --json one document, with --quiet paths, and nothing else."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest

from harness.old.cli import app as cli
from harness.old.cli.app import COMMANDS
from harness.old.report.screens.console import make_console, print_table
from harness.old.report.screens.tables import Table, TableCell
from tests.batches import one_process

# How each command is called here; RUN and SWEEP are finished runs, NEW what is not there yet.
CALLS = {
    "run": ["cctc", "--pairs", "2", "--workers", "1", "--out", "NEW"],
    "sweep": [
        *("cctc", "--vary", "arms.av=constant_speed,hard_yield", "--pairs", "2", "--workers", "1")
    ],
    "resume": ["RUN"],
    "report": ["RUN", "--out", "NEW.html"],
    "replay": ["RUN", "--pair", "3", "--arm", "av", "--out", "NEW"],
    "worst": ["RUN", "-n", "2"],
    "compare": ["SWEEP", "--out", "NEW.csv"],
    "export": ["COPY", "--csv"],
    "network": ["cctc", "--out", "NEW"],
    "strategies": [],
    "doctor": [],
}
ELSEWHERE = {"conflicts", "crossings", "extract", "fit", "validate", "risk", "worst"}
"""Covered by tests of their own."""


def test_every_command_is_called() -> None:
    names = {command.__name__ for command in COMMANDS}
    assert set(CALLS) | ELSEWHERE == names | {"sweep"}, "run's other name"


@pytest.fixture
def words(
    single: Path, swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], list[str]]:
    """Words of a call in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("harness.old.report.pages.encounter_parts.pictures_of", lambda *_: iter(()))
    shutil.copytree(single, tmp_path / "copy")
    meaning = {"RUN": str(single), "SWEEP": str(swept), "COPY": "copy"}
    return lambda name: [
        name,
        *(meaning.get(word, word.replace("NEW", "new")) for word in CALLS[name]),
    ]


def output(monkeypatch: pytest.MonkeyPatch, arguments: list[str]) -> str:
    """Everything that reaches file descriptor 1, SUMO's own words included."""
    monkeypatch.setattr(sys, "argv", ["harness", *arguments])
    before = os.dup(1)
    with tempfile.TemporaryFile() as file:
        stdout = os.fdopen(os.dup(file.fileno()), "w", encoding="utf-8")
        monkeypatch.setattr(sys, "stdout", stdout)
        os.dup2(file.fileno(), 1)
        # A run has workers; what they print is here no less.
        workers = nullcontext() if arguments[0] == "run" else one_process()
        try:
            with workers, pytest.raises(SystemExit) as caught:
                cli.main()
        finally:
            os.dup2(before, 1)
            os.close(before)
            stdout.close()
        assert caught.value.code == 0
        file.seek(0)
        return file.read().decode()


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.usefixtures("no_simulation")
def test_json_is_all_there_is(
    name: str, words: Callable[[str], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert json.loads(output(monkeypatch, [*words(name), "--json"]))


@pytest.mark.parametrize("name", sorted(CALLS.keys() - {"strategies", "doctor", "worst"}))
@pytest.mark.usefixtures("no_simulation")
def test_quiet_prints_paths_of_what_was_written(
    name: str, words: Callable[[str], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = output(monkeypatch, [*words(name), "--quiet"]).splitlines()
    assert lines
    assert [line for line in lines if not Path(line).exists()] == []


def test_no_color_is_respected_on_a_terminal() -> None:
    """One console as it is, then one with NO_COLOR, in a terminal that would show colours."""
    code = (
        "import os\n"
        "from harness.old.report.screens.console import make_console\n"
        "make_console().print('words', style='red')\n"
        "os.environ['NO_COLOR'] = '1'\n"
        "make_console().print('more', style='red')\n"
    )
    script = f"import pty, sys; sys.exit(pty.spawn([sys.executable, '-c', {code!r}]) != 0)"
    environment = {key: value for key, value in os.environ.items() if key != "NO_COLOR"}
    shown = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        env={**environment, "TERM": "xterm-256color"},
        stdin=subprocess.DEVNULL,
        check=True,
    )
    assert shown.stdout.split() == ["\x1b[31mwords\x1b[0m", "more"]


@pytest.mark.parametrize(("columns", "width"), [("72", 72), ("0", 120), ("wide", 120), (None, 120)])
def test_a_pipe_is_as_wide_as_columns_says(
    monkeypatch: pytest.MonkeyPatch, columns: str | None, width: int
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns is not None:
        monkeypatch.setenv("COLUMNS", columns)
    assert make_console().width == width


def test_brackets_in_names_and_values_are_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    rows = ((TableCell("[/x]"),), (TableCell("[red]a"),))
    print_table(make_console(), Table("cases", "cases [b]", ("[/case]",), rows))
    make_console().print("study [i]")
    shown = capsys.readouterr().out
    for text in ("cases [b]", "[/case]", "[/x]", "[red]a", "study [i]"):
        assert text in shown
