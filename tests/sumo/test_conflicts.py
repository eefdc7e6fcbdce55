"""``harness conflicts``: by hand, and on SUMO's own outputs in every format."""

import gzip
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.core.files import shipped_directory
from harness.site.town import Town
from tests import towns
from tests.batches import printed, refusal

pytestmark = pytest.mark.usefixtures("no_simulation")

NET = next(shipped_directory("networks").glob("cctc/*.net.xml"))
ZEBRAS = ("6 10#1 -10#1", "9 -11#2 11#2")
GUESSED = ("6 -10#0 10#0", "7 -10#2 10#2", "8 -11#0 11#0", "8 11#1 -11#1", "9 11#3 -11#3")
TYPES = '<routes><vType id="bus" vClass="bus" width="2.0"/><vType id="x"/></routes>'


def measured(*words: object, table: Path) -> pd.DataFrame:
    """The passages that the command writes."""
    printed("conflicts", *words, "--table", table)
    return pd.read_csv(table, dtype={"vehicle": str, "contact_person": str, "type": str})


# By hand, on the CCTC network: the crosswalk is 9 m long and 4 m wide, the lane's centre at 2.25 m.


def recording(start_s: float = 2.0, step_s: float = 0.5, people: str = "p") -> str:
    """5 m/s from 60 m before the centre on; from the near kerb at 1.5 m/s after ``start_s``."""
    town = Town.read(NET)
    (crosswalk,) = town.crosswalks.values()
    link = next(each for each in town.connections(crosswalk.id) if each.from_lane[:4] == "appr")
    lanes = [town.lane(name) for name in (link.from_lane, *link.via, link.to_lane)]
    before, stop = (complex(*point) for point in lanes[0].shape[-2:])
    ahead = (stop - before) / abs(stop - before)
    ends = [complex(*point[:2]) for point in (crosswalk.axis.coords[0], crosswalk.axis.coords[-1])]
    near, far = sorted(ends, key=lambda end: ((end - stop) / ahead).imag)  # the right one first
    beyond_m = (((near + far) / 2 - stop) / ahead).real
    steps = []
    for number in range(round(20 / step_s)):
        time_s = number * step_s
        at_m, on = lanes[0].length_m + beyond_m - 60.0 + 5.0 * time_s, 0
        while at_m >= lanes[on].length_m:
            at_m, on = at_m - lanes[on].length_m, on + 1
        walked_m = max(-0.4, min(1.5 * (time_s - start_s), 9.4))
        place = near + walked_m * (far - near) / abs(far - near)
        edge = crosswalk.id if 0 <= walked_m <= 9 else town.areas(crosswalk.id)[0]
        where = f'x="{place.real:.4f}" y="{place.imag:.4f}" edge="{edge}"'
        who = "".join(
            f'<person id="{name}" {where} type="w" speed="1" pos="0"/>' for name in people
        )
        steps.append(
            f'<timestep time="{time_s:.2f}"><vehicle id="v" x="0" y="0" angle="0" type="bus@v" '
            f'speed="5.0" pos="{at_m:.4f}" lane="{lanes[on].lane}"/>{who}</timestep>\n'
        )
    return f"<fcd-export>\n{''.join(steps)}</fcd-export>\n"


@pytest.fixture
def fcd(tmp_path: Path) -> Path:
    path = tmp_path / "fcd.xml"
    path.write_text(recording())
    return path


