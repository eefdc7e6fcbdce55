"""Runs of simulations through `harness.run`, the command and the written files."""

import gzip
import json
import math
import re
import shutil
import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from harness.core.errors import EngineError
from harness.core.seeding import number_of, stream
from harness.core.vocabulary import Arm
from harness.engine.traffic_files import TRAFFIC_FILE
from harness.report.pictures import pictures_of
from harness.report.style import styled
from harness.results.loaded_run import Run, load_run
from harness.scenario import load_scenario
from harness.simulation.opening import vehicles_due
from harness.studies.page_content import page_content
from harness.studies.running import simulations
from harness.studies.running.replay import replay
from harness.studies.running.run import resume, run
from tests import faulty, towns
from tests.batches import content, here, printed, refusal
from tests.scenes import refuses

TABLES = ("arms", "passages", "vehicles", "people", "crosswalks")


def hour(folder: Path, *more: str) -> Path:
    """A scenario file with ``[traffic]`` that takes a second."""
    path = folder / "hour.toml"
    path.write_text(
        f"""ego = {{initial_speed_mps = 8.0, trigger_range_m = 30.0}}
pedestrians = {{flow_per_hour = 200.0, behaviour = "threshold"}}
arms = {{av = "gap_yield", human = "human_yield"}}
[traffic]
flow_per_hour = 400
oncoming_per_hour = 300
duration_s = 120
warm_up_s = 60
{chr(10).join(more)}
"""
    )
    return path


def own(folder: Path, config: str, crossing: str, *more: str) -> Path:
    """A scenario file with ``[simulation]``."""
    path, arms = folder / "own.toml", 'arms = {av = "gap_yield", human = "human_yield"}'
    simulation = f'[simulation]\nfile = "{config}"\ncrossings = ["{crossing}"]'
    path.write_text("\n".join([arms, simulation, *more]))
    return path


