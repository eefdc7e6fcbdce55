"""A long run stays as it began: memory, processor time, open files, threads, temporary files.

Only ratios of the second half of a run's pairs to the first are looked at, and processor time held
against that of a fresh SUMO at the same time, so that a busy machine changes nothing.
"""

from pathlib import Path

import pytest

from benchmarks.soak import COMMAND, Soak, soak
from tests.batches import QUICK, options_of

SETTINGS = [text for text in options_of(QUICK) if text != "--set"]

PROCESSES = (COMMAND, "worker 1", "worker 2")


def growth(found: Soak, process: str, field: str) -> float:
    """Second half over first half."""
    first, second = found.middle(process, lambda state: getattr(state, field))
    return second / first


def check(found: Soak) -> None:
    assert (found.exit_code, found.left) == (0, [])
    for process in PROCESSES:
        assert growth(found, process, "memory_mb") < 1.03, process
        assert growth(found, process, "open_files") <= 1, process
        first, second = found.middle(process, lambda state: state.threads)
        # The watchdog's own thread comes and goes.
        assert second - first <= 1, process


@pytest.mark.usefixtures("no_simulation")
def test_a_run_stays_as_it_began(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Processor time is too restless in a run of seconds: the long run looks at it."""
    monkeypatch.setattr("benchmarks.soak._pace", lambda: lambda: 1.0)
    check(soak("cctc", 2_000, 2, SETTINGS, tmp_path / "run", 0.05))


@pytest.mark.slow
@pytest.mark.usefixtures("no_simulation")
def test_a_long_run_stays_as_it_began(tmp_path: Path) -> None:
    found = soak("cctc", 20_000, 2, [], tmp_path / "run", 1.0)
    check(found)
    assert found.slowing() < 1.15


LEAKY = """
import tempfile


class Leaky:
    kept = []

    def __init__(self):
        _, name = tempfile.mkstemp()  # neither closed nor removed
        self.kept.append(bytearray(100_000))

    def decide(self, observation):
        sum(range(6 * len(self.kept) ** 2))
        return 0.0
"""


@pytest.mark.slow
@pytest.mark.usefixtures("no_simulation")
def test_a_leak_is_found_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "leaky.py").write_text(LEAKY, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    settings = [*SETTINGS, "arms.av=leaky:Leaky"]
    found = soak("cctc", 400, 2, settings, tmp_path / "run", 0.1)
    assert found.exit_code == 0
    # One for each pair, and one of the command's, which makes the strategy to check it.
    assert len(found.left) >= 401
    assert found.slowing() > 1.5
    for worker in PROCESSES[1:]:
        assert growth(found, worker, "memory_mb") > 1.03
        assert growth(found, worker, "open_files") > 1.5
    assert growth(found, COMMAND, "open_files") == 1
