"""The page as a file: what it says, that it needs nothing else, that names from files stay text."""

import base64
import hashlib
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import harness
import harness.old.report.pages.encounter_parts as parts_module
from harness.old.report.pages import player, traces
from harness.old.report.pages.page import write_report
from harness.old.report.pages.player import run_player
from harness.old.studies.batch import showing
from harness.old.studies.runs.shown import SHOWN, choose_pairs, shown_pairs
from harness.old.studies.runs.views import TIME_ADVANTAGE
from harness.scenario import validate
from tests.batches import one_cell, printed, refusal, run_inline, sweep
from tests.report.conftest import HOSTILE, report

VOID = {"meta", "link", "input", "img", "br", "hr"}


class Page(HTMLParser):
    """What a browser would find: elements with attributes, and the text of each kind of element."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while self._open and self._open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        self.texts.setdefault(self._open[-1] if self._open else "", []).append(data)

    @property
    def words(self) -> str:
        """All text but scripts and styles, spaces made single."""
        kept = (
            text for tag, of in self.texts.items() if tag not in ("script", "style") for text in of
        )
        return " ".join(" ".join(kept).split())

    def attributes(self, name: str) -> list[str]:
        return [str(found[name]) for _, found in self.elements if name in found]

    def has(self, *words: str) -> None:
        assert [text for text in words if text not in self.words] == []


@pytest.fixture(scope="module")
def page(single: Path, tmp_path_factory: pytest.TempPathFactory) -> Page:
    out = tmp_path_factory.mktemp("page") / "report.html"
    return Page(report(single, out).page)


def test_results_in_words_and_numbers(page: Page, single: Path) -> None:
    summary = harness.load_run(single).results[0].summary
    assert "soft_yield" in page.words
    first = page.words.partition("every measure")[0]
    assert f"μ, mean ratio of times {summary.mu.value:.3f} (" in " ".join(first.split())
    assert f"{summary.mu.value:.4f} *" in page.words
    # 0 of 12, one-sided: 1 − 0.05^(1/12).
    assert "each below 22.1 %" in first
    assert "Few pairs: intervals are unreliable below" in first
    assert "0.7044" in first  # the paper's


def test_it_needs_nothing_but_itself_and_runs_only_its_own_scripts(page: Page) -> None:
    assert not [tag for tag, _ in page.elements if tag in ("img", "iframe", "object", "base")]
    links = [link for link in page.attributes("href") if not link.startswith("#")]
    assert links == ["data:,"]
    assert page.attributes("src") == []
    assert not re.search(r"@import|url\((?!#)|fetch\(|XMLHttpRequest|import\(", page.source)
    # Names of XML's vocabularies are the only addresses.
    addresses = set(re.findall(r"https?://[^\s\"'<)]+", page.source))
    assert addresses <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    (policy,) = (a["content"] for _, a in page.elements if a.get("http-equiv"))
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    scripts = re.findall(r"<script>(.*?)</script>", page.source, re.DOTALL)
    assert len(scripts) == 2
    for script in scripts:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy


def test_markup_a_screen_reader_can_use(page: Page) -> None:
    assert ("html", {"lang": "en"}) in page.elements
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch(r"h[1-6]", tag)]
    assert levels.count(1) == 1
    assert max(b - a for a, b in pairwise(levels)) <= 1
    identifiers = page.attributes("id")
    assert len(identifiers) == len(set(identifiers))
    for labelled in page.attributes("aria-labelledby"):
        assert set(labelled.split()) <= set(identifiers)
    for tag, attributes in page.elements:
        if tag == "th":
            assert attributes.get("scope") in ("row", "col")
        if tag == "svg":
            assert attributes["role"] == "img"
            assert attributes["aria-labelledby"]
    assert sum(tag == "figure" for tag, _ in page.elements) == 9


def test_every_pair_is_in_the_player(page: Page, single: Path) -> None:
    head = '<script type="application/json" id="player-data">'
    (text,) = re.findall(f"{head}(.*?)</script>", page.source, re.DOTALL)
    episodes, run = json.loads(text)["episodes"], harness.load_run(single)
    names = sorted(episode["name"] for episode in episodes)
    assert names == sorted(f"pair {pair}" for pair in range(12))
    for episode in episodes:
        rows = run.traces_of(0, int(episode["name"].removeprefix("pair ")))
        for arm in episode["arms"]:
            own = rows[rows["arm"] == arm["arm"]]
            ego, walked = (own[own["object"] == name] for name in ("ego", "pedestrian-0"))
            (vehicle,), (walker,) = arm["vehicles"], arm["walkers"]
            assert vehicle["x"] == pytest.approx(ego["x_m"].tolist(), abs=5e-4)
            assert vehicle["v"] == pytest.approx(ego["speed_mps"].tolist(), abs=5e-4)
            assert walker["y"] == pytest.approx(walked["y_m"].tolist(), abs=5e-4)
            assert walker["t"] == pytest.approx(walked["time_s"].tolist(), abs=5e-4)


def test_long_episodes_are_thinned_and_a_full_page_stops(
    single: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = harness.load_run(single)
    shown = shown_pairs(run)
    monkeypatch.setattr(traces, "MOST_STATES", 20)
    vehicle = run_player(run, shown).episodes[0]["arms"][0]["vehicles"][0]  # type: ignore[index]
    rows = shown[0].traces
    ego = rows[(rows["object"] == "ego") & (rows["arm"] == "av")]
    assert 15 < len(vehicle["x"]) <= 22
    for column, name in (("t", "time_s"), ("x", "x_m")):
        ends = [vehicle[column][0], vehicle[column][-1]]
        assert ends == pytest.approx([ego[name].iloc[0], ego[name].iloc[-1]], abs=5e-4)
    monkeypatch.setattr(player, "MOST_BYTES", 10_000)
    short = run_player(run, shown)
    assert 0 < len(short.episodes) < 12
    assert f"{12 - len(short.episodes)} chosen pairs are left out" in short.words
    numbers = {index for group in short.groups.values() for index in group}
    assert numbers == set(range(len(short.episodes)))


@pytest.mark.usefixtures("no_pictures")
def test_a_page_reads_what_was_simulated_for_it(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page without it opens; it is written once, and beside the page of a read-only run."""
    folder, page = tmp_path / "run", tmp_path / "page.html"
    shutil.copytree(swept, folder, ignore=shutil.ignore_patterns(SHOWN))
    before = sorted(folder.iterdir())
    without = Page(write_report(harness.load_run(folder), page).page)
    assert "The run has no traces, so there are no episodes to show." in without.words
    assert sorted(folder.iterdir()) == before
    monkeypatch.setattr(showing.os, "access", lambda place, _: place != folder)
    assert "All records are identical" in Page(report(folder, page).page).words
    assert sorted(folder.iterdir()) == before
    beside = tmp_path / "page-shown"
    assert len(list(beside.iterdir())) >= 20
    (beside / "0-0-1.arrows").write_bytes(b"cut")
    assert showing.missing_pairs(harness.load_run(folder), page) == [(0, 0)]
    monkeypatch.undo()
    assert showing.write_shown(harness.load_run(folder), page) == ""
    assert {path.name for path in (folder / SHOWN).iterdir()} == {"0-0-1.arrows"}


