"""A further entry of the catalogue is in everything that shows the numbers of a run."""

from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import harness
from docs.hooks import reference
from harness.old.report.screens.result_tables import full_tables
from harness.old.report.screens.run_document import run_document
from harness.old.statistics import ENCOUNTERS, EncounterColumns, Entry, Interval, student_mean
from harness.old.store import kinds
from harness.old.studies.runs.reported import reported
from tests.batches import one_cell
from tests.made_up import Fate, made_up

ENTRY: Entry[EncounterColumns] = Entry(
    "fastest_s",
    "fastest passage",
    "The shortest time to cross.",
    unit="s",
    of_arm=lambda columns, arm: float(columns.pairs.time_s[arm].min()),
    paired=lambda columns: student_mean(columns.pairs.time_s[0] - columns.pairs.time_s[1]),
    interval=Interval,
    undefined="no episode crossed",
)


def fate(_task: object, pair: int) -> Fate:
    return {"pass_time_s": 8.0 + pair}


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    kind = kinds.EncounterKind(catalogue=(*ENCOUNTERS, ENTRY))
    monkeypatch.setattr(kinds, "kind_of", lambda _scenario: kind)
    return made_up(tmp_path / "run", one_cell("cctc", {"experiment.pairs": 4}), fate)


def test_it_is_in_the_tables_of_files_terminal_and_page_and_in_the_reference(run: Path) -> None:
    names = ["fastest_s", "fastest_s_human", "fastest_s_difference_ci_high"]
    assert {*names} <= {*pd.read_csv(run / "summary.csv")}
    assert pq.read_schema(run / "summary.parquet").field("fastest_s").type == pa.float64()
    assert harness.load_run(run).summary["fastest_s"].tolist() == [8.0]
    tables = full_tables(reported(harness.load_run(run)))
    texts = [cell.text for table in tables for row in table.rows for cell in row]
    assert "fastest passage, s" in texts
    words = ["`fastest_s`", "yes", "", "s", "The shortest time to cross. The AV's arm."]
    assert reference.row_of(ENTRY, "fastest_s") == words


def test_it_is_in_the_json_document(run: Path) -> None:
    """8, 9, 10 and 11 s against 10 s; Student's t of three degrees of freedom is 3.1824."""
    (cell,) = run_document(harness.load_run(run))["cells"]
    assert cell["findings"]["fastest_s"]["value"] == 8.0
    difference = cell["findings"]["fastest_s_difference"]
    reach = 3.1824 * (5 / 3) ** 0.5 / 2
    limits = [difference[key] for key in ("low", "value", "high")]
    assert limits == pytest.approx([-0.5 - reach, -0.5, -0.5 + reach], abs=1e-3)
    assert cell["summary"]["fastest_s_human"] == 10.0
