"""What the tests of batches share: small studies, an executor without processes, the shell."""

import contextlib
import io
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[1]

HARNESS = [sys.executable, "-m", "harness"]

FLOW = {"experiment.pairs": 12, "experiment.timeout_s": 60.0}
"""Changes to ``cctc_flow`` that make it short."""

QUICK = {
    "arms.av": "constant_speed",
    "arms.human": "constant_speed",
    "ego.initial_speed_mps": 10.0,
    "model.extrapolate": True,
    "ego.trigger_range_m": 10.0,
}
"""Changes that make an episode a matter of 17 steps: 17 m at 10 m/s."""


def wait_for(condition: Callable[[], object], what: str, seconds: float = 300.0) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.002)


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a finished run but the log, which has a clock in it."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != "log.jsonl")
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def options_of(changes: dict[str, object]) -> list[str]:
    """Changes as ``--set`` options."""
    texts = {key: str(of).lower() if isinstance(of, bool) else of for key, of in changes.items()}
    return [part for key, text in texts.items() for part in ("--set", f"{key}={text}")]


@contextlib.contextmanager
def one_process() -> Iterator[None]:
    """Workers' tasks run in this process, which saves starting Python for each worker."""
    from harness.engine.shared import close_engine
    from harness.studies.running import children, run, workers
    from tests.conftest import close_all

    close_all()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workers, "default_workers", lambda: 1)
        for module, name in (
            (workers, "executor_for"),
            (run, "executor_for"),
            (workers, "LocalExecutor"),
        ):
            patch.setattr(module, name, lambda *_: workers.InProcess())
        patch.setattr(children, "start_children", lambda _: None)
        yield
    close_engine()


def here(*arguments: object, cwd: Path | None = None) -> "subprocess.CompletedProcess[str]":
    """Run ``harness`` to its end in this process, its tasks too."""
    from harness.cli import app

    path, out, err = list(sys.path), io.StringIO(), io.StringIO()
    with one_process(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["harness", *map(str, arguments)])
        patch.setenv("MPLBACKEND", "Agg")
        if cwd is not None:
            patch.chdir(cwd)
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            pytest.raises(SystemExit) as ended,
        ):
            app.main()
    sys.path[:] = path
    assert isinstance(ended.value.code, int)
    return subprocess.CompletedProcess([], ended.value.code, out.getvalue(), err.getvalue())


def printed(*arguments: object, cwd: Path | None = None) -> str:
    """What ``harness`` prints of a result, run as by ``here``."""
    done = here(*arguments, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


def refusal(*arguments: object, cwd: Path | None = None) -> str:
    """The one line with which ``harness`` refuses something; it prints nothing else."""
    done = here(*arguments, cwd=cwd)
    assert (done.returncode, done.stdout) == (2, ""), done
    (line,) = done.stderr.splitlines()
    return line


def shell(
    *arguments: object, env: dict[str, str] | None = None, cwd: Path | None = None
) -> "subprocess.CompletedProcess[str]":
    """Run ``harness`` to its end."""
    return subprocess.run(
        [*HARNESS, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, **(env or {})},
        cwd=cwd,
        check=False,
    )


def start(
    *arguments: object, env: dict[str, str] | None = None, cwd: Path | None = None
) -> "subprocess.Popen[str]":
    """Start ``harness`` in a session of its own, so that no signal of a test goes astray."""
    return subprocess.Popen(
        [*HARNESS, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **(env or {})},
        cwd=cwd,
        start_new_session=True,
        preexec_fn=_hear_interruptions,
    )


def _hear_interruptions() -> None:
    """A shell lets its background jobs ignore SIGINT, and so would all that these start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