@pytest.mark.usefixtures("no_pictures")
def test_a_sweep_has_its_table_over_cells(swept: Path, tmp_path: Path) -> None:
    run = harness.load_run(swept)
    found = Page(report(swept, tmp_path / "sweep.html").page)
    found.has("simulated again for the page", "All records are identical to the stored ones")
    # Two flows, in each the two strategies compared: the cells, and their difference.
    assert [found.source.count(f'id="differences-{group}"') for group in (0, 1, 2)] == [1, 1, 0]
    found.has("exact McNemar test of the crash rates")
    table = found.source.split('id="cells"')[1].split("</table>")[0]
    rows = re.findall(r"<tr>(.*?)</tr>", table, re.S)
    assert len(rows) == 1 + 4
    first = run.results[0].summary
    assert f'data-value="{first.mu.value!r}"' in rows[1]
    assert found.source.count('class="sortable') == 1 + 4


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without figures: theirs is most of the time."""
    monkeypatch.setattr(parts_module, "pictures_of", lambda *_: iter(()))


@pytest.mark.usefixtures("no_pictures")
def test_a_record_that_differs_is_named(swept: Path, tmp_path: Path) -> None:
    folder = tmp_path / "changed"
    shutil.copytree(swept, folder)
    table = pq.read_table(folder / "episodes.parquet")
    rows = table.to_pylist()
    changed = next(row for row in rows if row["arm"] == "av" and row["pass_time_s"] is not None)
    changed["pass_time_s"] += 1.0
    pq.write_table(pa.Table.from_pylist(rows, schema=table.schema), folder / "episodes.parquet")
    written = report(folder)
    (differing,) = written.differing
    assert "episodes.pass_time_s" in differing
    found = Page(written.page)
    found.has("1 of them differ from the stored record")
    assert "the record differs from the stored record" in found.source
    assert "of cell 0 (pedestrians.flow_per_hour = 300, arms.av = soft_yield)" in found.source


def test_names_from_files_stay_text(hostile: Path) -> None:
    found = Page(report(hostile).page)
    found.has(HOSTILE, "1 episode failed in the engine or in a strategy")
    found.has(f"cell 0 pair 11 human: TypeError: {HOSTILE}")
    scripts = [attributes for tag, attributes in found.elements if tag == "script"]
    assert len(scripts) == 3
    assert not [tag for tag, _ in found.elements if tag in ("img", "b")]
    assert not [name for _, of in found.elements for name in of if name.startswith("on")]


def test_a_page_says_nothing_of_a_model_that_nobody_asked(tmp_path: Path) -> None:
    own_speeds = {"mean_mps": 1.34, "std_mps": 0.26}
    changes = {"arms.human": "human_yield", "pedestrians.walking_speed": own_speeds}
    site = {"latitude_deg": 42.0, "longitude_deg": -83.0, "length_m": 14.0}
    shape = {f"crossing.{key}": value for key, value in site.items()}
    study = one_cell("cctc", {**shape, **changes, "experiment.pairs": 3})
    found = Page(report(run_inline(study, tmp_path / "run", traces=True).path).page)
    absent = ("interaction model", "Model dut", "aims for", "given the vehicle")
    for words in (*absent, "how walking speeds"):
        assert words not in found.words, words
    ran = scenario_of(found)
    assert not [key for key in ran if key.startswith("model.")]
    # What `harness run` remarked, the page remarks.
    found.has("ach lane is 7 m wide: crossing.lanes = 1 and oncoming_lanes = 1 share")
    # What did run is there, and what did not drive has no parameters there.
    assert ran["pedestrians.walking_speed.mean_mps"] == "1.34"
    assert ran["strategies.soft_yield.p1"] == "0.0169"
    assert not [key for key in ran if key.startswith("strategies.human_gmm")]
    found.has("42.000000°")


def test_what_ran_of_a_sweep_are_its_cells(tmp_path: Path) -> None:
    # The file's own values, 5 m/s and soft_yield, are in no cell; nor are its coordinates' parents.
    changes = {"experiment.pairs": 2, "arms.human": "human_yield"}
    vary = ("ego.initial_speed_mps=4,4.5", "arms.av=gap_yield,hard_yield")
    nowhere = {"crossing": {"latitude_deg": None, "longitude_deg": None}}
    study = sweep("cctc", changes, *vary)
    cells = [
        replace(cell, scenario=validate(merged(cell.scenario.model_dump(), nowhere), "test"))
        for cell in study.cells
    ]
    base = validate(merged(study.base.model_dump(), nowhere), "test")
    study = replace(study, base=base, cells=tuple(cells))
    found = Page(report(run_inline(study, tmp_path / "run", traces=True).path).page)
    ran = scenario_of(found)
    assert ran["ego.initial_speed_mps"] == "4, 4.5"
    assert ran["arms.av"] == "gap_yield, hard_yield"
    found.has("gap_yield, hard_yield (AV), human_yield (human)")
    # Somebody walks by the model, nobody drives by it; a crosswalk without a place has none.
    found.has("walking speeds given the vehicle. Dots: modes.", "at unknown coordinates")
    assert not [words for words in ("driving speeds", "42.27") if words in found.words]


def scenario_of(page: Page) -> dict[str, str]:
    """The table of the scenario's keys."""
    row = r"<th scope=\"row\"><code>(.*?)</code></th><td>(.*?)</td>"
    return dict(re.findall(row, page.source))


