"""Run folders cut off, mixed from two runs, or changed: read, or refused in one line."""

import io
import json
import os
import shutil
import sys
import zlib
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given, strategies as st

import harness
from harness.batch.experiment import Options, run_study
from harness.engine.process import close_engine
from harness.errors import InterruptedRunError
from harness.repeat.stored import StoredCell
from tests.batches import QUICK, Inline, one_cell, sweep
from tests.fuzz.command import done_or_refused, in_this_process
from tests.fuzz.hostile import NAMES, VALUES, accepted_or_refused_in_one_line, cases
from tests.fuzz.tables import hostile_table, written

TABLES = (
    "cells.parquet",
    "episodes.parquet",
    "pedestrians.parquet",
    "pairs.parquet",
    "traces.parquet",
)
FILES = ("manifest.json", *TABLES, "summary.csv", "measures.csv", "conflicts.csv", "log.jsonl")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where the commands are given, and where the good runs lie.

    ``one``: a sweep of two strategies with traces.  ``other``: another scenario's run.  ``single``:
    a run of one cell with traces.  ``broken``: ``one``, broken off before its tables were written.
    """
    from tests.conftest import _close_all

    _close_all()
    folder = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        changes = {**QUICK, "experiment.pairs": 6}
        study = sweep("cctc_flow", changes, "arms.av=constant_speed,hard_yield")
        run_study(study, Options(traces=True), out=folder / "one", make_executor=Inline)
        few = {**changes, "experiment.pairs": 3, "experiment.seed": 5}
        run_study(one_cell("cctc", few), Options(), out=folder / "other", make_executor=Inline)
        traced = Options(traces=True)
        run_study(one_cell("cctc", few), traced, out=folder / "single", make_executor=Inline)
        _break_off(folder, patch)
        in_this_process(patch)
        assert {file.name for file in (folder / "one").iterdir()} >= set(FILES)
        yield folder
    close_engine()


def _break_off(folder: Path, patch: pytest.MonkeyPatch) -> None:
    from harness.batch import experiment

    def stopped(*_: Any) -> None:
        raise KeyboardInterrupt

    changes = {**QUICK, "experiment.pairs": 6}
    study = sweep("cctc_flow", changes, "arms.av=constant_speed,hard_yield")
    options, out = Options(traces=True), folder / "broken"
    with patch.context() as breaking:
        breaking.setattr(experiment, "finish", stopped)
        with pytest.raises(InterruptedRunError):
            run_study(study, options, out=out, make_executor=Inline)


WAYS = (
    "frames",
    "stored",
    "compare",
    "compare --json",
    "export",
    "score",
    "resume",
)
SLOW_WAYS = ("report", "replay")


def read_one(folder: Path, way: str) -> None:
    """Read the hostile copy in one of the ways there are; nothing is written outside."""
    run = folder / "hostile"
    again = folder / "again"
    if way == "frames":
        accepted_or_refused_in_one_line(lambda: frames(run))
    elif way == "stored":
        accepted_or_refused_in_one_line(lambda: StoredCell(run, 0).check_pair(0))
    elif way.startswith("compare"):
        done_or_refused(*way.split(), "hostile", inside=again)
    elif way == "export":
        done_or_refused("export", "hostile", "--csv", inside=run)
    elif way == "score":
        done_or_refused("score", "hostile", "--out", "again", inside=again)
    elif way == "resume":
        done_or_refused("run", "--resume", "hostile", inside=run, codes=(0, 1, 2))
    elif way == "report":
        if done_or_refused("report", "hostile", "--out", "page.html", inside=folder):
            harmless((folder / "page.html").read_text(encoding="utf-8"))
    else:
        replayed = ("replay", "hostile", "--pair", "0", "--arm", "av", "--out", "again")
        done_or_refused(*replayed, inside=again, codes=(0, 1, 2))
    assert not [path for path in folder.rglob("*") if path.name.endswith(".partial")]
    shutil.rmtree(again, ignore_errors=True)


def frames(run: Path) -> None:
    """All that Python gives of a run."""
    data = harness.load_run(run)
    for name in ("cells", "episodes", "pedestrians", "pairs", "summary", "measures", "results"):
        getattr(data, name)
    _ = data.conflicts, data.failures(), data.scenario
    if data.kept_traces:
        _ = data.traces


class _Tags(HTMLParser):
    """Every element of a page with its attributes, and the text of its scripts."""

    def __init__(self) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.elements and self.elements[-1][0] == "script" and data.strip():
            self.scripts.append(data)


def harmless(page: str) -> None:
    """Whatever names are in the files, a page has its own elements and scripts alone."""
    tags = _Tags()
    tags.feed(page)
    for tag, attributes in tags.elements:
        assert tag not in ("img", "iframe", "object", "embed", "base", "form"), tag
        assert not [name for name in attributes if name.startswith("on")], attributes
        for name in ("href", "src"):
            link = attributes.get(name) or attributes.get(f"xlink:{name}") or "#"
            assert link.startswith(("#", "data:")), link
    data = [a for tag, a in tags.elements if tag == "script" and a.get("type")]
    code = [a for tag, a in tags.elements if tag == "script" and not a.get("type")]
    assert len(data) <= 1
    assert len(code) == 2
    if data:
        json.loads(tags.scripts[0])


@pytest.fixture
def copy(folder: Path) -> Callable[..., Path]:
    """Gives a copy of a run to be spoilt, in the same place."""

    def make(name: str = "one") -> Path:
        run = folder / "hostile"
        shutil.rmtree(run, ignore_errors=True)
        shutil.copytree(folder / name, run)
        return run

    return make


Copy = Callable[..., Path]


@cases("run folder", 2_000)
@given(
    st.sampled_from(FILES),
    st.integers(0, 2**31),
    st.lists(st.tuples(st.integers(0, 2**31), st.integers(0, 255)), max_size=5),
    st.sampled_from(WAYS),
)
@example("summary.csv", 200, [], "frames")
def test_cut_off_or_changed_bytes(
    folder: Path, copy: Copy, name: str, end: int, flips: list[tuple[int, int]], way: str
) -> None:
    run = copy()
    content = bytearray((run / name).read_bytes())
    for place, value in flips:
        content[place % len(content)] = value
    cut = content if flips else content[: end % len(content)]
    (run / name).write_bytes(bytes(cut))
    read_one(folder, way)


@cases("run folder", 1_000)
@given(st.sets(st.sampled_from(FILES), min_size=1), st.booleans(), st.sampled_from(WAYS))
def test_missing_or_from_another_run(
    folder: Path, copy: Copy, names: set[str], mixed: bool, way: str
) -> None:
    run = copy()
    for name in names:
        (run / name).unlink()
        if mixed and (folder / "single" / name).is_file():
            shutil.copyfile(folder / "single" / name, run / name)
    read_one(folder, way)


def places_of(document: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where a value stands in a document, of every value."""
    if path:
        yield path
    entries = list(enumerate(document)) if isinstance(document, list) else []
    for key, value in document.items() if isinstance(document, dict) else entries:
        yield from places_of(value, (*path, key))


