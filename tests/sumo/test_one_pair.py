"""One pair in this process: the run's own records, classes of a notebook, a debugger."""

import pdb
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import harness
from harness.core.vocabulary import Ending
from tests.notebooks import as_main, run_cell, run_notebook

EXAMPLE = Path(__file__).parents[2] / "examples" / "compare_strategies.ipynb"

pytestmark = pytest.mark.usefixtures("no_simulation")


CELL = """
class Mine:
    def __init__(self, *, wanted: float = {wanted}):
        self.wanted = wanted
    def decide(self, observation):
        return self.wanted
"""


def test_a_class_of_a_cell_and_the_same_cell_run_again() -> None:
    with as_main() as names:
        ends = []
        for wanted in (0.0, 1.0):
            run_cell(CELL.format(wanted=wanted), names)
            settings = {"arms.av": names["Mine"]}
            found = harness.run_pair("cctc", 2, settings=settings, engine="plain")
            assert found.av.strategy == "__main__:Mine"
            ends.append(float(found.av.trace.speed_mps[-1]))
        # The new class drives, not the one of the first time.
        assert ends[0] == pytest.approx(5.0)
        assert ends[1] > 6.0


STOPPING = """
import sys, pdb
class Mine:
    def decide(self, observation):
        if not observation.time_s:
            breakpoint()
        return 0.0
"""


def test_a_debugger_stops_in_decide_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    import io
    import time

    said = io.StringIO()

    class Slow(io.StringIO):
        """Someone who thinks for longer than a strategy may."""

        def readline(self, *of: Any) -> Any:
            time.sleep(0.35)
            return super().readline(*of)

    def stop() -> None:
        debugger = pdb.Pdb(stdin=Slow("p observation.ego.range_m\nc\n"), stdout=said, nosigint=True)
        debugger.use_rawinput = False
        debugger.set_trace(sys._getframe().f_back)

    # "c" ends all tracing, that of a coverage run too.
    request.addfinalizer(partial(sys.settrace, sys.gettrace()))
    monkeypatch.setattr("sys.breakpointhook", stop)
    with as_main() as names:
        run_cell(STOPPING, names)
        settings = {"experiment.decide_limit_s": 0.1, "experiment.pairs": 1}
        settings["arms.av"] = names["Mine"]
        found = harness.run_pair("cctc", 0, settings=settings, engine="plain")
        assert found.av.record.ending is not Ending.FAILED
        assert "30.0" in said.getvalue()
        # In a whole run of this process, too.
        out = tmp_path / "run"
        run = harness.run("cctc", settings=settings, engine="plain", out=out)
        assert run.failures == ()
        assert said.getvalue().count("30.0") == 2


def test_the_example_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    values = [value for value in run_notebook(EXAMPLE) if value is not None]
    pair = next(value for value in values if isinstance(value, harness.PairOutcome))
    assert pair.pair == 17
    compared = next(of for of in values if "mu_difference" in getattr(of, "columns", ()))
    (row,) = compared.to_dict("records")
    assert (row["a"], row["b"]) == ("__main__:Early", "hard_yield")
    assert row["mu_difference_ci_low"] < row["mu_difference"] < row["mu_difference_ci_high"]