def merged(tree: dict[str, Any], changes: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return tree | {name: tree[name] | keys for name, keys in changes.items()}


@pytest.mark.usefixtures("no_pictures")
def test_without_its_model_a_run_is_still_reported(swept: Path, tmp_path: Path) -> None:
    folder = tmp_path / "moved"
    shutil.copytree(swept, folder, ignore=shutil.ignore_patterns(SHOWN))
    path = folder / "manifest.json"
    document = json.loads(path.read_text())
    document["scenario"]["model"]["path"] = str(tmp_path / "gone.json")
    path.write_text(json.dumps(document))
    found = Page(report(folder).page)
    found.has("could not be simulated again", "Figures of the interaction model are left out")


def test_report_writes_page_and_figures(
    single: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures_of = parts_module.pictures_of
    monkeypatch.setattr(parts_module, "pictures_of", lambda *given: islice(pictures_of(*given), 1))
    out, figures = tmp_path / "page.html", tmp_path / "figures"
    text = printed("report", single, "--out", out, "--figures", figures, "--json")
    document = json.loads(text)
    assert document["page"] == str(out)
    assert sorted(document["figures"]) == sorted(str(path) for path in figures.iterdir())
    assert {path.name for path in figures.iterdir()} == {"tau-mean.pdf", "tau-mean.png"}
    assert (figures / "tau-mean.pdf").read_bytes().startswith(b"%PDF")
    assert (figures / "tau-mean.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nothing-here"], "is not a run folder"),
        (["RUN", "--out", "page.txt"], "ending in .html"),
        (["RUN", "--out", "no/where.html"], "there is no folder"),
        (["RUN", "--figures", "RUN/manifest.json"], "is a file"),
    ],
)
def test_refusals_are_one_line(single: Path, arguments: list[str], words: str) -> None:
    before = sorted(single.iterdir())
    given = [word.replace("RUN", str(single)) for word in arguments]
    assert words in refusal("report", *given)
    assert sorted(single.iterdir()) == before


