"""What is added in one place appears everywhere: a number, a measure, a note."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ADDED = {
    # A number of a column that is there: one entry.
    "harness/results/catalogue.py": (
        "ENTRIES: tuple[Entry, ...] = (\n",
        """
    Entry("gap_m", "smallest gap", "Mean of the smallest gaps.",
          Estimate("min_gap_m", estimators.mean), unit="m", screen="always"),
    Entry("halved_s", "half of the time", "Mean of the halves.",
          Estimate("halved_time_s", estimators.mean), Style(digits=4), "s", screen="always"),
""",
    ),
    # A measure: a function and its declaration; the second entry above reports it.
    "harness/measures/efficiency.py": (
        "from harness.measures.chunk import Chunk\n",
        '''

def halved_time_s(chunk: Chunk) -> FloatArray:
    """Half of the pass time."""
    return chunk.pass_time_s / 2
''',
    ),
    "harness/measures/measured.py": (
        'each with its definition; undefined values are None."""\n',
        """
    halved_time_s: float | None = _measured(
        efficiency.halved_time_s, "s", "half of pass_time_s", about="time", undefined_when="crash"
    )
""",
    ),
    # A note: one rule.
    "harness/results/notes.py": (
        "RULES: tuple[Rule, ...] = (\n",
        """
    Rule("halved", "halved", lambda cell: [Said(f"Half: {cell['halved_s'].value:.4f} s.")]),
""",
    ),
}
"""What is inserted into a file, behind which text."""

EVERYWHERE = """
import json, sys
sys.modules.update(dict.fromkeys(["libsumo", "traci", "sumolib", "sumo"]))
from pathlib import Path
import harness
from docs.hooks.reference import columns_page

run = harness.run("cctc", pairs=3, seed=1, out="run", workers=0, engine="plain")
run = harness.load_run("run")
result = run.result()
harness.write_report("run")
texts = {
    "page": Path("run/report.html").read_text(encoding="utf-8"),
    "json": json.dumps(result.to_dict()),
    "findings": Path("run/findings.json").read_text(encoding="utf-8"),
    "summary": Path("run/summary.csv").read_text(encoding="utf-8"),
    "table": " ".join(run.episodes.columns),
    "reference": columns_page(),
    "where": harness.__file__,
}
times = run.episodes[run.episodes["arm"] == "av"]["pass_time_s"]
Path("texts.json").write_text(json.dumps({**texts, "half": float(times.mean() / 2)}))
"""


@pytest.fixture(scope="module")
def texts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Every view of a run by a copy of the package with these additions."""
    copy = tmp_path_factory.mktemp("copy")
    for name in ("harness", "docs", "scenarios", "networks"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(Path(__file__).parents[2] / name, copy / name, ignore=ignored)
    for name, (before, added) in ADDED.items():
        text = (copy / name).read_text("utf-8")
        assert text.count(before) == 1, name
        (copy / name).write_text(text.replace(before, before + added), "utf-8")
    command = [sys.executable, "-c", EVERYWHERE]
    result = subprocess.run(command, cwd=copy, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    found: dict[str, str] = json.loads((copy / "texts.json").read_text("utf-8"))
    for view, *options in (("screen",), ("full", "--full")):
        command = [sys.executable, "-m", "harness", "show", "run", *options]
        result = subprocess.run(command, cwd=copy, capture_output=True, text=True, check=True)
        found[view] = result.stdout
    assert found["where"].startswith(str(copy))
    return found


@pytest.mark.parametrize(
    ("view", "number", "note"),
    [
        ("screen", "half of the time, s", True),
        ("full", "half of the time, s", True),
        ("page", "half of the time, s", True),
        ("json", '"halved_s": {"value": HALF', True),
        ("findings", '"halved_s": {\n     "value": HALF', False),
        ("summary", "halved_s,", False),
        ("table", "halved_time_s", False),
        ("reference", "| `halved_s` |  | s | Mean of the halves. |", False),
    ],
)
def test_a_measure_its_number_and_a_note_are_in_every_view(
    texts: dict[str, str], view: str, number: str, note: bool
) -> None:
    half, text = float(texts["half"]), texts[view]
    assert half > 2
    assert number.partition("HALF")[0] in text
    if view not in ("table", "reference"):
        value = f"{half:.4f}" if view in ("screen", "full", "page") else str(half)[:8]
        assert value in text
    assert (f"Half: {half:.4f} s." in text) == note


def test_a_column_is_one_entry_and_has_its_row_in_the_reference(texts: dict[str, str]) -> None:
    for view in ("screen", "full", "page"):
        assert re.search(r"smallest gap, m\W", texts[view])
    tables = texts["reference"].partition("## pedestrians/")[0]
    assert "| `halved_time_s` | number | s | half of pass_time_s |" in tables
    assert "| `gap_m_human` |  | m | `gap_m` of the reference's arm. |" in texts["reference"]
