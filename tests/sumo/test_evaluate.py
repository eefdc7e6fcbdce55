"""Candidates on the same people: the numbers of their runs, with kept references and workers."""

from pathlib import Path
from typing import Any

import pytest

from harness.engine.plain import PlainEngine
from harness.studies.evaluate import evaluate
from harness.studies.running.run import run
from tests.scenes import refuses

SETTINGS = {"arms.av": "gap_yield"}
GAP = "strategies.gap_yield.critical_gap_s"


def test_the_numbers_are_those_of_a_run(tmp_path: Path) -> None:
    frame = evaluate("cctc_flow", [{GAP: 1.0}, {GAP: 3.0}], 12, settings=SETTINGS)
    for row, gap in enumerate((1.0, 3.0)):
        out = tmp_path / str(gap)
        stored = run("cctc_flow", settings={**SETTINGS, GAP: gap}, pairs=12, out=out, workers=0)
        for key in ("time_s", "time_ratio", "kappa", "delay_s"):
            value = stored.cells[0][key].value
            known = float("nan") if value is None else value
            assert frame[key][row] == pytest.approx(known, nan_ok=True)
    assert frame[GAP].tolist() == [1.0, 3.0]


def test_the_reference_is_driven_once(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, begin = [], PlainEngine.begin

    def counted(self: PlainEngine, people: Any) -> tuple[float, float]:
        begun.append(people)
        return begin(self, people)

    monkeypatch.setattr(PlainEngine, "begin", counted)
    for gap in (1.0, 2.0):
        own = {**SETTINGS, GAP: gap, "experiment.seed": 4}
        evaluate("cctc_flow", [{}], 4, settings=own, engine="plain", workers=0)
    assert len(begun) == 3 * 4
    evaluate("cctc_flow", [{}], 4, settings={"experiment.seed": 5}, engine="plain", workers=0)
    assert len(begun) == 5 * 4


@pytest.mark.parametrize(
    ("candidates", "line"),
    [
        ([], "candidates"),
        ([{}, {"ego.colour": 1}], r"candidates\[1\]"),
        ([{"experiment.seed": 3}], r"candidates\[0\].*other people"),
        ([{}, {"arms.av": "nobody"}], r"candidates\[1\].*unknown strategy"),
    ],
)
def test_a_refused_candidate_is_named(candidates: Any, line: str) -> None:
    refuses(line, lambda: evaluate("cctc_flow", candidates, 2, engine="plain", workers=0))
