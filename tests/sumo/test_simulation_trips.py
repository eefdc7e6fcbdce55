"""Trips, the counted window and added people of a user's simulation."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import pytest

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.encounter.simulation.demand import PEOPLE_FILE
from harness.encounter.simulation.pairing import SimulationOutcome, counted_s
from harness.encounter.simulation.trips import Trip
from harness.model.interaction import InteractionModel
from harness.scenario.own_simulation import setting_of
from tests import towns

pytestmark = pytest.mark.usefixtures("no_simulation")

DEMAND = """<routes><vType id="c" sigma="0" speedDev="0"/>
<vType id="w" vClass="pedestrian" speedDev="0" maxSpeed="1.0"/>
<vehicle id="blocks" type="c" depart="0" departPos="10" departLane="1"><route edges="w_a a_b"/>
  <stop lane="w_a_1" endPos="12" duration="500"/></vehicle>
<vehicle id="blocks2" type="c" depart="0" departPos="10" departLane="2"><route edges="w_a a_b"/>
  <stop lane="w_a_2" endPos="12" duration="500"/></vehicle>
<person id="walks" type="w" depart="5"><walk edges="w_a a_b b_c" arrivalPos="100"/></person>
<person id="arrives" type="w" depart="5"><walk edges="w_a" arrivalPos="20"/></person>
<vehicle id="late" type="c" depart="20"><route edges="w_a a_b"/></vehicle>
<person id="rides" type="w" depart="25"><walk edges="w_a" arrivalPos="10"/>
  <ride from="w_a" to="a_b" lines="nothing"/></person>
