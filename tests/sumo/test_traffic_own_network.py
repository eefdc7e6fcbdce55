"""Hours of traffic in a network of one's own give what one of the same geometry gives anywhere."""

import re
from collections.abc import Mapping
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.core.encounter import Arm, Arrival, Side
from harness.core.errors import InputError
from harness.engine.network.build import run_netconvert
from harness.engine.shared import road_for
from harness.episode.traffic.hour import Hour
from harness.episode.traffic.lanes import Direction
from harness.episode.traffic.pairing import HourOutcome, HourRunner
from harness.episode.traffic.vehicles import HourVehicle, LaneOnRoad
from harness.scenario import Scenario, remarks, validate
from harness.site import Place, read_site, streams_of
from tests.sumo.test_own_network import CCTC, Road, built, random_road
from tests.sumo.test_traffic import MODEL, check_everybody, hour_of

pytestmark = pytest.mark.usefixtures("no_simulation")

STRAIGHT = Road(straight_m=200.0, precision=9)
"""320 m of road before the crosswalk, of two edges, and 130 m beyond it."""


def scenario_of(crossing: Mapping[str, Any], **sections: Mapping[str, Any]) -> Scenario:
    tree: dict[str, Any] = {
        "arms": {"av": "gap_yield", "human": "human_yield"},
        "ego": {"initial_speed_mps": 8.0},
        "pedestrians": {"flow_per_hour": 600.0},
        "traffic": {"flow_per_hour": 500.0, "duration_s": 90.0, "warm_up_s": 20.0},
        "crossing": dict(crossing),
    }
    for section, values in sections.items():
        tree[section] = {**tree.get(section, {}), **values}
    return validate(tree, "test")


def at(net: Path) -> dict[str, Any]:
    return {"net": str(net), "edge": ":cross_c0"}


def hour_in(scenario: Scenario) -> HourOutcome:
    outcome = HourRunner(scenario, MODEL, lambda: road_for(scenario), paths=True).run_arm(0, Arm.AV)
    assert outcome.reason is None
    return outcome


def assert_same_passages(one: HourOutcome, other: HourOutcome) -> None:
    assert len(one.passages) == len(other.passages) >= 10
    waited = 0
    for own, made in zip(one.passages, other.passages, strict=True):
        assert own.vehicle.plan.number == made.vehicle.plan.number
        assert own.vehicle.inserted_step == made.vehicle.inserted_step
        for name in ("trace.x_m", "trace.speed_mps", "delay_s", "control_delay_s"):
            value = attrgetter(name)
            assert value(own) == pytest.approx(value(made), abs=1e-6), name
        waited += min(own.trace.speed_mps) == 0
    assert waited >= 2, "or there is nothing to be the same in"


@pytest.mark.parametrize("strategy", ["gap_yield", "sumo_driver"])
def test_a_generated_network_named_as_ones_own_gives_its_own_hours(strategy: str) -> None:
    arms = {"arms": {"av": strategy}, "traffic": {"oncoming_per_hour": 300.0}}
    own = scenario_of({"net": str(CCTC), "edge": ":crosswalk_c0"}, **arms)
    made = scenario_of({"road_speed_limit_mps": 100.0}, **arms)
    assert_same_passages(hour_in(own), hour_in(made))


@pytest.mark.parametrize("lanes", [1, 2])
def test_a_curved_road_is_a_straight_one_of_its_length(tmp_path: Path, lanes: int) -> None:
    """Its inner lane is not as long, but vehicles enter 300 m upstream in either."""
    outcomes = []
    for turn_deg in (0.0, 60.0):
        road = replace(STRAIGHT, turn_deg=turn_deg, straight_m=240.0, lanes=lanes, lane_m=3.2)
        scenario = scenario_of(at(built(road, tmp_path / f"{turn_deg}")))
        outcomes.append(hour_in(scenario))
        assert {len(lane.stretches) for lane in road_for(scenario).lanes[:lanes]} == {3}
    assert {p.vehicle.plan.lane.name for p in outcomes[0].passages} == {
        *(f"forward-{lane}" for lane in range(lanes)),
        "oncoming-0",
    }
    assert_same_passages(*outcomes)


