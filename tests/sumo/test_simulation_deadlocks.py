"""A driver and SUMO's people who wait for each other: counted, and never without an end."""

from pathlib import Path

import pytest

from harness.core.encounter import Arm
from harness.encounter.simulation import standing
from harness.model.interaction import InteractionModel
from tests import towns

pytestmark = pytest.mark.usefixtures("no_simulation")

CROSSINGS = (":B1_c0", ":B2_c0", ":C1_c0")


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return towns.grid(tmp_path_factory.mktemp("grid"), 220)


def test_vehicles_and_people_who_wait_for_each_other_are_counted(
    town: Path, model: InteractionModel, tmp_path: Path
) -> None:
    # People yield at crosswalks without priority; human_yield stops for people who wait.
    scenario = towns.scenario_of(town, CROSSINGS, arms__human="human_yield")
    outcome = towns.run_arm(scenario, model, tmp_path / "arm", Arm.HUMAN)
    log = outcome.log
    assert log.deadlocked
    assert log.deadlocked <= log.stuck_s.keys()
    assert all(stood_s > 60 for stood_s in log.stuck_s.values())


def test_a_deadlock_without_an_end_fails_its_pair(
    town: Path, model: InteractionModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    endless = '<time-to-teleport value="-1"/><pedestrian.striping.jamtime value="-1"/>'
    config = town.with_name("endless.sumocfg")
    config.write_text(town.read_text().replace('<end value="220"/>', endless))
    monkeypatch.setattr(standing, "HOPELESS_S", 100.0)
    scenario = towns.scenario_of(config, CROSSINGS, arms__human="human_yield")
    outcome = towns.run_arm(scenario, model, tmp_path / "arm", Arm.HUMAN, fails=True)
    assert outcome.reason is not None
    for part in ("has stood on lane", "no end", "teleport"):
        assert part in outcome.reason