def rows(found: Run, name: str, cell: int = 0, **of: Any) -> list[dict[str, Any]]:
    """The rows of a table whose columns have these values; those of any cell look like cell 0's."""
    every = [{**row, "cell": 0} for row in found.rows(name, cell).to_pylist()]
    return [row for row in every if all(row[key] == value for key, value in of.items())]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Three pairs in this process."""
    folder = tmp_path_factory.mktemp("whole")
    return run(hour(folder), pairs=3, out=folder / "run", workers=0)


def test_the_written_file_of_a_pair_gives_the_same_passages_as_a_file_of_her_own(
    whole: Run, tmp_path: Path
) -> None:
    """And runs in plain SUMO without a warning."""
    config = min(whole.path.rglob(TRAFFIC_FILE))
    people = "[ego]\ntrigger_range_m = 30.0\n[pedestrians]\nflow_per_hour = 200.0\n"
    counted = 'av_types = ["car"]\nbegin_s = 60.0\nend_s = 180.0'
    file = own(tmp_path, str(config), ":crosswalk_c0", counted, f'{people}behaviour = "threshold"')
    again = run(file, pairs=1, out=tmp_path / "own", workers=0)
    assert len(rows(again, "passages")) > 30
    assert len(rows(again, "people")) > 5
    for name in TABLES[1:]:
        assert rows(whole, name, pair=0) == rows(again, name)
    trips = tmp_path / "trips.xml"
    words = ("-c", str(config), "--tripinfo-output", str(trips), "--no-step-log")
    assert not towns.call(tmp_path, "sumo", *words)
    due = [*vehicles_due(load_scenario(hour(tmp_path)), 0)]
    assert trips.read_text().count("<tripinfo ") == len(due)


def test_the_same_rows_and_files_in_two_workers(whole: Run, tmp_path: Path) -> None:
    other = run(hour(tmp_path), pairs=3, out=tmp_path / "run", workers=2)
    assert content(other.path) == content(whole.path)


def test_vehicles_are_drawn_from_streams_that_no_share_or_arm_changes(tmp_path: Path) -> None:
    few = load_scenario(hour(tmp_path, "av_share = 0.2"))
    many = load_scenario(hour(tmp_path, "av_share = 0.9"), {"arms.av": "hard_yield"})
    assert [*vehicles_due(few, 3)] == [*vehicles_due(many, 3)]
    assert [*vehicles_due(few, 3)] != [*vehicles_due(few, 4)]
    first = next(iter(vehicles_due(few, 3)))
    # The first headway of a lane is exponential: its rate r has r = q/(1 − q h).
    uniform = stream(few.experiment.seed, "vehicle_arrival", 3, 0, 0).random()
    per_s, least_s = 400 / 3600, few.least_headway_s()
    wait_s = -math.log1p(-uniform) / (per_s / (1 - per_s * least_s))
    assert first.depart_s - 0.1 < wait_s <= first.depart_s + 1e-9


def test_cells_that_differ_in_the_av_share_the_reference(whole: Run, tmp_path: Path) -> None:
    drivers = {"arms.av": ["hard_yield", "gap_yield"]}
    found = run(hour(tmp_path), vary=drivers, pairs=1, out=tmp_path / "run", workers=0)
    for name in TABLES:
        assert rows(found, name, 0, arm="human") == rows(found, name, 1, arm="human")
        assert rows(found, name, 1) == rows(whole, name, pair=0)
    assert rows(found, "passages", 0, arm="av") != rows(found, "passages", 1, arm="av")


@pytest.mark.parametrize(("share", "side", "sign"), [(1.0, "near", 1), (0.0, "far", -1)])
def test_people_come_from_the_kerb_of_the_share(
    tmp_path: Path, share: float, side: str, sign: int
) -> None:
    """The near kerb is on the right of the vehicles of the way forward: at (3.264, 3.098) m."""
    settings = {"pedestrians.near_side_share": share}
    found = run(hour(tmp_path), settings=settings, pairs=1, out=tmp_path / "run", workers=0)
    assert {row["side"] for row in rows(found, "people")} == {side}
    printed("replay", found.path, "--pair", 0, "--arm", "av", "--out", tmp_path / "again")
    seen = ET.fromstring(gzip.decompress((tmp_path / "again" / "fcd.xml.gz").read_bytes()))
    states = ([each.attrib[name] for name in ("id", "x", "y")] for each in seen.iter("person"))
    first = {name: complex(float(x), float(y)) for name, x, y in reversed([*states])}
    assert len(first) > 5
    # A step after they set off.
    assert max(abs(place - sign * (3.264 + 3.098j)) for place in first.values()) < 2.5


FAILED_AT = "forward-0-9"
"""A vehicle of pair 1, in the counted time."""


@pytest.mark.parametrize(("fault", "reason"), [("raises", "on purpose"), ("aborts", "died")])
def test_a_failure_costs_its_arm_alone(tmp_path: Path, fault: str, reason: str) -> None:
    drawn = stream(1, "av_strategy", 1, number_of(FAILED_AT)).random()
    settings = {"arms.av": faulty.NAME, f'strategies."{faulty.NAME}".{fault}': float(drawn)}
    found = run(hour(tmp_path), settings=settings, pairs=2, out=tmp_path / "run", workers=1)
    arms = rows(found, "arms")
    assert [row["reason"] is None for row in arms] == [True, True, False, True]
    assert (arms[2]["failed_in"], reason in arms[2]["reason"]) == ("strategy", True)
    assert fault == "aborts" or FAILED_AT in arms[2]["reason"]
    assert found.failures == ((0, 1, "av", arms[2]["reason"]),)
    assert "failed arms: 1; the first: cell 0 pair 1" in here("show", found.path).stderr
    known = {key for key, value in arms[2].items() if value is not None}
    assert known == {"cell", "pair", "arm", "reason", "failed_in"}
    for name in TABLES[1:]:
        there = {(row["pair"], row["arm"]) for row in rows(found, name)}
        assert there == {(0, "av"), (0, "human"), (1, "human")}


def test_a_pair_that_cannot_be_opened_has_failed(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(simulations, "opened_traffic", Mock(side_effect=EngineError("it died")))
    found = rows(run(hour(tmp_path), pairs=1, out=tmp_path / "run", workers=0), "arms")
    assert {(row["reason"], row["failed_in"]) for row in found} == {("it died", "engine")}


def test_a_pair_without_its_last_table_is_simulated_again(whole: Run, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(whole.path, tmp_path / "run"))
    (folder / "arms" / "0000-00000001.parquet").unlink()
    (folder / "passages" / "0000-00000002.parquet").write_bytes(b"cut off")
    begun: list[int] = []
    resume(folder, workers=0, progress=lambda done, _: begun.append(done))
    assert begun == [2, 3]
    assert content(folder) == content(whole.path)


def test_all_pairs_of_a_run_have_the_same_files(tmp_path: Path) -> None:
    config = towns.grid(tmp_path, end_s=60)
    file = own(tmp_path, config.name, USABLE, "[experiment]\npairs = 2")
    trips = tmp_path / "vehicles.trips.xml"

    def edit(*_: int) -> None:
        trips.write_text(re.sub("<trip [^>]*/>", "", trips.read_text(), count=1))

    edited = partial(run, file, out=tmp_path / "edited", workers=0, progress=edit)
    refuses(r"vehicles.trips.xml: has changed since the run began", edited)
    with pytest.raises(KeyboardInterrupt):
        run(file, out=tmp_path / "run", workers=0, progress=_stop)
    edit()
    refuses(r"vehicles.trips.xml has changed", lambda: resume(tmp_path / "run", workers=0))
    (again,) = replay(load_run(tmp_path / "run"), 0, range(1), [Arm.AV], tmp_path / "again")
    assert again.differences[0].endswith("vehicles.trips.xml has changed since the run")
    net = tmp_path / "net.net.xml"
    assert "roads" not in said_of_the_map(tmp_path / "run")
    net.write_text(net.read_text() + "<!-- new -->")
    assert "The roads are those of now: " in said_of_the_map(tmp_path / "run")
    net.unlink()
    assert "cannot be read: " in said_of_the_map(tmp_path / "run")


def said_of_the_map(folder: Path) -> str:
    with styled():
        pictures = [*pictures_of(page_content(folder))]
    (said,) = [caption for picture, caption, _ in pictures if picture.name == "map"]
    return said


def _stop(*_: int) -> None:
    raise KeyboardInterrupt


USABLE = ":B1_c0"
NOWHERE = '<trip id="x" depart="50" from="A0A1" to="no"/></routes>'
HOSTILE = {
    "a route to nowhere": ("vehicles.trips.xml", "</routes>", NOWHERE, "town.sumocfg: .*edge 'no'"),
    "random seeds": ("", "</configuration>", '<random value="true"/></configuration>', ""),
    # As SUMO has them by default.
    "Euler's steps of a second": ("", 'step-length value="0.1"', 'step-length value="1"', ""),
    "teleports": ("", 'action value="warn"', 'action value="teleport"', ""),
    "a person's name": ("people.trips.xml", '<person id="', '<person id="own:', "person is named"),
}
"""The file, or else the configuration; what is put in whose place; how it is refused, if it is."""
HARNESS_PEOPLE = "[pedestrians]\nflow_per_hour = 99\nwalking_speed = {mean_mps = 1, std_mps = 0.1}"


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_configuration_is_refused_in_one_line_or_works(tmp_path: Path, name: str) -> None:
    config = towns.grid(tmp_path, end_s=60)
    spoilt, find, replace, refused = HOSTILE[name]
    path = tmp_path / spoilt if spoilt else config
    text = path.read_text()
    assert find in text
    path.write_text(text.replace(find, replace))
    file = own(tmp_path, config.name, USABLE, HARNESS_PEOPLE)
    if refused:
        refuses(refused, lambda: run(file, pairs=1, out=tmp_path / "run", workers=0))
        assert not (tmp_path / "run").exists()
        return
    found = [run(file, pairs=1, out=tmp_path / str(n), workers=0) for n in range(2)]
    assert rows(found[0], "arms")[0]["reason"] is None
    assert rows(found[0], "passages") == rows(found[1], "passages") != []


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a town with a scenario that ``harness crossings`` wrote."""
    folder = tmp_path_factory.mktemp("town")
    config = towns.grid(folder, end_s=60)
    printed("crossings", config, "--write", folder / "town.toml", "--edge", USABLE)
    return folder