TABLES = ("cells", "episodes", "pairs", "pedestrians", "traces")
PARTS = [f"{name}.parquet" for name in TABLES] + ["manifest.json"]
SPOILT = [(part, what) for part in PARTS for what in ("missing", "cut", "other")]


# A summary that is missing is worked out anew.
@pytest.mark.parametrize(
    ("part", "what"), [*SPOILT, ("summary.parquet", "cut"), ("summary.parquet", "other")]
)
def test_a_partial_or_damaged_folder_is_one_line_and_nothing_is_written(
    single: Path, tmp_path: Path, part: str, what: str
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(single, folder)
    content = (folder / part).read_bytes()
    spoilt = {"missing": None, "cut": content[: len(content) // 2], "other": b"<html></html>"}[what]
    (folder / part).unlink()
    if spoilt is not None:
        (folder / part).write_bytes(spoilt)
    before = sorted(folder.iterdir())
    assert str(folder) in refusal("report", folder, "--figures", tmp_path / "figures")
    assert sorted(folder.iterdir()) == before
    assert not (tmp_path / "figures").exists()


def test_what_is_worth_watching(swept: Path) -> None:
    run = harness.load_run(swept)
    chosen = choose_pairs(run)
    episodes = run.episodes
    av = episodes[episodes["arm"] == "av"].set_index(["cell", "pair"])
    # What is dangerous comes first, and what need not be so last.
    assert next(iter(chosen)) == "crash of the AV"
    assert list(chosen).index("smallest PET") < list(chosen).index("smallest TTC")
    assert list(chosen)[-1].startswith(("smallest time advantage (calm", "other pairs"))
    # Cells share their pedestrians: each pair counts once, where it is worst.
    for reason, column, sign in (
        ("smallest PET", "pet_s", 1),
        ("smallest TTC", "min_ttc_s", 1),
        ("largest DRAC", "max_drac_mps2", -1),
        (TIME_ADVANTAGE, "min_time_advantage_s", 1),
    ):
        worst = (sign * av[column]).groupby("pair").min().dropna().sort_values()[:5]
        assert {pair for _, pair in chosen[reason]} == set(worst.index), reason
        assert [sign * av[column][key] for key in chosen[reason]] == list(worst)
    crashed = [key for key, ending in av["ending"].items() if ending == "crashed"]
    assert chosen["crash of the AV"] == crashed[:5]
    tau = run.pairs.dropna(subset="tau")
    assert [cell for cell, _ in chosen["median τ"]] == sorted(set(tau["cell"]))
    for cell, pair in chosen["median τ"]:
        own = tau[tau["cell"] == cell]
        value = own.set_index("pair")["tau"][pair]
        assert (own["tau"] < value).sum() <= len(own) / 2 <= (own["tau"] <= value).sum() + 0.5
    assert tau["tau"].min() == tau.set_index(["cell", "pair"])["tau"][chosen["lowest τ"][0]]
