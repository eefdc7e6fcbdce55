"""Vehicles that change lane within R0 are measured on the lane on which they cross."""

from pathlib import Path

import pandas as pd
import pytest

from harness.core.encounter import Arm
from harness.encounter.simulation.pairing import SimulationOutcome
from harness.model.interaction import InteractionModel
from harness.old.studies.conflicts import find_conflicts
from tests import towns

pytestmark = pytest.mark.usefixtures("no_simulation")

CROSSWALK = ":b_c2"
"""It lies over two lanes each way, on the west of the junction."""

END_S = 240


def demand(folder: Path) -> None:
    """Slow and fast cars on two lanes, with somebody on foot every few seconds."""
    (folder / "vehicles.trips.xml").write_text(
        f"""<routes><vType id="fast" vClass="passenger" length="4.6" width="1.8" speedFactor="1.1"
        speedDev="0" lcSpeedGain="20" lcAssertive="3"/>
        <vType id="slow" vClass="passenger" length="4.6" width="1.8" maxSpeed="7"/>
        <flow id="f" type="fast" begin="0" end="{END_S}" period="5" departLane="random"
          departSpeed="max"><route edges="w_a a_b b_c c_e"/></flow>
        <flow id="s" type="slow" begin="0" end="{END_S}" period="14" departLane="random"
          departSpeed="max"><route edges="w_a a_b b_c c_e"/></flow></routes>"""
    )
    (folder / "people.trips.xml").write_text(
        f"""<routes><personFlow id="p" begin="0" end="{END_S}" period="7">
        <walk from="b_a" to="a_b" departPos="190" arrivalPos="190"/></personFlow></routes>"""
    )


def lanes_of(fcd: Path, edge: str) -> dict[str, list[str]]:
    """By vehicle, SUMO's lanes of an edge in order of time, in the last 45 m of the edge."""
    rows = pd.read_csv(fcd, sep=";")
    rows = rows[rows["vehicle_lane"].str.rpartition("_")[0].eq(edge)]
    rows = rows[rows["vehicle_pos"] > rows["vehicle_pos"].max() - 45.0]
    return {name: own["vehicle_lane"].tolist() for name, own in rows.groupby("vehicle_id")}


@pytest.fixture(scope="module", params=[("sumo_driver", 1.0), ("gap_yield", 0.3)], ids=str)
def arm(
    request: pytest.FixtureRequest,
    tmp_path_factory: pytest.TempPathFactory,
    model: InteractionModel,
) -> tuple[SimulationOutcome, Path]:
    """An arm that SUMO drives, or a strategy in part, with the folder of its FCD output.

    A vehicle changes no lane while a strategy drives it, so only the others change.
    """
    folder = tmp_path_factory.mktemp("lanes")
    config = towns.main_road(folder, 10, **{"fcd-output": "fcd.csv", "precision": "6"})
    demand(folder)
    config.write_text(config.read_text().replace('<end value="10"/>', f'<end value="{END_S}"/>'))
    scenario = towns.scenario_of(
        config,
        [CROSSWALK],
        arms__av=request.param[0],
        simulation__av_share=request.param[1],
        simulation__outputs=["fcd"],
        ego__trigger_range_m=50.0,
    )
    return towns.run_arm(scenario, model, folder / "arm", Arm.AV), folder


def test_a_passage_is_on_the_lane_on_which_the_vehicle_crosses(
    arm: tuple[SimulationOutcome, Path],
) -> None:
    outcome, folder = arm
    driven = lanes_of(folder / "arm" / "fcd.csv", "a_b")
    changed = 0
    for each in outcome.passages:
        way = each.log.driven_way.way
        if way.crosswalk == CROSSWALK and each.log.ended == "passed":
            assert way.approach == driven[each.log.name][-1]
            changed += len({*driven[each.log.name]}) > 1
    assert changed >= 5


def test_passages_are_those_of_conflicts_on_the_fcd_output(
    arm: tuple[SimulationOutcome, Path],
) -> None:
    outcome, folder = arm
    recorded = find_conflicts(
        [folder / "arm" / "fcd.csv"],
        folder / "net.net.xml",
        types=[folder / "vehicles.trips.xml"],
    )
    there = {(each.crosswalk, each.vehicle): each for each in recorded.passages}
    near = 0
    for each in outcome.passages:
        # SUMO does not write the state at the end of its last step.
        if each.log.ended != "passed" or each.log.time_s[-1] > END_S - 1.0:
            continue
        record = each.record
        other = there[each.log.driven_way.way.crosswalk, each.log.name].record
        assert (record.contact is None) == (other.contact is None)
        assert (record.pet_s is None) == (other.pet_s is None)
        if record.pet_s is not None:
            # Records have six decimals, and walks are simplified by twice as much.
            assert record.pet_s == pytest.approx(other.pet_s, abs=1e-4)
            near += record.pet_s < 3.0
    assert near >= 5