def test_x_is_where_sumo_has_the_vehicle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On the road of each lane when it comes to R0, after curve and junction, by SUMO's place."""
    road = replace(STRAIGHT, turn_deg=-50.0, straight_m=150.0, lanes=2, lane_m=3.2)
    net = built(road, tmp_path)
    scenario = scenario_of(at(net))
    frame = read_site(Place(net, ":cross_c0")).frame
    take_over, places = Hour._take_over, []

    def noted(self: Hour, moving: HourVehicle, lane: LaneOnRoad, step: int) -> None:
        x_m, y_m = frame.to_road(*road_for(scenario)._api.vehicle.getPosition(moving.name))
        sign = 1 if lane.lane.direction is Direction.FORWARD else -1
        places.append((sign * x_m - moving.x_m, y_m - lane.lane.centre_m))
        take_over(self, moving, lane, step)

    monkeypatch.setattr(Hour, "_take_over", noted)
    hour_in(scenario)
    assert len(places) >= 10
    np.testing.assert_allclose(places, 0.0, atol=0.001)


def test_one_vehicle_drives_as_in_a_generated_network(tmp_path: Path) -> None:
    """Before the crosswalk lanes end elsewhere: SUMO stops a millimetre sooner there."""
    people = [Arrival(number, 39.5 + number, Side.NEAR, 0.5) for number in range(4)]
    traces = []
    for crossing in (at(built(STRAIGHT, tmp_path)), {"road_speed_limit_mps": 13.89}):
        scenario = scenario_of(crossing, ego={"initial_speed_mps": 8.0})
        for strategy in ("gap_yield", "hard_yield", "human_yield"):
            _, _, (passage,) = hour_of(scenario, [[50], []], people, strategy)
            assert passage.record.pedestrians >= 2
            traces.append(passage.trace)
    for own, made in zip(traces[:3], traces[3:], strict=True):
        assert min(made.speed_mps) < 4.0
        np.testing.assert_allclose(own.x_m, made.x_m, atol=0.0011)
        np.testing.assert_allclose(own.speed_mps, made.speed_mps, atol=0.001)


def test_waiting_worked_out_by_hand_on_a_curved_road_of_two_lanes(tmp_path: Path) -> None:
    """As on the generated road, 9 m from kerb to kerb and 4 m wide, but at 300 m upstream.

    At 5 m/s, due at step 100 the front is at the near edge at 10 + 298/5 = 69.6 s, the rear leaves
    the far one at 10 + 307/5 = 71.4 s, in the other lane 2 s later: with a kerb wait of 2 s nobody
    goes from 67.6 s to 73.4 s. The oncoming approach is 130 m long: whoever is due there at step
    455, at 129.5 m, the whole steps of 0.5 m from 30 m on, is past at 45.5 + 136.5/5 = 72.8 s.
    """
    road = replace(STRAIGHT, lanes=2, lane_m=3.0, turn_deg=30.0, straight_m=240.0)
    scenario = scenario_of(
        at(built(road, tmp_path)),
        ego={"initial_speed_mps": 5.0},
        pedestrians={"flow_per_hour": 0.0, "kerb_wait_s": 2.0},
    )
    people = [Arrival(0, 67.5, Side.NEAR, 0.5), Arrival(1, 67.7, Side.FAR, 0.5)]
    _, log, passages = hour_of(scenario, [[100], [120], [455]], people, "constant_speed")
    assert [walk.start_s for walk in log.walks] == pytest.approx([67.5, 73.4], abs=1e-9)
    inserted = [passage.vehicle.insert_x_m for passage in passages]
    assert inserted == pytest.approx([-300.0, -300.0, -130.0], abs=0.51)
    passed = [passage.passed_s for passage in passages]
    ways = [7.0 - x_m for x_m in inserted]
    assert passed == pytest.approx([10 + ways[0] / 5, 12 + ways[1] / 5, 45.5 + ways[2] / 5])
    # Lanes of 3 m: who comes the ego's way is 1.5 and 4.5 m from the near kerb, the other 7.5 m.
    centres = [passage.vehicle.plan.lane.centre_m for passage in passages]
    assert centres == pytest.approx([1.5, 4.5, 7.5], abs=1e-6)


def with_edges(folder: Path, road: Road, old: str, new: str, nodes: str = "") -> Path:
    """A built network, built again of other edges and more nodes."""
    built(road, folder)
    for file, before, after in (("edges.xml", old, new), ("nodes.xml", "</nodes>", nodes)):
        text = (folder / file).read_text()
        assert before in text
        (folder / file).write_text(text.replace(before, after or before))
    files = ("-n", "nodes.xml", "-e", "edges.xml", "-x", "connections.xml", "-o", "city.net.xml")
    run_netconvert([*files, "--no-turnarounds", "--precision", "9"], folder)
    return folder / "city.net.xml"