def test_the_measures_of_a_recording(fcd: Path, tmp_path: Path) -> None:
    types = tmp_path / "types.add.xml"
    types.write_text(TYPES)
    (row,) = measured(fcd, "--net", NET, "--types", types, table=tmp_path / "t.csv").to_dict(
        "records"
    )
    assert (row["crosswalk"], row["vehicle"], row["type"]) == (":crosswalk_c0", "v", "bus@v")
    assert (row["manoeuvre"], row["pedestrians"], row["ended"]) == ("straight", 1, "passed")
    # The front is 50 m before the centre after 2 s, at the near edge, 2 m before it, after 11.6 s.
    assert row["trigger_s"] == pytest.approx(2.0, abs=1e-3)
    assert row["front_s"] == pytest.approx(11.6, abs=1e-3)
    # 50 m, 2 m to the far edge and 12 m of bus.
    assert row["rear_s"] == pytest.approx(2.0 + 64 / 5, abs=1e-3)
    # They leave the zone at 2.25 + 1.0 + 0.25 = 3.5 m; the front enters it at −0.25 m, at 11.95 s.
    assert row["pet_s"] == pytest.approx(11.95 - (2.0 + 3.5 / 1.5), abs=2e-3)


def test_a_contact_and_who_met_whom(tmp_path: Path) -> None:
    fcd = tmp_path / "fcd.xml.gz"
    # At y = 2.25 m when the front is 0.25 m before them, at 11.95 s; two people side by side.
    fcd.write_bytes(gzip.compress(recording(11.95 - 1.5, people="pq").encode()))
    words = ("conflicts", fcd, "--net", NET)
    (row,) = measured(*words[1:], table=tmp_path / "t.csv").to_dict("records")
    assert row["contact_person"] == "p"
    assert row["contact_speed_mps"] == pytest.approx(5.0)
    assert row["pass_time_s"] != row["pass_time_s"]
    found = json.loads(printed(*words, "--json"))
    every, here = found["records"]
    assert every == {**here, "crosswalk": "all"}
    assert [every[name] for name in ("people", "passages", "contacts", "PET")] == [2, 1, 1, 1]
    # Nobody said what a bus is.
    assert "bus@v" in " ".join(note["text"] for note in found["notes"])


Change = Callable[[str], str]
REFUSED: Mapping[str, tuple[Change, str]] = {
    "cut": (lambda text: text[:4000], "is cut off"),
    "people": (lambda text: re.sub("<person.*?/>", "", text), "0 of 0 people"),
    "vehicles": (lambda text: re.sub("<vehicle.*?/>", "", text), "0 of 0 vehicles"),
    "pos": (lambda text: text.replace(' pos="', ' at="'), "is damaged (KeyError: 'pos'"),
    "speed": (lambda text: text.replace('speed="5', 'speed="five'), "is damaged"),
    "net": (lambda text: text.replace('lane="', 'lane="other'), "is not in the network"),
    "crossing": (lambda text: text.replace("crosswalk_c0", "x_c0"), "0 of 1 people"),
    "places": (lambda text: re.sub(r'( y="[-\d]+)', r"\g<1>9", text), "0 of 1 people"),
    "root": (lambda text: text.replace("fcd-export", "net"), "its first element is <net>"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_recording_that_is_refused(fcd: Path, name: str) -> None:
    change, words = REFUSED[name]
    fcd.write_text(change(fcd.read_text()))
    assert words in refusal("conflicts", fcd, "--net", NET)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--edge", ":croswalk_c0"), "did you mean ':crosswalk_c0'"),
        (("--types", "none.xml"), "none.xml: cannot be read"),
        (("--types", NET), "defines no vehicle type"),
        (("--set", "conflicts.ttc=3"), "conflicts.ttc_s"),
        (("--person-fcd", "none.xml"), "none.xml: no such file"),
    ],
)
def test_an_option_that_is_refused(fcd: Path, more: tuple[object, ...], words: str) -> None:
    assert words in refusal("conflicts", fcd, "--net", NET, *more)


