"""Parts, the manifest and the folder of a run, through the functions that write and read them."""

import copy
import errno
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from hypothesis import given, settings, strategies as st

from harness.core.errors import HarnessError, InputError
from harness.core.vocabulary import Arm
from harness.model.interaction import InteractionModel
from harness.results import folder as folders
from harness.results.cell_findings import CellFindings
from harness.results.finding import Finding
from harness.results.folder import (
    FINDINGS,
    DamagedPartError,
    done_parts,
    part_name,
    read_cell,
    sealed,
    write_part,
)
from harness.results.loaded_run import load_run
from harness.results.tables import EPISODES, PEDESTRIANS
from harness.scenario import Cell, Scenario, Study, load_scenario
from harness.studies.running.claimed_folder import (
    RunFolder,
    claim_folder,
    manifest_of,
    refuse_changes,
)
from harness.studies.running.tasks import part_pairs
from harness.studies.worst import worst
from tests.scenes import refusal_of, refuses


def manifest(pairs: int, size: int = 3) -> Any:
    """What reading a part needs of a manifest."""
    planned = {"experiment": {"pairs": pairs}}
    return {"pairs_per_part": size, "digest": "this run", "scenario": planned}


MANIFEST = manifest(12)


def rows(first: int, count: int, **more: Any) -> list[dict[str, Any]]:
    """Rows of ``episodes`` of cell 2; the times tell pairs and arms apart."""
    return [
        {
            **{"cell": 2, "pair": pair, "arm": arm.value, "strategy": "soft_yield"},
            **{"ending": "crossed", "fallback": False, "steps": 10, "pedestrians": 1},
            **{"pass_time_s": 5.0 + pair + (arm is Arm.AV) / 2, "stops": pair, **more},
        }
        for pair in range(first, first + count)
        for arm in Arm
    ]


def write(folder: Path, first: int, of: list[dict[str, Any]], digest: str = "this run") -> Path:
    tables = {"episodes": EPISODES.of(of), "pedestrians": PEDESTRIANS.of([])}
    write_part(folder, 2, first, tables, digest)
    return folder / "episodes" / part_name(2, first)


def test_rows_with_another_column_or_without_a_required_value_are_refused() -> None:
    with pytest.raises(ValueError, match=r"required: .'pet', 'strategy'"):
        EPISODES.of(rows(0, 1, pet=1.0, strategy=None))


@settings(max_examples=25)
@given(pairs=st.integers(1, 20), size=st.integers(1, 9))
def test_rows_do_not_depend_on_the_division(
    tmp_path_factory: pytest.TempPathFactory, pairs: int, size: int
) -> None:
    folder = tmp_path_factory.mktemp("parts")
    for first in reversed(range(0, pairs, size)):
        write(folder, first, rows(first, min(size, pairs - first)))
    read = read_cell(folder, "episodes", 2, manifest(pairs, size))
    assert read.equals(EPISODES.of(rows(0, pairs)))
    assert done_parts(folder) == {(2, first) for first in range(0, pairs, size)}
    one = read_cell(folder, "episodes", 2, manifest(pairs, size), pairs - 1)
    assert one.to_pylist() == EPISODES.of(rows(pairs - 1, 1)).to_pylist()


def test_no_flipped_byte_changes_a_row_silently(tmp_path: Path) -> None:
    path, whole = write(tmp_path, 0, rows(0, 3)), EPISODES.of(rows(0, 3))
    content, refused = path.read_bytes(), 0
    for place in range(0, len(content), 97):
        path.write_bytes(content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :])
        try:
            assert read_cell(tmp_path, "episodes", 2, MANIFEST).equals(whole), place
        except InputError:
            refused += 1
    assert refused > 10


BAD_ROWS = {
    "other rows: an arm": rows(0, 3)[:-1],
    "other rows: a pair twice": [*rows(0, 2), *rows(1, 1)],
    "other rows: another cell": [*rows(0, 2), *rows(2, 1, cell=3)],
    "other rows: other pairs": rows(3, 3),
    "other rows: the next part's as well": rows(0, 6),
    "other rows: none": [],
}