def test_lanes_begin_where_they_are_one_lane(tmp_path: Path) -> None:
    """A road of one lane that widens 100 m before the crosswalk: its two lanes begin there."""
    road = replace(STRAIGHT, straight_m=100.0, lanes=2, lane_m=3.2)
    one = '<edge id="in" from="far" to="bend" numLanes='
    net = with_edges(tmp_path, road, f'{one}"2"', f'{one}"1"')
    streams = streams_of(read_site(Place(net, ":cross_c0")))
    assert [[each.edge for each in stream.stretches] for stream in streams] == [
        ["approach", "exit"],
        ["approach", "exit"],
        ["back_in", "back", "back_out"],
    ]
    assert -100.0 < streams[0].begins_x_m < -90.0
    check_everybody(hour_in(scenario_of(at(net))))
    with pytest.raises(InputError, match=r"approach_1 bends by .* or traffic\.flow_per_hour = 0"):
        scenario_of(at(net), ego={"trigger_range_m": 110.0})
    assert streams[0].entry_x_m(110.0, 0.8) is None
    entry_x_m = streams[0].entry_x_m(30.0, 0.8)
    assert entry_x_m == pytest.approx(streams[0].begins_x_m, abs=0.8)


def test_nobody_upstream_disturbs_a_stream(tmp_path: Path) -> None:
    """Where a road of higher priority joins, under a traffic light: nobody comes there."""
    side = '<node id="side" x="-200" y="-60"/></nodes>'
    arms = (
        '<edge id="side_in" from="side" to="bend" speed="13.89" priority="9"/>'
        '<edge id="side_out" from="bend" to="side" speed="13.89" priority="9"/></edges>'
    )
    road = replace(STRAIGHT, straight_m=100.0)
    for light in (False, True):
        folder = tmp_path / f"{light}"
        built(road, folder)
        bend = re.search(r'<node id="bend".*?/>', (folder / "nodes.xml").read_text())
        assert bend is not None
        lit = side.replace("</nodes>", bend[0].replace("priority", "traffic_light") + "</nodes>")
        net = with_edges(folder, road, "</edges>", arms, lit if light else side)
        passages = hour_in(scenario_of(at(net), arms={"av": "constant_speed"})).passages
        delays_s = [passage.delay_s for passage in passages]
        assert delays_s == pytest.approx([0.0] * len(passages), abs=1e-6)
        assert len(passages) > 10


def try_road(seed: int, folder: Path) -> bool:
    road = random_road(seed)
    flows = {"flow_per_hour": 600.0 * road.lanes, "oncoming_per_hour": 500.0 * road.oncoming}
    strategy = ["gap_yield", "hard_yield", "sumo_driver", "human_yield"][seed % 4]
    try:
        scenario = scenario_of(at(built(road, folder)), traffic=flows, arms={"av": strategy})
    except InputError:
        return False
    check_everybody(hour_in(scenario))
    return True


@pytest.mark.parametrize(
    ("seeds", "least"),
    [(range(302, 306), 3), pytest.param(range(400, 460), 50, marks=pytest.mark.slow)],
)
def test_random_roads_lose_nobody(tmp_path: Path, seeds: range, least: int) -> None:
    assert sum(try_road(seed, tmp_path / f"{seed}") for seed in seeds) >= least


def test_conditions_are_refused_with_their_figures(tmp_path: Path) -> None:
    net = built(replace(STRAIGHT, straight_m=50.0, turn_deg=60.0), tmp_path / "bend")
    with pytest.raises(InputError, match=r"lane approach_1 bends by .*at most 4\d.*flow_per_hour"):
        scenario_of(at(net), ego={"trigger_range_m": 70.0})
    one_way = built(Road(oncoming=0, lane_m=3.0), tmp_path / "one")
    with pytest.raises(InputError, match="600 vehicles per hour, but no lane for them; allowed: 0"):
        scenario_of(at(one_way))
    outcome = hour_in(scenario_of(at(one_way), traffic={"oncoming_per_hour": 0.0}))
    assert {passage.vehicle.plan.lane.name for passage in outcome.passages} == {"forward-0"}


def test_lanes_that_do_not_lead_straight_over_are_told(tmp_path: Path) -> None:
    """As if the second of two lanes turned before the crosswalk."""
    scenario = scenario_of(at(built(replace(STRAIGHT, lanes=2), tmp_path)))
    assert remarks(scenario) == []
    tree = scenario.model_dump()
    ways = tree["crossing"]["read"]["ways"]
    tree["crossing"]["read"]["ways"] = [ways[0], ways[2]]
    (remark,) = remarks(validate(tree, "manifest.json"))
    assert remark.startswith("traffic uses 1 of the 2 lanes of the ego's direction")