# SUMO's own outputs of a town in which most vehicles turn.


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("town")
    lines = [f'<crossing node="{of[0]}" edges="{of[2:]}" priority="1" width="4"/>' for of in ZEBRAS]
    lines += [f'<crossing node="{of[0]}" edges="{of[2:]}" discard="true"/>' for of in GUESSED]
    (folder / "c.con.xml").write_text(f"<connections>{''.join(lines)}</connections>")
    osm = str(Path(__file__).parents[1] / "data/town/four_arms.osm")
    words = ("--osm.sidewalks", "--osm.crossings", "--sidewalks.guess", "--crossings.guess")
    finely = ("--output.street-names", "--precision", "6")
    towns.call(folder, "netconvert", "--osm-files", osm, *words, *finely, "-o", "all.net.xml")
    patch = ("-x", "c.con.xml", *finely, "-o", "net.net.xml")
    towns.call(folder, "netconvert", "-s", "all.net.xml", *patch)
    net, until = folder / "net.net.xml", ("-e", "240", "--seed")
    towns.random_trips(folder, net, "cars.xml", 1.0, *until, "1", "--fringe-factor", "10")
    towns.random_trips(folder, net, "people.xml", 1.0, *until, "2", "--pedestrians")
    files = {"net-file": "net.net.xml", "route-files": "cars.xml,people.xml", "end": "300"}
    towns.write_config(folder, {**files, "step-length": "0.1", **towns.COLLISIONS})
    output(folder, "exact.xml", "--collision-output", "collisions.xml")
    return folder


def output(folder: Path, name: str, *more: str) -> Path:
    """FCD of the town, whose simulation is the same each time."""
    words = ("--precision", "6", "--no-warnings", "--no-step-log", *more)
    towns.call(folder, "sumo", "-c", "town.sumocfg", "--fcd-output", name, *words)
    return folder / name


@pytest.fixture(scope="module")
def exact(town: Path) -> pd.DataFrame:
    return passages(town, town / "exact.xml")


def passages(town: Path, *files: Path) -> pd.DataFrame:
    more = ("--person-fcd", files[1]) if files[1:] else ()
    return measured(
        files[0], "--net", town / "net.net.xml", *more, table=town / f"{files[0].name}.csv"
    )


@pytest.mark.parametrize(
    "name",
    ["fcd.csv", *(pytest.param(f"fcd.{of}", marks=pytest.mark.slow)
                  for of in ("xml.gz", "csv.gz", "apart"))],
)  # fmt: skip
def test_every_format_has_the_same_passages(town: Path, exact: pd.DataFrame, name: str) -> None:
    if name.endswith("apart"):
        apart = ("--person-fcd-output", "walkers.xml")
        files = [output(town, "apart.xml", *apart), town / "walkers.xml"]
    else:
        files = [output(town, name)]
    here, there = (
        of.assign(min_time_advantage_s=of["min_time_advantage_s"].clip(upper=100.0))
        for of in (exact, passages(town, *files))
    )
    pd.testing.assert_frame_equal(here, there, rtol=1e-4, atol=1e-3, check_dtype=False)


def test_records_ten_steps_apart(town: Path, exact: pd.DataFrame) -> None:
    """Times are interpolated: within a tenth of the second that lies between two records."""
    rare = passages(town, output(town, "rare.xml", "--device.fcd.period", "1"))
    keys = ["vehicle", "crosswalk", "connection"]
    both = exact.merge(rare, on=keys, suffixes=("", "_rare"))
    assert len(both) > 0.95 * len(exact)
    for name in ("front_s", "rear_s"):
        off_s = (both[f"{name}_rare"] - both[name]).dropna().abs()
        assert (off_s < 0.1).mean() > 0.9, name
        assert off_s.median() < 0.02, name
    near = both[both["pet_s"].between(0.1, 3.0) & both["pet_s_rare"].notna()]
    assert len(near) > 10
    assert (near["pet_s_rare"] - near["pet_s"]).abs().median() < 0.1