<person id="comes_later" type="w" depart="150"><walk edges="w_a" arrivalPos="20"/></person>
<vehicle id="is_later" type="c" depart="150"><route edges="w_a a_b"/></vehicle>
</routes>"""


def with_demand(folder: Path, demand: str, end: str) -> Path:
    """The main road with a demand of one file."""
    config = towns.main_road(folder, 10)
    (folder / "demand.rou.xml").write_text(demand)
    options = {element.tag: element.attrib["value"] for element in ET.parse(config).getroot()}
    return towns.write_config(folder, options | {"route-files": "demand.rou.xml", "end": end})


def by_name(outcome: SimulationOutcome) -> Mapping[str, Trip]:
    return {trip.name: trip for trip in outcome.trips}


def test_trips_that_do_not_end_count_with_the_time_until_the_end(
    model: InteractionModel, tmp_path: Path
) -> None:
    config = with_demand(tmp_path, DEMAND, "100")
    scenario = towns.scenario_of(config, [":b_c0"])
    trips = by_name(towns.run_arm(scenario, model, tmp_path / "arm", Arm.HUMAN))
    # Who was to come after the end is nobody's trip.
    assert set(trips) == {"blocks", "blocks2", "walks", "arrives", "late", "rides"}
    # Both lanes are blocked, so it waits from 20 s until 100 s.
    late = trips["late"]
    assert (late.departed, late.arrived, late.due_s) == (False, False, 20.0)
    assert (late.duration_s, late.time_loss_s) == (80.0, 80.0)
    blocks = trips["blocks"]
    assert (blocks.departed, blocks.arrived, blocks.due_s) == (True, False, 0.0)
    assert blocks.duration_s == 100.0
    assert blocks.time_loss_s < 1.0  # a planned stop is no loss
    walks = trips["walks"]
    assert (walks.departed, walks.arrived, walks.due_s) == (True, False, 5.0)
    assert walks.duration_s == 95.0
    assert walks.time_loss_s > 0  # it starts from standing
    # 20 m at 1 m/s.
    arrives = trips["arrives"]
    assert arrives.arrived
    assert arrives.duration_s == pytest.approx(20.0 + arrives.time_loss_s, abs=0.2)
    # It walks 10 m at 1 m/s and then waits for a ride that does not come.
    rides = trips["rides"]
    assert (rides.arrived, rides.duration_s) == (False, 75.0)
    assert rides.time_loss_s < 3.0


def test_without_an_end_it_ends_when_everybody_has_arrived(
    model: InteractionModel, tmp_path: Path
) -> None:
    text = DEMAND.replace('duration="500"', 'duration="30"')
    config = with_demand(tmp_path, text, "-1")
    scenario = towns.scenario_of(config, [":b_c0"])
    outcome = towns.run_arm(scenario, model, tmp_path / "arm")
    trips = by_name(outcome)
    # The ride never comes: SUMO ends when nobody else is left.
    assert {name for name, trip in trips.items() if not trip.arrived} == {"rides"}
    # 'walks' goes 5 s + 600 m at 1 m/s and some; nobody comes later.
    assert 500 < outcome.log.end_s < 700
    assert outcome.log.end_s - (5.0 + trips["walks"].duration_s) <= 0.2


def test_the_counted_window(model: InteractionModel, tmp_path: Path) -> None:
    config = towns.main_road(tmp_path, 60)
    scenario = towns.scenario_of(config, [":b_c0"], simulation__begin=20.0, simulation__end=40.0)
    assert counted_s(scenario, setting_of(scenario)) == (20.0, 40.0)
    outcome = towns.run_arm(scenario, model, tmp_path / "arm")
    # The simulation itself goes on to its own end, and queues are looked at every second.
    assert outcome.log.end_s == pytest.approx(60.0)
    assert {len(each) for each in outcome.log.queues_m.values()} == {20}


def test_a_window_outside_of_the_simulations_time_is_refused(tmp_path: Path) -> None:
    config = towns.main_road(tmp_path, 60)
    with pytest.raises(InputError, match=r"simulation\.begin.*60 s"):
        towns.scenario_of(config, [":b_c0"], simulation__begin=60.0)
    with pytest.raises(InputError, match=r"simulation\.end.*at most 60 s"):
        towns.scenario_of(config, [":b_c0"], simulation__end=61.0)
    # People would be added for ever.
    config.write_text(config.read_text().replace('<end value="60"/>', ""))
    with pytest.raises(InputError, match=r"simulation\.end"):
        towns.scenario_of(config, [":b_c0"], pedestrians__flow_per_hour=100.0)


def added(folder: Path) -> list[tuple[str, float]]:
    return [
        (person.attrib["id"], float(person.attrib["depart"]))
        for person in ET.parse(folder / PEOPLE_FILE).getroot()
    ]


def test_added_people_cross_at_the_chosen_crosswalk(
    model: InteractionModel, tmp_path: Path
) -> None:
    config = with_demand(
        tmp_path,
        '<routes><vehicle id="v" depart="0"><route edges="w_a a_b"/></vehicle></routes>',
        "400",
    )
    people = {}
    for flow in (100.0, 200.0):
        scenario = towns.scenario_of(config, [":b_c0"], pedestrians__flow_per_hour=flow)
        for arm in Arm:
            folder = tmp_path / f"{flow:g}-{arm.value}"
            outcome = towns.run_arm(scenario, model, folder, arm)
            people[flow, arm] = added(folder)
        # They really cross there: everybody who has arrived was on the crossing.
        arrived = {trip.name for trip in outcome.trips if trip.person and trip.arrived}
        crossed = {track.id for track in outcome.log.people[":b_c0"]}
        assert arrived
        assert arrived <= crossed
        assert people[flow, Arm.AV] == people[flow, Arm.HUMAN]
    few, many = people[100.0, Arm.AV], people[200.0, Arm.AV]
    # The same people, stretched: λ twice as great, everybody comes in half the time.
    assert 2 < len(few) < len(many)
    for (name, depart_s), (same, earlier_s) in zip(few, many, strict=False):
        assert name == same
        assert earlier_s == pytest.approx(depart_s / 2, abs=2e-3)
    # Poisson with mean λT = 200 / 3600 · 400 = 22: 4 standard deviations.
    assert len(many) == pytest.approx(22.2, abs=4 * 22.2**0.5)
