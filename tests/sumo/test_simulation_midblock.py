"""A crosswalk away from junctions: a passage in a user's simulation is the encounter's."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from harness.core.encounter import Arm, Trace
from harness.engine.network import network_of
from harness.engine.shared import close_engine, open_engine
from harness.episode.pairing import PairRunner
from harness.episode.simulation.pairing import MeasuredPassage
from harness.measures import MEASURES, EpisodeRecord
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario, load_scenario
from harness.site import Place, read_site
from tests import towns

pytestmark = pytest.mark.usefixtures("no_simulation")

SPEED_MPS = 8.0
STEP_S = 0.1

DRAWN = ("pedestrian_delay_s",)
"""The encounter counts this from a drawn arrival; here the person comes along the footpath."""

STILL = {
    "pedestrian.striping.dawdling": "0",
    "pedestrian.striping.jamtime": "-1",
    "pedestrian.striping.jamtime.crossing": "-1",
    "insertion-checks": "none",
    "time-to-teleport": "-1",
    "precision": "6",
}


def encounter(strategy: str) -> Scenario:
    return load_scenario(
        "cctc",
        {
            "pedestrians.behaviour": "sumo",
            "pedestrians.kerb_wait_s": 2.0,
            "arms.av": strategy,
            "arms.human": "sumo_driver",
            "ego.initial_speed_mps": SPEED_MPS,
            "model.extrapolate": True,
        },
    )


def config(folder: Path, scenario: Scenario, walker: tuple[str, str, float], method: str) -> Path:
    """A configuration with the encounter's road, vehicle, person and options.

    ``walker`` is the edge from which the person comes, where they go, and their speed.
    """
    shutil.copy(network_of(scenario), folder / "net.net.xml")
    site = read_site(Place(folder / "net.net.xml"))
    start = site.ego.departure(30.0)
    paths = {path.edge: path for path in site.footpaths}
    near, far = paths[walker[0]], paths[walker[1]]
    vehicle = scenario.vehicle()
    (folder / "demand.rou.xml").write_text(
        f"""<routes>
        <vType id="car" vClass="passenger" length="{vehicle.length_m}" width="{vehicle.width_m}"
          accel="{vehicle.max_acceleration_mps2}" decel="{vehicle.max_deceleration_mps2}"
          emergencyDecel="{vehicle.max_deceleration_mps2}" speedFactor="1" speedDev="0" sigma="0"
          minGap="0" maxSpeed="{SPEED_MPS}"/>
        <vType id="walker" vClass="pedestrian" speedDev="0" maxSpeed="{walker[2]!r}" sigma="0"/>
        <vehicle id="ego" type="car" depart="0.1" departPos="{start.position_m!r}"
          departLane="{start.lane}" departSpeed="{SPEED_MPS}">
          <route edges="{" ".join(start.edges)}"/></vehicle>
        <person id="p" type="walker" depart="0.2" departPos="{near.end_m}">
          <walk edges="{near.edge} {far.edge}" arrivalPos="{far.inside_m}"/></person>
        </routes>"""
    )
    options = {
        "net-file": "net.net.xml",
        "route-files": "demand.rou.xml",
        "end": "60",
        "step-length": str(STEP_S),
        "step-method.ballistic": method,
    }
    return towns.write_config(folder, options | STILL | towns.COLLISIONS)


def both(
    strategy: str, method: str, model: InteractionModel, folder: Path
) -> tuple[Trace, EpisodeRecord, MeasuredPassage]:
    """The encounter, and the same vehicle and person in a user's simulation."""
    scenario = encounter(strategy)
    outcome = PairRunner(scenario, model, lambda: open_engine(scenario, "sumo")).run_arm(0, Arm.AV)
    close_engine()
    walk = outcome.trace.walks[0]
    assert walk.speed_mps is not None
    site = read_site(Place(network_of(scenario)))
    edges = site.footpath(walk.arrival.side).edge, site.footpath(walk.arrival.side.other).edge
    path = config(folder, scenario, (*edges, walk.speed_mps), method)
    own = towns.scenario_of(path, [":crosswalk_c0"], arms__av=strategy)
    simulated = towns.run_arm(own, model, folder / "arm")
    (passage,) = simulated.passages
    return outcome.trace, outcome.record, passage


@pytest.mark.parametrize("strategy", ["gap_yield", "soft_yield", "hard_yield"])
def test_a_passage_is_the_encounters_with_sumos_people(
    strategy: str, model: InteractionModel, tmp_path: Path
) -> None:
    trace, record, passage = both(strategy, "true", model, tmp_path)
    assert len(trace.x_m) == len(passage.trace.x_m)
    assert np.abs(trace.x_m - passage.trace.x_m).max() <= 1e-6
    assert np.abs(trace.speed_mps - passage.trace.speed_mps).max() <= 1e-6
    for measure in MEASURES:
        if measure.column in DRAWN:
            continue
        expected = getattr(record, measure.column)
        value = getattr(passage.record, measure.column)
        if isinstance(expected, float):
            assert value == pytest.approx(expected, abs=1e-6), measure.column
        else:
            assert value == expected, measure.column
    assert passage.log.commands > 20
    assert passage.log.cut == 0
    assert not passage.log.driven_way.meets_vehicles


def test_with_euler_a_vehicle_is_where_sumo_moved_it(
    model: InteractionModel, tmp_path: Path
) -> None:
    _, _, passage = both("soft_yield", "false", model, tmp_path)
    trace = passage.trace
    assert trace.motion == "euler"
    # Euler: x advances by the new speed times the step.
    moved = np.diff(trace.x_m)
    assert np.abs(moved - trace.speed_mps[1:] * STEP_S).max() <= 1e-6
    assert trace.speed_mps.min() < SPEED_MPS - 1
    # SUMO's crosswalk is 4 m wide and the vehicle 5 m long: its rear leaves 7 m beyond the middle.
    assert trace.x_m[-1] >= passage.log.rear_left_m > trace.x_m[-2]
