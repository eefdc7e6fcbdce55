"""An arm of a user's own simulation again: with SUMO's outputs, and in sumo-gui at the moment."""

import shlex
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import pandas as pd
import pytest

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.old.studies.replay.moment import _end_s, moments_of
from harness.old.studies.replay.rerun import debug
from harness.old.studies.runs.stored import StoredCell
from harness.old.studies.runs.worst import worst
from harness.scenario.own_simulation import setting_of
from tests.batches import printed, refusal, run_inline
from tests.own_scenario import CROSSING, own_study
from tests.sumo.test_watch import PEDESTRIAN, needs_xvfb, pixels, watched

AV_BLUE, YELLOW = (0, 114, 178), (255, 255, 0)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every car is an AV, lorries are not."""
    folder = tmp_path_factory.mktemp("own")
    return run_inline(own_study(folder), folder / "run").path


def rows_of(run: Path, arm: str, pair: int = 1) -> pd.DataFrame:
    rows = pd.read_parquet(run / "passages_over.parquet")
    return rows[(rows["pair"] == pair) & (rows["arm"] == arm)]


def test_outputs_of_both_arms_and_the_same_record(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "review"
    done = printed("replay", run, "--pair", "1", "--out", out)
    same = "the record is identical to the stored record"
    assert done.splitlines() == [f"{out / arm}: {same}" for arm in ("av", "human")]
    for arm in ("av", "human"):
        names = {path.name for path in (out / arm).iterdir()}
        assert {"fcd.xml", "tripinfo.xml", "collisions.xml", "site.net.xml"} <= names
        positions = {
            each.get("id")
            for each in ET.parse(out / arm / "fcd.xml").iter()
            if each.tag in ("vehicle", "person")
        }
        assert {*rows_of(run, arm)["vehicle"]} <= positions
        assert {each for each in positions if each and each.startswith("p")}
    # Only the driver differs: the reference's arm has the record of plain SUMO.
    assert (out / "av" / "fcd.xml").read_bytes() != (out / "human" / "fcd.xml").read_bytes()


def test_positions_have_the_decimals_that_conflicts_need(run: Path, tmp_path: Path) -> None:
    printed("replay", run, "--pair", "1", "--arm", "av", "--out", tmp_path / "av")
    ways: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for each in ET.parse(tmp_path / "av" / "fcd.xml").iter("vehicle"):
        state = float(each.attrib["pos"]), float(each.attrib["speed"])
        ways.setdefault((each.attrib["id"], each.attrib["lane"]), []).append(state)
    steps = [(a, b) for way in ways.values() for a, b in pairwise(way)]
    assert len(steps) > 500
    # Euler's rule: a vehicle drives the whole step of 0.1 s at its speed at the end. With four
    # decimals positions are off by up to 0.5e-4 m each, and speeds by 0.5e-4 m/s.
    for (before_m, _), (after_m, speed_mps) in steps:
        assert after_m - before_m == pytest.approx(0.1 * speed_mps, abs=1.05e-4)
    # The other files keep the precision of the scenario: two decimals, SUMO's default.
    trip = next(ET.parse(tmp_path / "av" / "tripinfo.xml").iter("tripinfo"))
    assert len(trip.attrib["timeLoss"].partition(".")[2]) == 2


def test_a_relative_folder_is_one_of_the_working_directory(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    printed("replay", run, "--pair", "0", "--arm", "av", "--out", "here")
    assert (tmp_path / "here" / "fcd.xml").stat().st_size > 1000


def test_debug_repeats_it_in_this_process(run: Path) -> None:
    repeated = debug(run, 0, [*Arm])
    assert {arm: each.differences for arm, each in repeated.items()} == dict.fromkeys(Arm, ())


def test_the_moment_is_the_most_striking_passage_in_both_arms(run: Path) -> None:
    stored = StoredCell(run, 0, 1)
    moments = moments_of(stored, 1, [*Arm])
    av = rows_of(run, "av")
    contacts = av[av["contact_time_s"].notna()]
    worst = (contacts if len(contacts) else av[av["automated"]].nsmallest(1, "pet_s")).iloc[0]
    human = rows_of(run, "human")
    same = human[human["vehicle"] == worst["vehicle"]].iloc[0]
    for arm, row in ((Arm.AV, worst), (Arm.HUMAN, same)):
        assert moments[arm].begin_s == pytest.approx(row["trigger_s"] - 3)
        # A passage with a contact has no time at which it passed.
        contact_s = row["trigger_s"] + row["contact_time_s"]
        ends_s = contact_s if pd.isna(row["passed_s"]) else row["passed_s"]
        assert moments[arm].end_s == pytest.approx(ends_s + 3)
    # The middle of the window is the middle of the crosswalk, between its two kerbs.
    (crosswalk,) = setting_of(stored.cell.scenario).crosswalks
    for way in crosswalk.ways:
        x_m, y_m = way.frame.to_road(moments[Arm.AV].x_m, moments[Arm.AV].y_m)
        assert (x_m, y_m) == pytest.approx((0, way.crossing.length_m / 2), abs=0.01)


def test_another_vehicle_is_asked_for(run: Path) -> None:
    stored, rows = StoredCell(run, 0, 1), rows_of(run, "av")
    for name in rows["vehicle"].iloc[:3]:
        moment = moments_of(stored, 1, [Arm.AV], name, CROSSING)[Arm.AV]
        trigger_s = rows.loc[rows["vehicle"] == name, "trigger_s"].iloc[0]
        assert moment.begin_s == pytest.approx(trigger_s - 3)
    with pytest.raises(InputError, match="--vehicle nobody: no such passage"):
        moments_of(stored, 1, [Arm.AV], "nobody")
    with pytest.raises(InputError, match="--crosswalk :x_c0: no such passage"):
        moments_of(stored, 1, [Arm.AV], None, ":x_c0")


def test_the_command_of_a_bad_passage_shows_that_passage(run: Path) -> None:
    for episode in worst(run, most=5):
        words = shlex.split(episode.command)
        options = dict(zip(words[3:-1:2], words[4:-1:2], strict=True))
        pair, arm = int(options["--pair"]), Arm(options["--arm"])
        asked = (options["--vehicle"], options["--crosswalk"])
        moment = moments_of(StoredCell(run, 0, pair), pair, [arm], *asked)[arm]
        assert moment.begin_s == episode.names["trigger_s"] - 3.0


def test_the_moment_ends_after_a_contact() -> None:
    assert _end_s({"trigger_s": 600.0, "passed_s": None, "contact_time_s": 4.5}) == 604.5
    assert _end_s({"trigger_s": 600.0, "passed_s": 607.0, "contact_time_s": None}) == 607.0


def test_the_options_are_refused_elsewhere(run: Path) -> None:
    assert "--vehicle" in refusal("replay", run, "--pair", "0", "--vehicle", "v1", "--out", "x")


@pytest.mark.slow
@needs_xvfb
def test_sumo_gui_shows_the_moment_with_avs_in_colour(run: Path, tmp_path: Path) -> None:
    options = ("--pace", "100", "--screenshots", tmp_path / "shots", "--every", "1")
    text = watched("replay", run, "--pair", "1", "--arm", "both", *options)
    same = "the record is identical to the stored record"
    assert text.splitlines() == [f"pair 1, arm {arm}: {same}" for arm in ("av", "human")]
    moments = moments_of(StoredCell(run, 0, 1), 1, [*Arm])
    for arm in Arm:
        pictures = sorted((tmp_path / "shots" / arm.value).glob("*.png"))
        times = [float(picture.stem.split("-")[1]) for picture in pictures]
        # Only the passage and some seconds around it are taken.
        assert times[0] == pytest.approx(moments[arm].begin_s + 0.1, abs=0.11)
        assert times[-1] == pytest.approx(moments[arm].end_s, abs=1.1)
        blue = max(pixels(picture, AV_BLUE) for picture in pictures)
        assert max(pixels(picture, PEDESTRIAN) for picture in pictures) > 30
        # In the reference's arm nobody is an AV.
        assert (blue > 300) == (arm is Arm.AV)
        if arm is Arm.HUMAN:
            assert max(pixels(picture, YELLOW) for picture in pictures) > 300
