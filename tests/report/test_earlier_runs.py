"""A run folder of an earlier version still opens.

``tests/data/earlier_run`` was written by ``harness sweep cctc_flow --vary
arms.av=soft_yield,gap_yield --pairs 2 --traces --set pedestrians.max_count=3`` before any key of
the scenario was dropped.
"""

import csv
import json
import shutil
from pathlib import Path

import pytest

from tests.batches import printed

EARLIER = Path(__file__).parents[1] / "data" / "earlier_run"


def test_it_opens_in_report_compare_score_and_export(tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(EARLIER, run)
    printed("report", run)
    assert "gap_yield" in (run / "report.html").read_text(encoding="utf-8")
    assert len(json.loads(printed("compare", run, "--json"))["groups"]) == 1
    printed("export", run, "--csv")
    assert (run / "episodes.csv").read_text(encoding="utf-8").count("\n") == 1 + 8
    printed("score", run, "--out", tmp_path / "again")
    for name in ("mu", "kappa", "delay_s"):
        assert column(tmp_path / "again", name) == pytest.approx(column(EARLIER, name), abs=1e-9)


def column(run: Path, name: str) -> list[float]:
    with (run / "summary.csv").open(encoding="utf-8", newline="") as file:
        return [float(row[name]) for row in csv.DictReader(file)]
