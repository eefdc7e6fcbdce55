"""``harness conflicts`` on SUMO's own outputs: formats, joins, collisions, replays."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import sumo as sumo_package

import harness
from harness.core.encounter import Arm
from harness.measures.catalogue import COLUMNS
from harness.old.studies.conflicts import ConflictFindings, find_conflicts
from harness.old.studies.conflicts.vehicle_types import CLASSES
from harness.studies.replay import replay
from tests import towns
from tests.batches import printed, refusal

HOME = Path(sumo_package.SUMO_HOME)
ZEBRAS = ("6 10#1 -10#1", "9 -11#2 11#2")
GUESSED = ("6 -10#0 10#0", "7 -10#2 10#2", "8 -11#0 11#0", "8 11#1 -11#1", "9 11#3 -11#3")

pytestmark = pytest.mark.usefixtures("no_simulation")


def tool(*words: object) -> None:
    env = {**os.environ, "SUMO_HOME": str(HOME), "PROJ_DATA": str(HOME / "data" / "proj")}
    subprocess.run([*map(str, words)], env=env, check=True, timeout=300, capture_output=True)


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four arms with vehicles and people by randomTrips, as a folder with ``simulate``'s files."""
    folder = tmp_path_factory.mktemp("town")
    towns.of_map("four_arms", ZEBRAS, GUESSED, folder)
    (folder / "net.net.xml").rename(folder / "town.net.xml")
    for name, seed, options in (
        ("cars", 1, ["--fringe-factor", 10]),
        ("people", 2, ["--pedestrians"]),
    ):
        tool(
            sys.executable, HOME / "tools" / "randomTrips.py", "-n", folder / "town.net.xml",
            "-o", folder / f"{name}.xml", "-r", folder / f"{name}.rou.xml",
            "-e", 240, "-p", 1, "--seed", seed, *options,
        )  # fmt: skip
    return folder


def simulate(town: Path, name: str, *options: object, end_s: int = 300) -> Path:
    """SUMO's FCD output of the town, by the file's name."""
    path = town / name
    tool(
        HOME / "bin" / "sumo", "-n", town / "town.net.xml",
        "-r", f"{town / 'cars.xml'},{town / 'people.xml'}", "-e", end_s, "--step-length", 0.1,
        "--no-step-log", "--no-warnings", "--fcd-output", path, *options,
    )  # fmt: skip
    return path


def found(town: Path, *files: Path) -> ConflictFindings:
    return find_conflicts(files, town / "town.net.xml")


def rows(findings: ConflictFindings) -> pd.DataFrame:
    """The table of passages; the quotient of a standing vehicle's R and v says nothing."""
    table = pd.DataFrame([each.row() for each in findings.passages])
    return table.assign(min_time_advantage_s=table["min_time_advantage_s"].clip(upper=100.0))


@pytest.fixture(scope="module")
def exact(town: Path) -> ConflictFindings:
    collisions = (
        "--collision.check-junctions", "true", "--collision.mingap-factor", 0,
        "--collision.action", "warn", "--collision-output", town / "collisions.xml",
    )  # fmt: skip
    return found(town, simulate(town, "exact.csv", "--precision", 6, *collisions))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fcd.parquet", "fcd.xml", "fcd.xml.gz", "fcd.csv.gz"])
def test_every_format_has_the_same_passages(town: Path, exact: ConflictFindings, name: str) -> None:
    other = rows(found(town, simulate(town, name, "--precision", 6)))
    # Parquet has places and speeds of the vehicles in single precision.
    pd.testing.assert_frame_equal(other, rows(exact), rtol=1e-4, atol=1e-3, check_dtype=False)


@pytest.mark.parametrize("ending", ["parquet", pytest.param("xml", marks=pytest.mark.slow)])
def test_people_in_a_file_of_their_own(town: Path, exact: ConflictFindings, ending: str) -> None:
    people = town / f"people_apart.{ending}"
    cars = simulate(town, f"cars_apart.{ending}", "--precision", 6, "--person-fcd-output", people)
    other = rows(found(town, cars, people))
    pd.testing.assert_frame_equal(other, rows(exact), rtol=1e-4, atol=1e-3, check_dtype=False)


@pytest.mark.slow
def test_longitudes_and_latitudes(town: Path, exact: ConflictFindings) -> None:
    geo = found(town, simulate(town, "geo.csv", "--fcd-output.geo", "--precision.geo", 9))
    assert geo.geo
    assert not exact.geo
    assert (exact.motion, exact.by_places) == ("euler", False)
    here, there = rows(exact), rows(geo)
    assert list(here["vehicle"]) == list(there["vehicle"])
    # Two decimals of the vehicles' places and speeds: 1 cm at 1 m/s.
    assert (here["pet_s"] - there["pet_s"]).abs().median() < 0.01


