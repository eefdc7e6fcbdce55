"""A run folder of an earlier version still opens.

``tests/data/earlier_run`` was written by ``harness sweep cctc_flow --vary
arms.av=soft_yield,gap_yield --pairs 2 --traces --set pedestrians.max_count=3`` before any key of
the scenario was dropped.
"""

import csv
import json
import shutil
import sys
from pathlib import Path

import pytest

from harness.cli import app as cli

EARLIER = Path(__file__).parents[1] / "data" / "earlier_run"


def done(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", ["harness", *arguments])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    assert caught.value.code == 0


def test_it_opens_in_report_compare_score_and_export(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(EARLIER, tmp_path / "run")
    monkeypatch.chdir(tmp_path)
    done(monkeypatch, "report", "run")
    assert "gap_yield" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    capsys.readouterr()
    done(monkeypatch, "compare", "run", "--json")
    assert len(json.loads(capsys.readouterr().out)["groups"]) == 1
    done(monkeypatch, "export", "run", "--csv")
    assert (tmp_path / "run" / "episodes.csv").read_text(encoding="utf-8").count("\n") == 1 + 8
    done(monkeypatch, "score", "run", "--out", "again")
    for name in ("mu", "kappa", "delay_s"):
        assert column(tmp_path / "again", name) == pytest.approx(column(EARLIER, name), abs=1e-9)


def column(run: Path, name: str) -> list[float]:
    with (run / "summary.csv").open(encoding="utf-8", newline="") as file:
        return [float(row[name]) for row in csv.DictReader(file)]
