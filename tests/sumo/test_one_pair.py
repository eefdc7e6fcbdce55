"""One pair in this process: the run's own records, classes of a notebook, a debugger."""

import pdb
import sys
import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from harness.old.store.episode_tables import episode_rows

import harness
from harness.core.encounter import Ending
from harness.core.errors import InputError
from harness.scenario import Options
from tests.batches import one_cell, run_inline
from tests.notebooks import as_main, run_cell, run_notebook

EXAMPLE = Path(__file__).parents[2] / "examples" / "compare_strategies.ipynb"

pytestmark = pytest.mark.usefixtures("no_simulation")


def test_the_records_are_those_of_a_run(tmp_path: Path) -> None:
    run = run_inline(one_cell("cctc_flow", {"experiment.pairs": 4}), tmp_path / "run")
    settings = {"experiment.pairs": 4}
    found = harness.run_pair("cctc_flow", 3, settings=settings)
    rows = episode_rows(0, [found.av.outcome, found.human.outcome]).to_pydict()
    stored = run.rows_of("episodes", 0, 3).to_pydict()
    assert rows == stored
    plain = harness.run_pair("cctc_flow", 3, settings=settings, engine="plain")
    one, other = found.av.record, plain.av.record
    assert (one.ending, one.contact) == (other.ending, other.contact)
    for value, of_plain in zip(one.values, other.values, strict=True):
        assert value == of_plain or value == pytest.approx(of_plain, rel=1e-6, abs=1e-6)
    assert found.tau == pytest.approx(rows["pass_time_s"][0] / rows["pass_time_s"][1])


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
            assert found.av.outcome.strategy == "__main__:Mine"
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

        def readline(self, *of: Any) -> str:
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
        assert found.av.record.ending is not Ending.ENGINE_FAILED
        assert "30.0" in said.getvalue()
        # In a whole run of this process, too.
        study = harness.study_of(harness.read_scenario_file("cctc", settings))
        run = harness.run_study(study, Options(engine="plain"), out=tmp_path / "run")
        assert run.failures == ()
        assert said.getvalue().count("30.0") == 2


def test_what_a_notebook_and_a_debugger_show() -> None:
    found = harness.run_pair("cctc", 2, settings={"arms.av": "hard_yield"}, engine="plain")
    shown = ET.fromstring(found._repr_html_())
    assert [cell.text for cell in shown.findall("./thead/tr/th")][1:] == ["av", "human"]
    assert {*found.traces["arm"]} == {"av", "human"}
    # What a debugger shows is a line.
    assert repr(found.av) == "<EpisodeOutcome pair 2, av: crossed>"
    assert repr(found).startswith("<PairOutcome pair 2: τ = 1.")
    assert len(repr(found)) < 200


def test_a_strategy_that_raises_says_where() -> None:
    with as_main() as names:
        run_cell("class Bad:\n    def decide(self, observation):\n        return 1 / 0\n", names)
        settings = {"arms.av": names["Bad"]}
        shown = harness.run_pair("cctc", settings=settings, engine="plain")._repr_html_()
    assert "ZeroDivisionError" in shown
    ET.fromstring(f"<div>{shown}</div>")


def test_refused() -> None:
    for arguments, said in (
        (("cctc", -1), "pair: -1; allowed: 0 or more"),
        (("traffic", 0), r"has a \[traffic\] table"),
        (("cctcc", 0), "did you mean 'cctc"),
    ):
        with pytest.raises(InputError, match=said):
            harness.run_pair(*arguments)
    with pytest.raises(InputError, match="unknown engine 'plan'; allowed: plain, sumo"):
        harness.run_pair("cctc", engine="plan")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no run"):
        harness.compare()


def test_the_example_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    values = [value for value in run_notebook(EXAMPLE) if value is not None]
    pair, run, comparison = (
        next(value for value in values if isinstance(value, kind))
        for kind in (harness.PairOutcome, harness.RunData, harness.RunComparison)
    )
    for shown in (pair, run, comparison):
        ET.fromstring(f"<div>{shown._repr_html_()}</div>")
    (group,) = comparison.groups
    assert [member.strategy for member in group.group.cells] == ["__main__:Early", "hard_yield"]
    interval = group.comparisons[0].mu_difference
    assert interval.low < interval.value < interval.high