@pytest.mark.parametrize(
    ("options", "motion", "by_places"),
    [
        (("--step-method.ballistic", "true"), "ballistic", False),
        (("--device.fcd.period", 1), "euler", True),
    ],
)
def test_the_file_says_how_vehicles_moved(
    town: Path, options: tuple[object, ...], motion: str, by_places: bool
) -> None:
    findings = found(town, simulate(town, "moved.csv", *options, end_s=60))
    assert (findings.motion, findings.by_places) == (motion, by_places)


def test_every_vehicle_is_accounted_for(town: Path, exact: ConflictFindings) -> None:
    """Whoever drives over a crosswalk's junction on its edges is measured or counted."""
    fcd = pd.read_csv(town / "exact.csv", sep=";", dtype=str)
    lanes = fcd[fcd["vehicle_lane"].notna()]
    at_7 = next(each for each in exact.crosswalks if each.crosswalk.id == ":7_c0")
    pairs = {(way.from_edge, way.to_edge) for way in at_7.crosswalk.ways}
    passed = 0
    for _, own in lanes.groupby("vehicle_id"):
        edges = own["vehicle_lane"].str.rpartition("_")[0]
        roads = edges[~edges.str.startswith(":")]
        driven = roads[roads != roads.shift()].tolist()
        passed += sum((a, b) in pairs for a, b in pairwise(driven))
    assert passed == len(at_7.passages) + sum(at_7.not_measured.values())
    assert passed > 50


def test_every_collision_of_sumo_on_a_straight_way_is_a_contact(
    town: Path, exact: ConflictFindings
) -> None:
    """SUMO's people and drivers touch at crossings; its verdict comes at the step's end."""
    lanes = {
        (way.crosswalk, way.approach): {lane.lane for lane in way.lanes if abs(lane.start_m) < 20}
        for crosswalk in exact.crosswalks
        for way in crosswalk.crosswalk.ways
        if way.is_straight(5.0)
    }
    confirmed = 0
    for collision in ET.parse(town / "collisions.xml").getroot().iter("collision"):
        time_s, lane = float(collision.attrib["time"]), collision.attrib["lane"]
        passages = [
            each
            for each in exact.passages
            if each.vehicle == collision.attrib["collider"]
            and lane in lanes[each.crosswalk, each.approach]
        ]
        if passages:
            assert collision.attrib["victim"] in [
                each.people[each.record.contact_index]
                for each in passages
                if each.record.contact_index is not None
                and each.record.contact_time_s is not None
                and each.begin_s + each.record.contact_time_s <= time_s + 1e-6
            ]
            confirmed += 1
    assert confirmed


def test_the_classes_are_those_of_sumo(town: Path, tmp_path: Path) -> None:
    types = "".join(f'<vType id="x_{name}" vClass="{name}"/>' for name in CLASSES)
    (tmp_path / "t.xml").write_text(f"<additional>{types}</additional>")
    script = (
        "import sys, libsumo\n"
        "libsumo.start(['sumo', '-n', sys.argv[1], '-a', sys.argv[2], '--no-step-log'])\n"
        "t = libsumo.vehicletype\n"
        "for i in t.getIDList():\n"
        "    if i.startswith('x_'):\n"
        "        print(i[2:], t.getLength(i), t.getWidth(i), t.getAccel(i), t.getDecel(i),\n"
        "              t.getMaxSpeed(i))\n"
    )
    words = [sys.executable, "-c", script, town / "town.net.xml", tmp_path / "t.xml"]
    done = subprocess.run(
        [*map(str, words)], check=True, capture_output=True, text=True, timeout=120
    )
    checked = 0
    for line in done.stdout.splitlines():
        name, *numbers = line.split()
        if name not in CLASSES:
            continue
        kind = CLASSES[name]
        own = (
            kind.length_m, kind.width_m, kind.acceleration_mps2, kind.deceleration_mps2,
            kind.max_speed_mps,
        )  # fmt: skip
        assert own == pytest.approx([float(number) for number in numbers], abs=1e-4), name
        checked += 1
    assert checked == len(CLASSES)


UNKNOWN = {
    # FCD has no driver's own speed, and nobody who waits and never goes.
    "delay_s", "pedestrian_delay_s", "arrivals",
}  # fmt: skip


