"""``harness extract``, ``fit`` and ``model`` as a user meets them."""

import hashlib
import json
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from harness.model.interaction import VARIABLES, read_model
from harness.model.trajectories.extraction import EXTRACTION_KEY
from harness.report import model_figures
from harness.studies.models.model_results import model_result
from tests.batches import here, printed
from tests.recordings import made_up

DATA = Path(__file__).resolve().parents[1] / "data"


@pytest.fixture
def harness(monkeypatch, tmp_path):
    """Runs the command line in an empty folder; gives exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def run(*words: object) -> tuple[int, str, str]:
        done = here(*words)
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.fixture
def rows(tmp_path) -> Path:
    path = tmp_path / "mine.csv"
    made_up().to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def model_file(tmp_path_factory) -> Path:
    """A model fitted by the commands, with the rows it was fitted on beside it."""
    folder = tmp_path_factory.mktemp("fitted")
    made_up().to_csv(folder / "mine.csv", index=False)
    for words in (
        "extract mine.csv --format table --out rows.parquet --quiet",
        "fit rows.parquet --components 1..3 --starts 1 --folds 2 --out model.json --quiet",
    ):
        printed(*words.split(), cwd=folder)
    return folder / "model.json"


def test_extract_writes_rows_and_says_what_it_left_out(harness, rows):
    given = ("extract", rows, "--format", "table", "--out", "r.parquet")
    code, out, err = harness(*given, "--json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document["title"] == "160 rows, 40 encounters, 8 vehicles"
    assert {of["column"]: of["rows"] for of in document["records"]}["pedestrian_speed_mps"] == 160
    assert len(pd.read_parquet("r.parquet")) == 160
    _, out, _ = harness(*given)
    assert "160 rows, 40 encounters, 8 vehicles" in out


def test_what_the_files_do_not_say_is_said(harness):
    given = ("extract", DATA / "vci_made_up", "--format", "vci", "--out", "r.parquet")
    _, out, _ = harness(*given)
    # 24000/1001 frames per second; a speed is proportional to it.
    assert "frame_rate_hz = 23.976 frames per second (assumed" in out
    _, out, _ = harness(*given, "--set", "frame_rate_hz=29.97", "--json")
    said = [note["text"] for note in json.loads(out)["notes"]]
    assert any(text.startswith("frame_rate_hz = 29.97 frames per second;") for text in said)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("extract nothing.csv --format table --out r.parquet", ["nothing.csv", "no such"]),
        ("extract mine.csv --format tabel --out r.parquet", ["tabel", "did you mean 'table'"]),
        ("extract mine.csv --format table --out r.csv", ["--out", ".parquet"]),
        ("extract mine.csv --format table --out no/r.parquet", ["--out", "folder"]),
        ("extract mine.csv --format table --out r.parquet --set min_rnage_m=3",
         ["min_rnage_m", "did you mean 'min_range_m'"]),
        ("extract mine.csv --format table --out r.parquet --set min_range_m=100",
         ["format table: min_range_m: 100", "at most max_range_m = 60"]),
        ("extract mine.csv --format table --out r.parquet --set max_angle_deg=1e6",
         ["max_angle_deg: 1000000.0 is not accepted", "less than or equal to 180"]),
        ("fit nothing.parquet --out m.json", ["nothing.parquet", "no such"]),
        ("fit mine.csv --out m.txt", ["--out", ".json"]),
        ("fit mine.csv --out m.json --components 0..3", ["--components", "1 to 100"]),
        ("fit mine.csv --out m.json --choose bci", ["--choose", "not one of 'held-out'"]),
        ("fit mine.csv --out m.json --weigh cars", ["--weigh", "'encounter'"]),
        ("fit mine.csv --out m.json --bounds vehicle_sped_mps=1:2",
         ["--bounds", "did you mean 'vehicle_speed_mps'"]),
        ("fit mine.csv --out m.json --bounds vehicle_speed_mps=2:1", ["--bounds", "lower < upper"]),
        ("fit mine.csv --out m.json --bounds vehicle_speed_mps=1/0:2",
         ["--bounds", "lower < upper"]),
        ("model dut-k11", ["dut-k11", "did you mean"]),
        ("model m.json", ["m.json", "cannot be read"]),
        ("validate no --format vci --drivers x --out no/page.html", ["--out", "folder"]),
        ("model mine.csv", ["mine.csv", "JSON"]),
    ],
)  # fmt: skip
def test_refusals_are_one_line_and_leave_nothing(harness, rows, words, told):
    before = sorted(path.name for path in rows.parent.iterdir())
    code, out, err = harness(*shlex.split(words))
    assert code == 2
    assert out == ""
    assert len(err.splitlines()) == 1
    for part in told:
        assert part in err
    assert sorted(path.name for path in rows.parent.iterdir()) == before


def test_the_card_tells_where_the_model_comes_from_and_how_to_make_it(model_file, tmp_path):
    model = read_model(model_file)
    card, rows = model.provenance, model_file.parent / "rows.parquet"
    with pytest.raises(TypeError, match="mappingproxy"):
        card["bounds"]["x"] = [0, 1]
    assert card["rows_sha256"] == hashlib.sha256(rows.read_bytes()).hexdigest()
    assert (card["rows_read"], card["rows"]) == (160, 156)
    assert card["rows_outside_box"]["vehicle_speed_mps"] == 4
    assert (card["encounters"], card["vehicles"]) == (39, 8)
    assert card["weight_sum"] == pytest.approx(39)
    assert [of["components"] for of in card["candidates"]] == [1, 2, 3]
    assert card["components"] == model.mixture.weights.size
    assert card["chosen_by"] == "held-out"
    best = max(card["candidates"], key=lambda of: of["held_out"]["mean"])
    assert best["components"] == card["components"]
    assert card["bounds"]["inverse_range_per_m"] == (1 / 60, 0.5)
    assert any("vehicles" in warning for warning in card["warnings"])
    assert set(card["versions"]) >= {"harness", "python", "numpy", "scipy"}
    commands = read_model(model_file).provenance["commands"]
    (tmp_path / "mine.csv").write_bytes((model_file.parent / "mine.csv").read_bytes())
    assert len(commands) == 2
    for command in commands:
        name, *words = shlex.split(command)
        assert (name, here(*words, cwd=tmp_path).returncode) == ("harness", 0)
    assert (tmp_path / "model.json").read_bytes() == model_file.read_bytes()


@pytest.mark.usefixtures("rows")
def test_fit_gives_one_number_of_components_and_prints_progress_apart(harness):
    code, out, _ = harness(
        "fit", "mine.csv", "--components", 2, "--folds", 0, "--starts", 1, "--weigh", "row",
        "--name", "own", "--out", "m.json", "--json",
    )  # fmt: skip
    document = json.loads(out)
    assert code == 0
    assert document["facts"]["chosen_by"] == "given"
    assert document["records"][0]["held_out"] is None
    assert read_model(Path("m.json")).name == "own"


def test_model_shows_the_moments_and_quantiles_of_each_variable(model_file):
    drawn = read_model(model_file).mixture.sample(200_000, np.random.default_rng(1))
    (table,) = model_result("model", read_model(model_file), "m.json").full
    for i, (name, *numbers) in enumerate(table.rows):
        assert name == VARIABLES[i]
        of = dict(zip([column.key for column in table.columns[1:]], numbers, strict=True))
        error = drawn[:, i].std() / np.sqrt(len(drawn))
        assert of["mean"].finding.value == pytest.approx(drawn[:, i].mean(), abs=5 * error)
        assert of["sd"].finding.value == pytest.approx(drawn[:, i].std(), abs=10 * error)
        assert of["50 %"].finding.value == pytest.approx(np.median(drawn[:, i]), abs=10 * error)


def test_a_card_of_another_form_and_a_damaged_record_of_the_extraction_are_said(
    harness, model_file, tmp_path
):
    card = json.loads(model_file.read_text())
    card["provenance"]["candidates"][0]["bic"] = "low"
    (tmp_path / "odd.json").write_text(json.dumps(card))
    code, _, err = harness("model", "odd.json")
    assert (code, "provenance: candidates.0.bic: 'low' is not accepted" in err) == (2, True)
    rows = pq.read_table(model_file.parent / "rows.parquet")
    pq.write_table(rows.replace_schema_metadata({EXTRACTION_KEY: b"{"}), tmp_path / "odd.parquet")
    words = "fit odd.parquet --components 1 --folds 0 --starts 1 --out m.json"
    _, out, _ = harness(*words.split())
    assert "What the rows' file says of its extraction is damaged." in out


def test_show_draws_the_papers_figures(harness, model_file, tmp_path, monkeypatch):
    monkeypatch.setattr(model_figures, "_CELLS", 8)
    rows = model_file.parent / "rows.parquet"
    code, out, _ = harness("model", model_file, "--figures", "f", "--rows", rows, "--quiet")
    assert code == 0
    names = {"components", "pairs", "speeds"}
    wanted = {f"{name}.{kind}" for name in names for kind in ("png", "pdf")}
    assert {path.name for path in (tmp_path / "f").iterdir()} == wanted
    assert len(out.splitlines()) == 6
