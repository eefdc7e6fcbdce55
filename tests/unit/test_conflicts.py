"""``harness conflicts`` on recordings written by hand, on the CCTC network.

The front is 0.25 m before x = 0, which somebody on the crosswalk's line touches, at a known time;
all other numbers follow from the crosswalk's 9 m, its 4 m and the lane's centre at 2.25 m.
"""

import gzip
import json
import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from harness.core.errors import InputError
from harness.core.resources import shipped_directory
from harness.encounter.simulation.recorded import seconds
from harness.old.studies.conflicts.vehicle_types import CLASSES, read_types, type_of
from harness.site import crosswalks_of, read_network
from tests.batches import here, printed, refusal

NET = next(shipped_directory("networks").glob("cctc/*.net.xml"))
WAY = crosswalks_of(read_network(NET))[0].ways[0]


def lane_of(x_m: float) -> tuple[str, float]:
    """Lane and position of a front bumper at x on the way."""
    place = next(each for each in WAY.lanes if each.start_m <= x_m < each.end_m)
    return place.lane, x_m - place.start_m


def timestep(time_s: float, vehicle_m: float, ahead_m: float, speed_mps: float = 5.0) -> str:
    """A vehicle on the way, and somebody who comes from the near kerb over x = 0."""
    lane, position_m = lane_of(vehicle_m)
    x_m, y_m = WAY.frame.to_network(0.0, ahead_m)
    on = 0 <= ahead_m <= 9
    edge = ":crosswalk_c0" if on else f":crosswalk_w{0 if ahead_m < 0 else 1}"
    return (
        f'<timestep time="{time_s:.2f}">'
        f'<vehicle id="v" x="0" y="0" angle="0" type="bus@v" speed="{speed_mps:.4f}" '
        f'pos="{position_m:.4f}" lane="{lane}" slope="0"/>'
        f'<person id="p" x="{x_m:.4f}" y="{y_m:.4f}" angle="0" type="walker" speed="1.5" pos="0" '
        f'edge="{edge}" slope="0"/></timestep>\n'
    )


def recording(start_s: float = 2.0, step_s: float = 0.5) -> str:
    """5 m/s from x = −60 m on; at 1.5 m/s they leave the kerb after ``start_s``."""
    steps = (number * step_s for number in range(round(20 / step_s)))
    body = (timestep(t, -60 + 5 * t, max(-0.4, min(1.5 * (t - start_s), 9.4))) for t in steps)
    return f"<fcd-export>\n{''.join(body)}</fcd-export>\n"


@pytest.fixture
def fcd(tmp_path: Path) -> Path:
    path = tmp_path / "fcd.xml"
    path.write_text(recording())
    return path


TYPES = '<routes><vType id="bus" vClass="bus" width="2.0"/><vType id="x"/></routes>'


def test_the_measures_of_a_recording(fcd: Path, tmp_path: Path) -> None:
    types, out = tmp_path / "types.add.xml", tmp_path / "out"
    types.write_text(TYPES)
    printed("conflicts", fcd, "--net", NET, "--types", types, "--out", out)
    (row,) = pd.read_parquet(out / "passages.parquet").to_dict("records")
    assert (row["crosswalk"], row["vehicle"], row["type"]) == (":crosswalk_c0", "v", "bus@v")
    assert (row["length_m"], row["width_m"]) == (12.0, 2.0)
    # The front is 50 m before the crosswalk after 2 s, and at its near edge, −2 m, after 11.6 s.
    assert row["range_m"] == pytest.approx(50.0)
    assert row["begin_s"] == pytest.approx(2.0)
    assert row["edge_s"] == pytest.approx(11.6, abs=1e-3)
    # 50 m + 12 m of bus + 2 m to the far edge.
    assert row["pass_time_s"] == pytest.approx(64 / 5, abs=1e-3)
    # They leave the zone at 2.25 + 1.0 + 0.25 = 3.5 m; the front enters it at −0.25 m, at 11.95 s.
    assert row["pet_s"] == pytest.approx(11.95 - (2.0 + 3.5 / 1.5), abs=1e-3)
    assert (row["people"], row["ending"]) == (1, "crossed")
    document = json.loads((out / "conflicts.json").read_text())
    assert document["step_s"] == 0.5
    assert document["undefined_types"] == {}
    page = (out / "report.html").read_text("utf-8")
    assert ":crosswalk_c0, vehicle v, 2 s" not in page  # a PET of 7.6 s is no conflict


def test_a_contact(tmp_path: Path) -> None:
    fcd, out = tmp_path / "fcd.xml.gz", tmp_path / "out"
    # At y = 2.25 m when the front is 0.25 m before them, at 11.95 s.
    fcd.write_bytes(gzip.compress(recording(start_s=11.95 - 1.5).encode()))
    result = here("conflicts", fcd, "--net", NET, "--out", out)
    (row,) = pd.read_parquet(out / "passages.parquet").to_dict("records")
    assert (row["ending"], row["contact"], row["contact_person"]) == ("crashed", "front", "p")
    assert row["contact_s"] == pytest.approx(11.95, abs=1e-3)
    assert row["contact_speed_mps"] == pytest.approx(5.0)
    # Nobody said what a bus is.
    assert row["length_m"] == 5.0
    assert "1 passage of vehicle types without a definition (bus@v)" in result.stdout
    assert ":crosswalk_c0, vehicle v, 2 s" in (out / "report.html").read_text("utf-8")
    worst = here("worst", out, "--by", "min_ttc_s", "--quiet")
    assert worst.stdout == ":crosswalk_c0 v 2\n"
    assert "front touched p at 5.00 m/s" in here("worst", out).stdout


