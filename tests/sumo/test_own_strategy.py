"""A user's own strategy through the console script, whose folder is not the working directory."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from harness.studies.running.run import resume, run
from tests.batches import CHECKOUT, QUICK, printed, shell
from tests.scenes import refuses


def harness(*arguments: object, cwd: Path) -> "subprocess.CompletedProcess[str]":
    command = [str(Path(sysconfig.get_path("scripts")) / "harness"), *map(str, arguments)]
    env = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, timeout=300)


def test_the_template_runs_as_its_page_says(tmp_path: Path) -> None:
    shutil.copy(CHECKOUT / "examples" / "my_strategy.py", tmp_path)
    own = ("--set", "arms.av=my_strategy:MyStrategy", "--out", "run", "--quiet")
    done = harness("run", "cctc", "--pairs", 3, *own, cwd=tmp_path)
    assert (done.returncode, done.stdout.strip()) == (0, "run"), done.stderr
    printed("replay", "run", "--pair", 1, "--out", "again", cwd=tmp_path)


STEADY = """
from command_of_steady import COMMAND_MPS2
class Steady:
    def decide(self, observation):
        return COMMAND_MPS2
"""


@pytest.mark.usefixtures("no_simulation")
def test_a_run_is_not_resumed_with_another_strategy_of_that_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor if a module has changed that the strategy's imports."""
    (tmp_path / "steady_or_not.py").write_text(STEADY, encoding="utf-8")
    helper = tmp_path / "command_of_steady.py"
    helper.write_text("COMMAND_MPS2 = 0.0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    name, out = "steady_or_not:Steady", tmp_path / "run"
    made = run("cctc", settings={**QUICK, "arms.av": name}, pairs=1, workers=0, out=out)
    assert len(made.manifest["simulated_with"]["strategies"][name]) == 64
    helper.write_text("COMMAND_MPS2 = 0.25\n", encoding="utf-8")
    # One that is finished is only read.
    assert len(resume(out, workers=0).pairs) == 1
    (out / "findings.json").unlink()
    # Nothing is left to simulate: the findings are computed from its rows.
    assert resume(out, workers=0).finished
    # A process imports a module once: only a new one drives as the file now says.
    again = shell("replay", "run", "--pair", 0, "--debug", "--arm", "av", cwd=tmp_path)
    assert again.returncode == 1
    edited = f"the strategy {name} has been edited since the run"
    assert edited in " ".join(again.stdout.split()), again
    (out / "findings.json").unlink()
    next((out / "episodes").iterdir()).unlink()
    refuses(f"run: the strategy {name} has been edited", lambda: resume(out, workers=0))


def test_to_look_at_a_run_imports_no_strategy_that_its_manifest_names(tmp_path: Path) -> None:
    module, out = "named_in_a_manifest", tmp_path / "run"
    (tmp_path / f"{module}.py").write_text("class S:\n    def decide(self, _): return 0.0\n")
    sweep = ("--vary", f"arms.av=soft_yield,{module}:S", "--pairs", 2, "--out", "run")
    printed("run", "cctc_flow", *sweep, cwd=tmp_path)
    script = (
        "import sys; from harness import compare, load_run; run = load_run(sys.argv[1])\n"
        "compare(run); run.pairs; run.result(); print(sys.argv[2] in sys.modules)"
    )
    command = [sys.executable, "-c", script, str(out), module]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.stdout == "False\n", done.stderr