@pytest.mark.parametrize("what", BAD_ROWS)
def test_values_that_no_part_has_are_refused(tmp_path: Path, what: str) -> None:
    write(tmp_path, 0, BAD_ROWS[what])
    with pytest.raises(InputError, match=what.partition(":")[0]) as raised:
        read_cell(tmp_path, "episodes", 2, MANIFEST)
    assert not isinstance(raised.value, DamagedPartError)


@pytest.mark.parametrize("kind", [InputError, *InputError.__subclasses__()])
def test_a_refusal_from_elsewhere_is_of_the_same_class(kind: Any) -> None:
    error = kind("there", "is bad", "good", "goods")
    for same in (kind("here", *error.__reduce__()[1][1:]).at("there"), copy.copy(error)):
        assert (type(same), vars(same), str(same)) == (kind, vars(error), str(error))


def test_a_part_of_another_run_is_refused(tmp_path: Path) -> None:
    write(tmp_path, 0, rows(0, 3), digest="another run")
    refuses("belongs to another run", lambda: read_cell(tmp_path, "episodes", 2, MANIFEST))


def test_people_of_other_pairs_are_refused(tmp_path: Path) -> None:
    """A copy of another part under this name would count its people twice."""
    people = [
        {"cell": 2, "pair": pair, "arm": "av", "index": 0, "arrival_s": 1.0, "side": "near"}
        for pair in (0, 2)
    ]
    tables = {"episodes": EPISODES.of(rows(0, 3)), "pedestrians": PEDESTRIANS.of(people)}
    write_part(tmp_path, 2, 0, tables, "this run")
    assert read_cell(tmp_path, "pedestrians", 2, MANIFEST).num_rows == 2
    write(tmp_path, 3, rows(3, 3))
    part = tmp_path / "pedestrians" / part_name(2, 0)
    (tmp_path / "pedestrians" / part_name(2, 3)).write_bytes(part.read_bytes())
    refuses("other rows", lambda: read_cell(tmp_path, "pedestrians", 2, MANIFEST))