def test_every_collision_of_sumo_is_a_contact(town: Path, exact: pd.DataFrame) -> None:
    """Of vehicles with people on crosswalks, at every manoeuvre; SUMO's verdict comes later."""
    contacts = exact.dropna(subset=["contact_person"])
    known = set(zip(contacts["vehicle"], contacts["crosswalk"], strict=True))
    passed = exact.groupby("vehicle")["crosswalk"].agg(set).to_dict()
    hits, rest = 0, []
    for hit in ET.parse(town / "collisions.xml").iter("collision"):
        if hit.get("victimType") == "DEFAULT_PEDTYPE" and hit.get("collider") in passed:
            who = hit.get("collider", "")
            hits += 1
            if not any((who, name) in known for name in passed[who]):
                rest.append(dict(hit.attrib))
    assert hits > 3
    assert not rest


def test_pet_by_the_places_alone(town: Path, exact: pd.DataFrame) -> None:
    """Of straight passages: x and y every 2 ms, without lanes, lengths of lanes or zones."""
    cars, people = {}, {}
    for time in ET.parse(town / "exact.xml").getroot():
        for each in time:
            rows = (cars if each.tag == "vehicle" else people).setdefault(each.get("id"), [])
            place = complex(float(each.get("x", "")), float(each.get("y", "")))
            rows.append((float(time.get("time", "")), place, each.get("edge")))
    off = []
    straight = exact[(exact["manoeuvre"] == "straight") & exact["pet_s"].between(0.05, 3.0)]
    for row in straight[straight["contact_person"].isna()].to_dict("records"):
        long_m, wide_m = 5.0, 1.8
        time_s = np.arange(row["front_s"] - 6.0, row["rear_s"] + 6.0, 0.002)
        car = at(cars[row["vehicle"]], time_s)
        middle = int(np.argmin(abs(time_s - (row["front_s"] + row["rear_s"]) / 2)))
        ahead = car[middle + 200] - car[middle - 200]
        if not abs(ahead) > 0.5:
            continue
        ahead /= abs(ahead)
        driven = ((car - car[middle]) * ahead.conjugate()).real
        pets = []
        for walked in people.values():
            on_s = [of[0] for of in walked if of[2] == row["crosswalk"]]
            if not on_s or on_s[0] > row["rear_s"]:
                continue
            seen = (at(walked, time_s) - car[middle]) * ahead.conjugate()
            on = (time_s >= on_s[0]) & (time_s <= on_s[-1])
            zone = on & (abs(seen.imag) < wide_m / 2 + 0.25)
            if not zone.any() or driven.max() < seen.real[zone].max() + long_m + 0.25:
                continue
            enters = time_s[driven >= seen.real[zone].min() - 0.25][0]
            leaves = time_s[driven >= seen.real[zone].max() + long_m + 0.25][0]
            before = enters - time_s[zone][-1]
            pets.append(before if before >= 0 else max(0.0, time_s[zone][0] - leaves))
        off += [abs(min(pets) - row["pet_s"])] if pets else []
    assert len(off) > 10
    assert np.median(off) < 0.03
    assert np.mean(np.array(off) < 0.15) > 0.8


def at(states: list[tuple[float, complex, str | None]], time_s: np.ndarray) -> np.ndarray:
    known, places = [of[0] for of in states], np.array([of[1] for of in states])
    east, north = (np.interp(time_s, known, of) for of in (places.real, places.imag))
    return np.asarray(east + 1j * north)


def test_who_crosses_two_crosswalks_is_one_person(town: Path) -> None:
    words = ("conflicts", town / "exact.xml", "--net", town / "net.net.xml", "--json")
    every, *places = json.loads(printed(*words))["records"]
    walked: dict[str, set[str]] = {}
    for _, each in ET.iterparse(town / "exact.xml"):
        if each.tag == "person" and re.search(r"_c\d+$", each.get("edge", "")):
            walked.setdefault(each.get("edge", ""), set()).add(each.get("id", ""))
    once = set().union(*walked.values())
    assert every["people"] == pytest.approx(len(once), abs=2)  # who only comes at the end
    assert sum(each["people"] for each in places) > 1.1 * every["people"]
    assert every["passages"] == sum(each["passages"] for each in places)
