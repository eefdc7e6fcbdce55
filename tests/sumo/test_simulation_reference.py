"""The reference's arm with ``sumo_driver`` is SUMO's own simulation, number by number."""

import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import sumo

from harness.core.encounter import Arm
from harness.model.interaction import InteractionModel
from tests import towns

pytestmark = pytest.mark.usefixtures("no_simulation")

SUMO = Path(sumo.SUMO_HOME) / "bin/sumo"

OPTIONS: dict[str, dict[str, str]] = {
    "euler": {},
    "ballistic": {"step-method.ballistic": "true", "step-length": "0.2"},
    "emissions": {"device.emissions.probability": "1", "device.rerouting.probability": "0.5"},
    "teleports": {"time-to-teleport": "20", "collision.action": "teleport"},
    "random": {"random": "true", "output-prefix": "TIME_sub/", "tripinfo-output": "trips.xml"},
    "second steps": {"step-length": "1"},
    "until everybody arrived": {"end": "-1"},
}


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("grid")
    towns.grid(folder, 60)
    return folder


def body(file: Path) -> str:
    """A file of SUMO's below its dated header."""
    return re.sub(r"<!--.*?-->", "", file.read_text(), flags=re.DOTALL)


@pytest.mark.parametrize("name", OPTIONS)
def test_tripinfo_is_that_of_sumo_with_the_same_options(
    town: Path, name: str, model: InteractionModel, tmp_path: Path
) -> None:
    folder = tmp_path / "town"
    shutil.copytree(town, folder)
    config = folder / "town.sumocfg"
    options = {element.tag: element.attrib["value"] for element in ET.parse(config).getroot()}
    options |= OPTIONS[name]
    towns.write_config(folder, options)
    more = {"simulation__step_s": 0.1} if name == "second steps" else {}
    scenario = towns.scenario_of(config, [":B1_c0"], **more)
    outcome = towns.run_arm(scenario, model, tmp_path / "arm", Arm.HUMAN, pair=3)
    ours = body(tmp_path / "arm/tripinfo.xml")
    subprocess.run([SUMO, "-c", "simulation.sumocfg"], cwd=tmp_path / "arm", check=True)
    assert ours == body(tmp_path / "arm/tripinfo.xml")
    # Something happened, and to everybody who was due: randomTrips draws one vehicle a second.
    assert sum(not trip.person for trip in outcome.trips) == 60
    assert outcome.passages


def test_the_arm_has_her_seed_plus_the_pair(
    town: Path, model: InteractionModel, tmp_path: Path
) -> None:
    scenario = towns.scenario_of(town / "town.sumocfg", [":B1_c0"])
    towns.run_arm(scenario, model, tmp_path, Arm.HUMAN, pair=4)
    seed = ET.parse(tmp_path / "simulation.sumocfg").getroot().find("seed")
    # 23423 is SUMO's default.
    assert seed is not None
    assert seed.attrib["value"] == "23427"


def test_another_seed_is_another_hour(town: Path, model: InteractionModel, tmp_path: Path) -> None:
    trips = []
    for seed in (1, 2):
        scenario = towns.scenario_of(town / "town.sumocfg", [":B1_c0"], experiment__seed=seed)
        folder = tmp_path / str(seed)
        towns.run_arm(scenario, model, folder, Arm.HUMAN)
        subprocess.run([SUMO, "-c", "simulation.sumocfg"], cwd=folder, check=True)
        trips.append(body(folder / "tripinfo.xml"))
    assert trips[0] != trips[1]