@cases("run folder", 2_500)
@given(st.integers(0, 2**31), VALUES, st.sampled_from(WAYS), st.sampled_from(["one", "single"]))
def test_any_value_in_the_manifest(
    folder: Path, copy: Copy, which: int, value: Any, way: str, of: str
) -> None:
    run = copy(of)
    document = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    places = list(places_of(document))
    *before, last = places[which % len(places)]
    node = document
    for key in before:
        node = node[key]
    node[last] = value
    (run / "manifest.json").write_text(json.dumps(document), encoding="utf-8")
    read_one(folder, way)


@cases("run folder", 800)
@given(NAMES, NAMES, st.sampled_from(WAYS))
def test_any_strategy_in_the_manifest(
    folder: Path, copy: Copy, module: str, strategy: str, way: str
) -> None:
    run = copy()
    manifest = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    manifest["scenario"]["arms"]["av"] = f"{module}:{strategy}"
    manifest["cells"] = [{f"strategies.{module}.{strategy}": value} for value in (1, 2)]
    (run / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    read_one(folder, way)


@cases("run folder", 2_500)
@given(
    st.data(), st.sampled_from(TABLES), st.sampled_from(WAYS), st.sampled_from(["one", "single"])
)
def test_hostile_tables(
    folder: Path, copy: Copy, data: st.DataObject, name: str, way: str, of: str
) -> None:
    run = copy(of)
    table = data.draw(hostile_table(pq.read_table(run / name)))
    if written(table, run / name):
        read_one(folder, way)


def shard_of(tables: list[pa.Table]) -> bytes:
    """A shard as it would have to look: the checksum is right, whatever it holds."""
    buffer = io.BytesIO()
    for table in tables:
        with pa.ipc.new_stream(buffer, table.schema) as stream:
            stream.write_table(table)
    return zlib.crc32(buffer.getvalue()).to_bytes(4) + buffer.getvalue()


SHARD_NAMES = st.builds(
    "{}-{}-{}.arrows".format,
    st.sampled_from([0, 1, 2, 99, 2**31]),
    st.sampled_from([0, 1, 3, 5, 10**18]),
    st.sampled_from([0, 1, 3, 6, 10**18]),
)


@cases("run folder", 1_000)
@given(st.data(), SHARD_NAMES, st.booleans(), st.sampled_from(["frames", "resume", "stored"]))
def test_hostile_shards(
    folder: Path, copy: Copy, data: st.DataObject, name: str, added: bool, way: str
) -> None:
    run = copy("broken")
    first = sorted((run / "shards").iterdir())[0]
    good = io.BytesIO(first.read_bytes()[4:])
    tables = [pa.ipc.open_stream(good).read_all() for _ in range(3)]
    spoilt = data.draw(st.integers(0, 2))
    tables[spoilt] = data.draw(hostile_table(tables[spoilt]))
    try:
        content = shard_of(tables[: data.draw(st.integers(0, 3))])
    except (pa.ArrowException, ValueError):
        return
    if not added:
        first.unlink()
    target = run / "shards" / (name if data.draw(st.booleans()) else first.name)
    target.write_bytes(content)
    read_one(folder, way)


@cases("run folder", 150)
@given(st.data(), NAMES, NAMES, st.sampled_from(SLOW_WAYS), st.sampled_from(["one", "single"]))
def test_reports_and_replays(
    folder: Path, copy: Copy, data: st.DataObject, name: str, label: str, way: str, of: str
) -> None:
    """Names in every place that a page or a figure shows them, and now and then a spoilt table."""
    run = copy(of)
    document = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    document["name"] = name
    document["models"][0]["name"] = label
    document["versions"][label] = name
    if data.draw(st.booleans()):
        document["cells"] = [{**cell, "conflicts.ttc_s": 1.0} for cell in document["cells"]]
    (run / "manifest.json").write_text(json.dumps(document), encoding="utf-8")
    spoilt = data.draw(st.sampled_from(["", *TABLES]))
    if spoilt and not written(data.draw(hostile_table(pq.read_table(run / spoilt))), run / spoilt):
        return
    read_one(folder, way)


@cases("run folder", 100)
@given(NAMES, NAMES)
@example("</script><script>alert(1)</script>", "<!--")
@example("$\\frac{$", "--><b>")
@example("{{7*7}}", "' onload='alert(1)")
def test_words_of_a_run_stay_words_in_its_page(
    folder: Path, copy: Copy, reason: str, strategy: str
) -> None:
    """What an episode says of itself: its strategy, and why it failed."""
    run = copy("single")
    table = pq.read_table(run / "episodes.parquet")
    count = table.num_rows
    for column, words in (("reason", reason), ("strategy", strategy)):
        place = table.column_names.index(column)
        try:
            table = table.set_column(place, column, pa.array([words] * count, pa.string()))
        except (pa.ArrowException, UnicodeEncodeError):
            return
    endings = ["engine_failed"] * 2 + ["timed_out"] * 2 + table["ending"].to_pylist()[4:]
    place = table.column_names.index("ending")
    table = table.set_column(place, "ending", pa.array(endings, pa.string()))
    pq.write_table(table, run / "episodes.parquet")
    read_one(folder, "report")


@pytest.mark.parametrize("name", [*FILES, "shards/0-0-6.arrows"])
@pytest.mark.parametrize("kind", ["pipe", "folder", "loop", "device"])
def test_what_is_no_regular_file_is_refused(folder: Path, copy: Copy, name: str, kind: str) -> None:
    run = copy("broken" if "/" in name else "one")
    path = run / name
    path.unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to(path.name if kind == "loop" else "/dev/zero")
    for way in ("frames", "score", "resume"):
        read_one(folder, way)


@pytest.mark.parametrize("name", ["log.jsonl", "shards", ".lock", "sumo", "shards/x.arrows"])
def test_links_out_of_the_folder_are_refused(folder: Path, copy: Copy, name: str) -> None:
    """A folder somebody else packed must not write through them."""
    run = copy("broken")
    outside = folder / "outside"
    outside.mkdir(exist_ok=True)
    if name in ("shards", "log.jsonl"):
        shutil.rmtree(run / name) if (run / name).is_dir() else (run / name).unlink(missing_ok=True)
    (run / name).symlink_to(outside)
    assert not done_or_refused("run", "--resume", "hostile", inside=run)
    assert not any(outside.iterdir())


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "a/b", "..", "\ud800", "\x1b[2J", "a\nb"])
def test_no_name_leads_out_of_the_folder(folder: Path, copy: Copy, name: str) -> None:
    run = copy()
    document = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    document["name"] = name
    (run / "manifest.json").write_text(json.dumps(document), encoding="utf-8")
    for way in (*WAYS, *SLOW_WAYS):
        read_one(folder, way)


def test_a_shard_that_promises_endless_pairs_is_none(folder: Path, copy: Copy) -> None:
    run = copy("broken")
    first = sorted((run / "shards").iterdir())[0]
    first.rename(run / "shards" / f"0-0-{10**18}.arrows")
    assert done_or_refused("run", "--resume", "hostile", inside=run)
    assert (run / "episodes.parquet").read_bytes() == (
        folder / "one" / "episodes.parquet"
    ).read_bytes()


def test_what_imports_a_strategy_that_a_manifest_names(folder: Path, copy: Copy) -> None:
    """To look at a run imports nothing; to run it again does (docs/files.md, what is trusted)."""
    module = "named_in_a_manifest"
    (folder / f"{module}.py").write_text("class S:\n    def decide(self, _): return 0.0\n")
    run = copy("single")
    document = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    document["scenario"]["arms"]["av"] = f"{module}:S"
    (run / "manifest.json").write_text(json.dumps(document), encoding="utf-8")
    for way in ("frames", "compare", "export", "report"):
        read_one(folder, way)
        assert module not in sys.modules, way
    read_one(folder, "score")
    assert sys.modules.pop(module)