def test_a_replay_has_the_stored_measures(tmp_path: Path) -> None:
    settings = {"pedestrians.flow_per_hour": 900.0, "arms.av": "hard_yield"}
    run = harness.run("cctc_flow", pairs=4, settings=settings, out=tmp_path / "run", workers=1)
    stored = run.episodes.set_index(["pair", "arm"])
    types = tmp_path / "types.xml"
    vehicle = run.scenario_of(0).vehicle()
    types.write_text(
        f'<routes><vType id="ego" length="{vehicle.length_m}" width="{vehicle.width_m}" '
        f'decel="{vehicle.max_deceleration_mps2}"/></routes>'
    )
    compared = 0
    for (pair, arm), row in stored.iterrows():
        if row["pedestrians"] == 0:
            continue
        out = tmp_path / f"{pair}-{arm}"
        (done,) = replay(run, 0, range(pair, pair + 1), [Arm(arm)], out)
        assert done.differences == ()
        findings = find_conflicts([out / "fcd.xml"], out / "site.net.xml", types=[types])
        (passage,) = findings.passages
        assert findings.motion == "ballistic"
        assert passage.record.ending == row["ending"]
        assert (passage.record.contact is None) == pd.isna(row["contact"])
        for name in set(COLUMNS) - UNKNOWN:
            value = getattr(passage.record, name)
            if value is None or pd.isna(row[name]):
                assert value is None
                assert pd.isna(row[name]), name
                continue
            # Six decimals: a deceleration is off by 1e-6/0.1 s, jerk by that over 0.1 s.
            off = {"max_deceleration_mps2": 2e-5, "max_jerk_mps3": 4e-4, "rms_jerk_mps3": 4e-4}.get(
                name, 2e-5
            )
            assert value == pytest.approx(float(row[name]), abs=off), (pair, arm, name)
        compared += 1
    assert compared > 3


def test_the_command_names_what_it_wrote(town: Path, exact: ConflictFindings) -> None:
    out = town / "conflicts"
    net = town / "town.net.xml"
    text = printed("conflicts", town / "exact.csv", "--net", net, "--out", out, "--full")
    assert f"{len(exact.passages)} passages" in text
    assert "turning" in text
    table = pd.read_csv(out / "crosswalks.csv")
    assert table["passages"].sum() == len(exact.passages)
    assert len(pd.read_parquet(out / "passages.parquet")) == len(exact.passages)


def test_pet_by_the_places_of_the_vehicles_alone(town: Path, exact: ConflictFindings) -> None:
    """The vehicle's x and y every 2 ms, without lanes, lengths of lanes or the way's frame."""
    fcd = pd.read_csv(town / "exact.csv", sep=";", dtype={"vehicle_id": str})
    of_cars = fcd["vehicle_lane"].notna()
    cars, people = (dict(list(fcd[of].groupby("vehicle_id"))) for of in (of_cars, ~of_cars))
    off = []
    for each in exact.passages:
        record, trace = each.record, each.trace
        if record.pet_s is None or record.pet_s > 3.0 or record.pass_time_s is None:
            continue
        time_s = np.arange(each.begin_s - 1, each.begin_s + record.end_s + 15, 0.002)
        car = place(cars[each.vehicle], time_s)
        at = int(np.argmin(abs(time_s - each.begin_s - record.pass_time_s + 1)))
        heading = (car[at + 200] - car[at - 200]) / abs(car[at + 200] - car[at - 200])
        driven = ((car - car[at]) * heading.conjugate()).real
        pets = []
        for walk in trace.walks:
            assert walk.start_s is not None
            assert walk.legs is not None
            seen = (place(people[each.people[walk.arrival.index]], time_s) - car[at]) / heading
            since_s = time_s - each.begin_s
            on = (since_s >= walk.start_s) & (since_s <= walk.legs[-1].time_s)
            zone = on & (abs(seen.imag) < 0.9 + 0.25)
            if walk.start_s >= record.end_s or not zone.any():
                continue
            first, last = seen.real[zone].min() - 0.25, seen.real[zone].max() + 5.0 + 0.25
            if driven.max() < last:
                continue
            enters, leaves = time_s[driven >= first][0], time_s[driven >= last][0]
            before = enters - time_s[zone][-1]
            pets.append(before if before >= 0 else max(0.0, time_s[zone][0] - leaves))
        off += [abs(min(pets) - record.pet_s)] if pets else []
    assert len(off) > 20
    assert max(off) < 0.03


def place(states: pd.DataFrame, time_s: np.ndarray) -> np.ndarray:
    """East + i north at some times."""
    known = states["timestep_time"].to_numpy()
    east, north = (np.interp(time_s, known, states[f"vehicle_{of}"]) for of in "xy")
    return np.asarray(east + 1j * north)


def test_thresholds_are_set(town: Path, exact: ConflictFindings) -> None:
    """The counts are those of the passages' own measures."""
    command = ("conflicts", town / "exact.csv", "--net", town / "town.net.xml", "--out")
    text = printed(*command, town / "other", "--set", "conflicts.ttc_s=3", "--full")
    assert "TTC < 3 s" in text
    table = pd.read_csv(town / "other" / "crosswalks.csv")
    met = [each for each in exact.passages if each.record.pedestrians]
    below = [
        each.record.contact is not None
        or (each.record.min_ttc_s is not None and each.record.min_ttc_s < 3)
        for each in met
    ]
    assert table["conflicts_ttc"].sum() == sum(below)
    default = sum(each.row(exact.thresholds)["conflicts_ttc"] for each in exact.crosswalks)
    assert sum(below) > default
    for wrong, words in (("conflicts.ttc=3", "conflicts.ttc_s"), ("conflicts.ttc_s=x", "ttc_s")):
        assert words in refusal(*command, town / "wrong", "--set", wrong)
        assert not (town / "wrong").exists()
