"""Whole simulations: who drives, what SUMO does of it, and the tables, against SUMO's outputs."""

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from harness.core.vocabulary import Arm
from harness.engine.arm_files import CONFIG_FILE, STATES_FILE, TRIPS_FILE, write_config
from harness.engine.configuration import read_config
from harness.engine.installation import program_path
from harness.engine.shared import close_engine
from harness.engine.town_reader import read_town
from harness.model.interaction import load_model
from harness.scenario import validate
from harness.simulation.arm_tables import run_arm
from harness.simulation.opening import opened
from harness.simulation.setup import Setup
from tests.towns import call, grid

END_S = 200


def setup_at(config: Path, most: int = 99, av_share: float = 1.0, **more: Any) -> Setup:
    """All usable crosswalks of a configuration, or the first ones."""
    town = read_town(read_config(config, 0.1).net).crosswalks.values()
    usable = [each.id for each in town if each.refused is None][:most]
    tree: dict[str, Any] = {
        "simulation": {"file": str(config), "crossings": usable, "av_share": av_share},
        "arms": {"av": "gap_yield", "human": "sumo_driver"},
        "ego": {"trigger_range_m": 50.0, "resume_acceleration_mps2": 1.5},
        **more,
    }
    return opened(validate(tree, "test"), load_model("dut"))


def run(setup: Setup, folder: Path) -> dict[str, pd.DataFrame]:
    """The tables of the AV's arm, which succeeds."""
    close_engine()
    outcome = run_arm(setup, 0, Arm.AV, folder)
    assert outcome.reason is None, outcome.traceback or outcome.reason
    return {name: pd.DataFrame({**columns}) for name, columns in outcome.tables.items()}


def trips(file: Path) -> list[dict[str, str]]:
    """The trips of a tripinfo file, but for the names of devices, which are SUMO's outputs."""
    return [trip.attrib | {"devices": ""} for trip in ET.parse(file).iter("tripinfo")]


def test_nobody_driven_is_sumo_untouched(tmp_path: Path) -> None:
    """With a share of 0 tripinfo equals plain SUMO's; the vehicles' rows are its rows.

    Every vehicle on a connection over a crosswalk has a passage, also if it changed lane for it.
    """
    setup = setup_at(grid(tmp_path / "town", END_S, 2), av_share=0.0)
    outcome = run(setup, tmp_path / "arm")
    # The configuration leads all outputs into its own folder.
    plain, states = (tmp_path / "arm" / name for name in ("plain.xml", "states.xml"))
    files = ("--tripinfo-output", plain.name, "--fcd-output", states.name)
    call(tmp_path, program_path("sumo"), "-c", str(tmp_path / "arm" / CONFIG_FILE), *files)
    ours = trips(tmp_path / "arm" / TRIPS_FILE)
    assert ours == trips(plain)
    rows, passed = (outcome[name] for name in ("vehicles", "passages"))
    assert rows["vehicle"].tolist() == [trip["id"] for trip in ours]
    lost = [float(trip["timeLoss"]) + float(trip["departDelay"]) for trip in ours]
    assert rows["time_loss_s"].tolist() == pytest.approx(lost)
    over = [(way.via[0], at.id) for at in setup.crosswalks.values() for way in at.over]
    seen = {(each.get("id"), each.get("lane")) for each in ET.parse(states).iter("vehicle")}
    theirs = {(name, at) for name, on in seen for lane, at in over if lane == on}
    assert theirs - {*zip(passed["vehicle"], passed["crosswalk"], strict=True)} == set()
    assert passed[["not_driven_because", "fallback"]].notna().mean().tolist() == [1.0, 0.0]


@pytest.mark.parametrize("keeps", [True, False])
def test_outputs_are_in_the_arms_folder_and_nothing_is_beside_the_users_files(
    tmp_path: Path, keeps: bool
) -> None:
    town, arm = tmp_path / "town", tmp_path / "arm"
    options = {"fcd-output": "out/fcd.xml", "device.ssm.probability": "1"}
    config = grid(town, 20, **options, **{"additional-files": "more/detectors.add.xml"})
    for folder in ("out", "more"):
        (town / folder).mkdir()
    (town / "more" / "detectors.add.xml").write_text(
        f"""<additional><edgeData id="edges" file="../out/edges.xml"/>
        <laneData id="lanes" file="{town}/lanes.xml"/></additional>"""
    )
    before = {path: path.read_bytes() for path in town.rglob("*.*")}
    path = write_config(read_config(config), arm, 1, keeps=keeps)
    call(tmp_path, program_path("sumo"), "-c", str(path))
    assert {path: path.read_bytes() for path in town.rglob("*.*")} == before
    written = {path.name for path in arm.iterdir() if not path.name.startswith("ssm")}
    assert written == {CONFIG_FILE, TRIPS_FILE, "edges.xml", "lanes.xml", *[STATES_FILE][:keeps]}


def test_everybody_driven(tmp_path: Path) -> None:
    """At share 1 every passage over every crosswalk is driven, turning ones too; nobody collides.

    Every contact that SUMO reports is one of ours, or of a corner of SUMO's larger person.
    """
    everybody = run(setup_at(grid(tmp_path / "town", END_S)), tmp_path / "arm")
    passed = everybody["passages"]
    assert (len(passed) > 300, passed["driven"].all()) == (True, True)
    assert set(passed["manoeuvre"]) == {"straight", "left", "right"}
    assert everybody["arms"]["vehicle_collisions"].item() == 0
    shares = [name for name in map(str, passed) if name.startswith("share_")]
    assert np.allclose(passed.loc[passed["steps"] > 0, shares].sum(axis=1), 1.0)
    early = passed[(passed["ended"] == "passed") & (passed["delay_s"] < -0.5)]
    assert early.empty, early[["vehicle", "connection", "trigger_s", "rear_s", "delay_s"]]
    missed = passed[passed["sumo_contact"] & passed["contact"].isna()]
    assert (missed["min_gap_m"] < 0.6).all()
    assert (everybody["people"]["wait_s"] >= 0.0).all()
    assert (everybody["people"]["own"].sum(), everybody["arms"]["people_left_out"].item()) == (0, 0)


@pytest.mark.parametrize("strategy", ["gap_yield", "human_yield"])
def test_nobody_is_hit_whom_a_stop_could_have_spared(strategy: str, tmp_path: Path) -> None:
    """People of the harness at crosswalks over which vehicles go straight on, left and right.

    A driver who sees somebody step off far enough away to stop with 2 m/s² never hits them.  SUMO's
    own people do not keep to the line on which strategies expect them.
    """
    people = {"flow_per_hour": 1000.0, "walking_speed": {"mean_mps": 1.3, "std_mps": 0.2}}
    arms = {"av": strategy, "human": "gap_yield"}
    setup = setup_at(grid(tmp_path / "town", END_S), 7, arms=arms, pedestrians=people)
    passed = run(setup, tmp_path / strategy)["passages"]
    assert passed["manoeuvre"].value_counts()[["straight", "left", "right"]].min() > 30
    hit = passed["contact_person"].str.startswith("own", na=False)
    moving = passed[hit & (passed["contact"] == "front") & (passed["contact_speed_mps"] > 0.0)]
    spared = moving[moving["required_deceleration_mps2"] < 2.0]
    assert spared.empty, spared.T.to_string()