@given(pairs=st.integers(1, 200_000))
def test_the_size_of_a_part_depends_on_the_number_of_pairs_alone(pairs: int) -> None:
    size = part_pairs(pairs)
    assert -(-pairs // size) >= min(pairs, 4)
    assert pairs >= 20_000 or -(-pairs // size) <= 100
    assert size <= part_pairs(pairs + 1)


def manifest_in(folder: Path, model: InteractionModel) -> Any:
    base = load_scenario("cctc_flow", {"experiment.pairs": 40})
    study = Study("made up", base, (Cell(0, {}, base), Cell(1, {}, base)))
    made = manifest_of(study, [model, model], traces=False, engine="sumo", pairs_per_part=5)
    folders.write_manifest(folder, made)
    return made


def test_a_resumed_run_needs_its_versions_strategies_and_model() -> None:
    then: Any = {"versions": {"sumo": "1"}, "strategies": {"own:A": "x"}, "models": {"dut": "1"}}
    then |= {"files": {"town.net.xml": "1"}, "code": {"the rows": "1"}}
    refuse_changes(Path("run"), then, then)
    for part, now in (
        ("simulated with sumo 1, this is 2", then | {"versions": {"sumo": "2"}}),
        ("code of the rows has changed", then | {"code": {"the rows": "2"}}),
        ("own:A has been edited", then | {"strategies": {"own:A": "y"}}),
        ("town.net.xml has changed", then | {"files": {"town.net.xml": "2"}}),
        ("model other has changed", then | {"models": {"other": "1"}}),
    ):
        refuses(part, lambda now=now: refuse_changes(Path("run"), then, now))


def test_a_folder_is_one_runs(
    tmp_path: Path, model: InteractionModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert claim_folder(None, "cctc") == Path("runs/cctc-1")
    assert claim_folder(None, "cctc") == Path("runs/cctc-2")
    held = RunFolder(claim_folder("out", "cctc"))
    refuses("another process is working", lambda: RunFolder(Path("out")))
    held.close()
    # A run that ended before its manifest was written is no obstacle.
    assert claim_folder("out", "cctc") == Path("out")
    manifest_in(Path("out"), model)
    Path("full").mkdir()
    Path("full", "mine.txt").touch()
    for place, line in (
        ("out", "already holds a run.*harness.resume..out"),
        ("full", "is not empty"),
        ("full/mine.txt", "is a file"),
        ("full/mine.txt/below", "cannot be written"),
    ):
        refuses(line, lambda place=place: claim_folder(place, "cctc"))
    assert Path("full", "mine.txt").is_file()
    for error in (OSError(errno.ENOSPC, "it is full"), OSError("it is full")):
        monkeypatch.setattr(Path, "mkdir", Mock(side_effect=error))
        with pytest.raises(HarnessError, match=r"^out new: cannot be written \(it is full") as told:
            claim_folder("new", "cctc")
        assert not isinstance(told.value, InputError)  # the user's input is right


def test_findings_are_read_as_written(tmp_path: Path) -> None:
    cell = Cell(2, {"ego.length_m": 4.0}, Scenario())
    assert folders.read_findings(tmp_path, MANIFEST, [cell]) is None
    made = {
        "kappa": Finding(0.1, 0.0, 1 / 3, n=4, events=0, reliable=True),
        "mu": Finding(None, reason="no pair"),
        "odd": Finding(float("nan"), float("inf"), n=2),
    }
    found = CellFindings(2, cell.varied, cell.scenario, made)
    folders.write_findings(tmp_path, MANIFEST, [found])
    (again,) = folders.read_findings(tmp_path, MANIFEST, [cell]) or ()
    assert dict(again.findings) == dict(found.findings)
    head, row = (tmp_path / folders.SUMMARY).read_text().splitlines()
    summary = dict(zip(head.split(","), row.split(","), strict=True))
    assert (summary["ego.length_m"], summary["mu"], summary["mu_reason"]) == ("4.0", "", "no pair")


@pytest.mark.parametrize(
    "text", ["", "[1]", "null", '{"run": "this run"}', "edited", '{"2": {"mu": {"colour": 1}}}']
)
def test_findings_that_the_run_did_not_write_are_refused(tmp_path: Path, text: str) -> None:
    cell = Cell(2, {}, Scenario())
    found = CellFindings(2, {}, cell.scenario, {"mu": Finding(0.25)})
    path = tmp_path / FINDINGS
    folders.write_findings(tmp_path, MANIFEST, [found])
    assert folders.read_findings(tmp_path, MANIFEST, [cell]) == (found,)
    path.write_text(path.read_text().replace("0.25", "0.75") if text == "edited" else text)
    refuses(
        r'delete it; `harness\.resume\(".*computes it',
        lambda: folders.read_findings(tmp_path, MANIFEST, [cell]),
    )


@pytest.fixture
def half(tmp_path: Path, model: InteractionModel) -> Path:
    """A run of two cells of 40 pairs: 20 and 15 pairs, and a part behind a gap in each."""
    made = manifest_in(tmp_path, model)
    for cell, done in ((0, (0, 5, 10, 15, 30)), (1, (0, 5, 10, 35))):
        for first in done:
            of = EPISODES.of(rows(first, 5, cell=cell, delay_s=1.0))
            tables = {"episodes": of, "pedestrians": PEDESTRIANS.of([])}
            write_part(tmp_path, cell, first, tables, made["digest"])
    return tmp_path


def test_an_unfinished_run_has_the_pairs_before_the_first_gap(half: Path) -> None:
    """Those that finish first are the fast ones: what comes after a gap would flatter them."""
    run = load_run(half)
    assert not run.finished
    assert [cell["pairs"].value for cell in run.cells] == [20, 15]
    # The AV's time of pair i is 5.5 + i, the reference's 5 + i.
    assert run.cells[1]["time_s"].value == pytest.approx(5.5 + 7)
    run.episodes.insert(0, "ours", 0)
    assert [len(run.episodes), len(run.pairs), "ours" in run.episodes] == [2 * 35, 35, False]
    for cell in (-1, 2):
        refuses(f"cell {cell}: there is none; allowed: 0 to 1", lambda of=cell: run.scenario_of(of))
        refuses(f"cell {cell}: there is none", lambda of=cell: run.rows("episodes", of))
    first, *_, last = run.result().notes
    assert (first.key, "35 of 80 pairs are done" in first.text) == ("unfinished", True)
    # Its log is missing.
    assert "unknown how many" in last.text


@pytest.fixture
def whole(half: Path) -> Path:
    """The same run with all its parts, and its findings."""
    made = folders.read_manifest(half)
    for cell in (0, 1):
        for first in range(0, 40, 5):
            of = EPISODES.of(rows(first, 5, cell=cell, delay_s=1.0, pet_s=2.0))
            tables = {"episodes": of, "pedestrians": PEDESTRIANS.of([])}
            write_part(half, cell, first, tables, made["digest"])
    folders.write_findings(half, made, load_run(half).cells)
    return half


def test_findings_of_other_code_are_computed_again(
    whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, (first, second) = folders.read_manifest(whole), load_run(whole).cells
    odd = replace(first, findings={**first.findings, "mu": Finding(7.0)})
    folders.write_findings(whole, made, [odd, second])
    assert load_run(whole).cells[0]["mu"].value == 7.0  # as stored
    monkeypatch.setattr(folders, "code_digest", lambda: "of another version")
    run = load_run(whole)
    assert run.finished
    assert run.cells == (first, second)
    (whole / "episodes" / part_name(1, 5)).unlink()
    refuses("episodes are missing: cell 1, pair 5 to 9", lambda: load_run(whole))


def test_rows_of_older_code_are_told(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of tables with other columns are refused."""

    def notes() -> set[str]:
        run = load_run(whole)
        return {note.key for of in (run.result(), worst(run)) for note in of.notes[:1]}

    assert "older_code" not in notes()
    monkeypatch.setattr(folders, "code_of_rows", lambda: {"the rows": "later"})
    assert notes() == {"older_code"}
    other: Any = sealed({**folders.read_manifest(whole), "schema": "9"})
    folders.write_manifest(whole, other)
    refuses("tables with other columns; .*harness.run.*simulates", lambda: load_run(whole))


def test_other_thresholds_of_conflicts(whole: Path) -> None:
    runs = load_run(whole), load_run(whole, {"conflicts.pet_s": 2.5})
    shares = [[cell["conflict_pet"].value for cell in run.cells] for run in runs]
    assert shares == [[0.0, 0.0], [1.0, 1.0]]
    assert runs[1].manifest == runs[0].manifest
    refuses("settings experiment.pairs: cannot", lambda: load_run(whole, {"experiment.pairs": 3}))
    refuses("settings conflicts.pets: .*'pet_s'", lambda: load_run(whole, {"conflicts.pets": 3}))


@pytest.mark.parametrize("table", ["episodes", "pedestrians"])
@pytest.mark.parametrize(("first", "pairs"), [(0, "0 to 4"), (15, "15 to 19"), (35, "35 to 39")])
@pytest.mark.parametrize("renamed", [False, True])
def test_a_finished_run_that_lacks_a_part_is_refused(
    whole: Path, table: str, first: int, pairs: str, renamed: bool
) -> None:
    """It would have fewer pairs than it says; cell 0 is whole, and has them all."""
    part = whole / table / part_name(1, first)
    if renamed:
        part.rename(part.with_name(f"copy of {part.name}"))
    else:
        part.unlink()
    run = load_run(whole)
    assert run.finished
    assert run.rows("episodes", 0).num_rows == 2 * 40
    said = f"{table} are missing: cell 1, pair {pairs}; ", f'harness.resume("{whole}")'
    for pair in (None, first):
        refusal_of(lambda pair=pair: read_cell(whole, table, 1, run.manifest, pair), *said)
    refusal_of(lambda: getattr(run, table), *said)
