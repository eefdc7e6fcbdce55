"""Small runs that the tests of this folder read: simulated once per session, never changed."""

import json
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import harness
from harness.old.report.pages.page import Written, write_report
from harness.old.studies.batch.showing import write_shown
from tests.batches import one_cell, one_process, run_inline, sweep


def report(folder: Path, out: Path | None = None) -> Written:
    """A run's page, made as by ``harness report``."""
    run = harness.load_run(folder)
    with one_process():
        missing = write_shown(run, out)
    return write_report(run, out, missing=missing)


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder the runs below lie in."""
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="session")
def single(runs: Path) -> Path:
    """The paper's experiment, 12 pairs, with traces."""
    study = one_cell("cctc", {"experiment.pairs": 12})
    return run_inline(study, runs / "single", traces=True).path


@pytest.fixture(scope="session")
def swept(runs: Path) -> Path:
    """Two flows × two strategies, one of which crashes; no traces."""
    changes = {"experiment.pairs": 8, "experiment.timeout_s": 40.0}
    vary = ("pedestrians.flow_per_hour=300,900", "arms.av=soft_yield,constant_speed")
    return run_inline(sweep("cctc_flow", changes, *vary), runs / "swept").path


HOSTILE = '<script>document.title = "owned"</script><img src=x onerror=alert(1)> & "$\\frac{1}$'
"""A name that would be code in a page that took it at its word."""


@pytest.fixture(scope="session")
def hostile(single: Path, runs: Path) -> Path:
    """A run whose name, strategy, model and folder are written to be code."""
    folder = runs / "<b>run</b>"
    shutil.copytree(single, folder)
    path = folder / "manifest.json"
    document = json.loads(path.read_text())
    document["name"] = HOSTILE
    document["scenario"]["arms"]["av"] = HOSTILE
    document["simulated_with"]["models"][0]["name"] = HOSTILE
    document["simulated_with"]["versions"]["harness"] = f"1</script>{HOSTILE}"
    path.write_text(json.dumps(document))
    table = pq.read_table(folder / "episodes.parquet")
    rows = [{**row, "strategy": f"</script>{HOSTILE}"} for row in table.to_pylist()]
    rows[-1] |= {"ending": "engine_failed", "reason": f"TypeError: {HOSTILE}"}
    pq.write_table(pa.Table.from_pylist(rows, schema=table.schema), folder / "episodes.parquet")
    return folder