def test_records_rarer_than_the_steps_of_the_simulation(tmp_path: Path) -> None:
    """Braking at 2 m/s² in steps of 0.1 s, a tenth of them recorded: no rule fits."""
    fcd, out = tmp_path / "fcd.xml", tmp_path / "out"
    x_m, speed_mps, rows = -60.0, 12.0, []
    for number in range(300):
        if number % 10 == 0:
            rows.append(timestep(number / 10, x_m, min(number * 0.15 - 3, 9.4), speed_mps))
        speed_mps -= 0.3 if number % 20 < 10 and number < 50 else -0.05
        x_m += speed_mps * 0.1
        if x_m > 250:
            break
    fcd.write_text(f"<fcd-export>{''.join(rows)}</fcd-export>")
    result = here("conflicts", fcd, "--net", NET, "--out", out)
    assert json.loads((out / "conflicts.json").read_text())["motion"] == "places"
    assert "vehicles move evenly between records" in result.stdout


Change = Callable[[Path], list[object]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda _: ["nowhere.xml", "--net", NET], "nowhere.xml: no such file"),
        (lambda _: [NET, "--net", NET], "its first element is <net>"),
        (lambda fcd: [cut(fcd), "--net", NET], "cut off, or no XML"),
        (lambda fcd: [changed(fcd, "<person.*?/>", ""), "--net", NET], "has no people"),
        (lambda fcd: [changed(fcd, "<vehicle.*?/>", ""), "--net", NET], "has no vehicles"),
        (lambda fcd: [changed(fcd, ' pos="', ' at="'), "--net", NET], "has no attribute 'pos'"),
        (lambda fcd: [changed(fcd, 'speed="5', 'speed="five'), "--net", NET], "is damaged"),
        (lambda fcd: [changed(fcd, 'lane="', 'lane="other'), "--net", NET], "none of its 40 rec"),
        (lambda fcd: [changed(fcd, "crosswalk_c0", "x_c0"), "--net", NET], "records of people"),
        (
            lambda fcd: [changed(fcd, r'( y="[-\d]+)', r"\g<1>9"), "--net", NET],
            "recorded elsewhere",
        ),
        (lambda fcd: [fcd, "--net", fcd], "a SUMO network"),
        (lambda fcd: [fcd, "--net", NET, "--edge", ":croswalk_c0"], "did you mean ':crosswalk_c0'"),
        (lambda fcd: [fcd, "--net", NET, "--types", "none.xml"], "--types none.xml: cannot be"),
        (lambda fcd: [fcd, "--net", NET, "--types", NET], "defines no vehicle type"),
        (lambda fcd: [fcd, "--net", NET, "--out", fcd.parent], "exists and is not empty"),
        (lambda fcd: [changed(fcd, 'lane="exit', 'lane="x'), "--net", NET], "0 vehicles of"),
    ],
)
def test_what_is_refused(fcd: Path, change: Change, words: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = change(fcd)
    out_option = [] if "--out" in arguments else ["--out", out]
    assert words in refusal("conflicts", *arguments, *out_option)
    assert not out.exists()


def cut(fcd: Path) -> Path:
    fcd.write_text(fcd.read_text()[:4000])
    return fcd


def changed(fcd: Path, old: str, new: str) -> Path:
    fcd.write_text(re.sub(old, new, fcd.read_text()))
    return fcd


def test_types(tmp_path: Path) -> None:
    path = tmp_path / "types.xml"
    path.write_text(
        "<additional><vTypeDistribution id='d'><vType id='a' length='4.2' decel='6'/>"
        "<vType id='t' vClass='truck'/></vTypeDistribution></additional>"
    )
    types = read_types([path])
    assert types["a"].length_m == 4.2
    assert types["a"].deceleration_mps2 == 6.0
    assert types["a"].width_m == CLASSES["passenger"].width_m
    assert types["t"] == CLASSES["truck"]
    assert type_of("t@7", types) == (CLASSES["truck"], True)
    assert type_of("DEFAULT_BIKETYPE", {}) == (CLASSES["passenger"], False)
    assert type_of("DEFAULT_BIKETYPE", types) == (CLASSES["bicycle"], True)
    path.write_text("<routes><vType id='a' length='-1'/></routes>")
    with pytest.raises(InputError, match="length='-1'"):
        read_types([path])


def test_times_of_sumo() -> None:
    assert seconds("3661.5") == 3661.5
    assert seconds("01:01:01.50") == 3661.5
    assert seconds("1:00:00:01") == 86401.0