def test_crossings_lists_who_passes_and_all_with_reasons(town: Path) -> None:
    few, every = (printed("crossings", town / "town.sumocfg", *more) for more in ([], ["--all"]))
    assert USABLE in few
    # The reasons of a narrow screen are wrapped.
    assert "controls it" not in few
    assert "controls it" in every
    write = ("crossings", town / "town.sumocfg", "--write")
    assert "a traffic light controls it" in refusal(*write, town / "no.toml", "--edge", ":C2_c0")
    assert "exists; allowed: a new file" in refusal(*write, town / "town.toml", "--edge", USABLE)
    assert not (town / "no.toml").exists()


def test_a_written_scenario_runs_and_its_worst_passage_is_replayed(
    town: Path, tmp_path: Path
) -> None:
    printed("run", town / "town.toml", "--pairs", 1, "--out", tmp_path / "run", "-q")
    by_delay = ("worst", tmp_path / "run", "--by", "delay_s", "--driver")
    worst = json.loads(printed(*by_delay, "av", "--json"))
    assert {row["driver"] for row in worst["records"]} == {"gap_yield"}
    assert "the simulation ended" not in {row["ended"] for row in worst["records"]}
    refusal(*by_delay, "reference")
    out = tmp_path / "again"
    told = printed("replay", tmp_path / "run", "--pair", 0, "--arm", "av", "--out", out)
    assert "is the stored one" in told
    # Who drove is in SUMO's own file: the least speed of a vehicle is in it.
    places = gzip.decompress((out / "fcd.xml.gz").read_bytes()).decode()
    assert f'id="{worst["records"][0]["vehicle"]}"' in places


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        ({"simulation.crossings": [":C2_c0"]}, "a traffic light controls it"),
        ({"simulation.av_types": ["bus"]}, "unknown vehicle type or class 'bus'"),
        ({"simulation.end_s": 100.0}, "simulation.end_s: 100 s; .* within 0 to 60 s"),
        ({"simulation.begin_s": 9.0, "simulation.end_s": 9.0}, "end_s: 9 s; .* after .*begin_s"),
        ({"ego.trigger_range_m": 10.0}, "nobody stops within 10 m from 13.89 m/s"),
        ({"pedestrians.flow_per_hour": 100.0}, "sumo_driver passes people of the harness"),
        ({"arms.av": "exec:./driver"}, "a program drives one vehicle"),
        ({"pedestrians.flow_per_hour": 9.0, "arms.human": "human_yield"}, "limit before :B1_c0"),
        ({"traffic.av_share": 1.0}, r"traffic.av_share: cannot be combined with \[simulation\]"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_is_written(
    town: Path, tmp_path: Path, settings: dict[str, Any], line: str
) -> None:
    options: dict[str, Any] = {"settings": settings, "pairs": 1, "out": tmp_path / "run"}
    refuses(line, lambda: run(town / "town.toml", workers=0, **options))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "more",
    [
        ["[crossing]", "oncoming_lanes = 0", "lanes = 2", "lane_width_m = 4.0"],
        ["saturated = true"],
        ['following = "IDM"'],
    ],
)
def test_every_road_is_driven(tmp_path: Path, more: list[str]) -> None:
    flows = {"traffic.flow_per_hour": 600.0, "traffic.oncoming_per_hour": 600.0}
    flows |= {"traffic.oncoming_per_hour": 0.0} if "[crossing]" in more else {}
    found = run(hour(tmp_path, *more), settings=flows, pairs=1, out=tmp_path / "run", workers=0)
    assert not found.failures
    for arm, driver in (("av", "gap_yield"), ("human", "human_yield")):
        passed = [row for row in rows(found, "passages") if row["arm"] == arm]
        assert {row["type"] for row in passed} == {"car"}
        assert all(row["driven"] for row in passed)
        assert {row["driver"] for row in passed if row["automated"]} == {driver}
        assert all(row["automated"] for row in rows(found, "vehicles", arm=arm))
