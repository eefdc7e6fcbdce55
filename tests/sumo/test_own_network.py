"""A crosswalk in a network of one's own gives what one of the same geometry gives anywhere.

The networks are netconvert's and netgenerate's; lengths and angles are those they were asked for.
"""

import cmath
import gzip
import json
import math
import random
import re
import subprocess
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest
import sumo as sumo_package

from harness.core.errors import InputError
from harness.engine.network import build_network, network_of
from harness.engine.network.build import run_netconvert
from harness.engine.network.crossings import list_crossings, scenario_text
from harness.engine.network.osm import convert
from harness.engine.plain import PlainEngine
from harness.episode.pairing import PairRunner
from harness.scenario import Scenario, load_scenario, remarks, validate
from harness.scenario.sections import CrossingSection
from harness.site import Place, crosswalks_of, read_network, read_site, road_network
from tests.batches import CHECKOUT, here, printed, refusal
from tests.sites import NETWORKS
from tests.sumo.test_engines_agree import assert_same_episode

CCTC = NETWORKS / "cctc" / "cctc.net.xml"
MAPS = CHECKOUT / "examples" / "maps"
PEOPLE = {"flow_per_hour": 900.0, "first_at_trigger": True}


@dataclass(frozen=True)
class Road:
    """A street with sidewalks and one crosswalk: what netconvert is asked for."""

    lanes: int = 1
    oncoming: int = 1
    lane_m: float = 4.5
    width_m: float = 4.0
    bearing_deg: float = 40.0
    straight_m: float = 150.0
    turn_deg: float = 0.0
    arm_deg: float | None = None
    left_hand: bool = False
    signal: bool = False
    precision: int = 2
    oblique_deg: float = 90.0


def built(road: Road, folder: Path) -> Path:
    """A network with `straight_m` of road before the crosswalk's junction, and a turn before it."""
    along = cmath.rect(1, math.radians(90 - road.bearing_deg))
    turn = cmath.rect(1, math.radians(road.turn_deg))
    bend = -road.straight_m * along
    places = {"far": bend - 120 * along * turn, "bend": bend, "cross": 0j, "end": 130 * along}
    edges = [
        ("in", "far", "bend", road.lanes),
        ("approach", "bend", "cross", road.lanes),
        ("exit", "cross", "end", road.lanes),
        ("back_in", "end", "cross", road.oncoming),
        ("back", "cross", "bend", road.oncoming),
        ("back_out", "bend", "far", road.oncoming),
    ]
    if road.arm_deg is not None:
        places["arm"] = 100 * along * cmath.rect(1, math.radians(road.arm_deg))
        edges += [("arm_in", "arm", "cross", 1), ("arm_out", "cross", "arm", 1)]
    folder.mkdir(parents=True, exist_ok=True)
    if not road.oncoming:  # the other side of a one-way street has no sidewalk
        places["path"] = 40j * along * (-1 if road.left_hand else 1)
    light = "traffic_light" if road.signal else "priority"
    nodes = [
        f'<node id="{name}" x="{at.real:.6f}" y="{at.imag:.6f}"'
        f' type="{light if name == "cross" else "priority"}"/>'
        for name, at in places.items()
    ]
    lines = [
        f'<edge id="{name}" from="{a}" to="{b}" numLanes="{lanes}" width="{road.lane_m}"'
        f' speed="13.89" sidewalkWidth="2" priority="{1 if "arm" in name else 5}"/>'
        for name, a, b, lanes in edges
        if lanes
    ]
    if not road.oncoming:
        lines.append('<edge id="foot" from="cross" to="path" allow="pedestrian" width="2"/>')
    crossed = "approach back" if road.oncoming else "approach"
    shape = ""
    if road.oblique_deg != 90.0:  # from kerb to kerb, about the junction's centre
        slope = 1 / math.tan(math.radians(road.oblique_deg))
        ends = [side * road.lane_m * along * complex(slope, 1) for side in (-1, 1)]
        shape = f' shape="{" ".join(f"{end.real:.6f},{end.imag:.6f}" for end in ends)}"'
    crossing = (
        f'<crossing node="cross" edges="{crossed}" width="{road.width_m}" priority="true"{shape}/>'
    )
    tables = {"nodes": "".join(nodes), "edges": "".join(lines), "connections": crossing}
    more = ["--lefthand"] if road.left_hand else []
    return converted(folder, tables, "--precision", str(road.precision), *more)


def converted(folder: Path, tables: dict[str, str], *options: str) -> Path:
    """What netconvert makes of the content of those tables."""
    letters, words = {"nodes": "-n", "edges": "-e", "connections": "-x"}, []
    for kind, rows in tables.items():
        (folder / f"{kind}.xml").write_text(f"<{kind}>{rows}</{kind}>")
        words += [letters[kind], f"{kind}.xml"]
    run_netconvert([*words, "-o", "city.net.xml", "--no-turnarounds", *options], folder)
    return folder / "city.net.xml"


def test_the_turn_over_a_crosswalk_is_that_of_the_lanes_next_to_it(tmp_path: Path) -> None:
    # The side street comes from the east and bends: its last 50 m lead north, to a left turn.
    places = {"west": (-100, 0), "cross": (0, 0), "east": (100, 0), "side": (80, -90)}
    edges = ("west cross", "cross east", "east cross", "cross west", "side cross")
    net = converted(
        tmp_path,
        {
            "nodes": "".join(
                f'<node id="{name}" x="{x}" y="{y}" type="priority"/>'
                for name, (x, y) in places.items()
            ),
            "edges": "".join(
                f'<edge id="{edge.replace(" ", "_")}" from="{edge.split()[0]}"'
                f' to="{edge.split()[1]}" numLanes="1" speed="13.89" sidewalkWidth="2"'
                + (' shape="80,-90 0,-50 0,0"/>' if edge == "side cross" else "/>")
                for edge in edges
            ),
            "connections": '<crossing node="cross" edges="west_cross cross_west" width="4"/>',
        },
    )
    (crosswalk,) = crosswalks_of(read_network(net))
    turns = {way.from_edge: way.turn_deg for way in crosswalk.ways}
    expected = {"west_cross": 0.0, "east_cross": 0.0, "side_cross": 90.0}
    assert turns == pytest.approx(expected, abs=0.1)


def scene(net: Path, edge: str, **more: dict[str, object]) -> Scenario:
    tree = {"crossing": {"net": str(net), "edge": edge}, "pedestrians": PEOPLE, **more}
    return validate(tree, "test")


def play(scenario: Scenario, model, engine) -> list:
    return list(PairRunner(scenario, model, engine).run(range(3)))


def play_both(scenario: Scenario, model, sumo) -> int:
    """The same episodes in SUMO and on the plain engine; returns how many people were met."""
    step_s = scenario.experiment.step_s
    plain = play(scenario, model, lambda: PlainEngine(scenario.vehicle(), step_s))
    met = 0
    for one, other in zip(play(scenario, model, lambda: sumo(scenario)), plain, strict=True):
        assert_same_episode(one, other, (scenario.crossing, one.pair, one.arm))
        met += one.record.pedestrians
    return met


def refused(net: Path, edge: str, **more: dict[str, object]) -> str:
    with pytest.raises(InputError) as caught:
        scene(net, edge, **more)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_generated_network_named_as_ones_own_gives_its_own_results(model, sumo) -> None:
    made = load_scenario("cctc_flow").model_copy(
        update={"crossing": CrossingSection(road_speed_limit_mps=100.0)}
    )
    own = validate({**made.model_dump(exclude={"crossing"}), "crossing": {
        "net": str(CCTC), "edge": ":crosswalk_c0"}}, "test")  # fmt: skip
    assert own.crosswalk().lane_centre_m == pytest.approx(2.25, abs=1e-7)
    assert own.crossing.latitude_deg == pytest.approx(42.278415, abs=1e-8)
    assert own.crossing.longitude_deg == pytest.approx(-83.735580, abs=1e-8)
    assert own.crossing.bearing_deg == pytest.approx(316.5, abs=1e-3)
    assert_played_alike(own, made, model, sumo)


def assert_played_alike(own: Scenario, made: Scenario, model, sumo) -> int:
    """The same episodes of both in SUMO; returns how many people were met."""
    pairs = (play(scenario, model, lambda s=scenario: sumo(s)) for scenario in (own, made))
    met = 0
    for one, other in zip(*pairs, strict=True):
        assert one.record.sumo_collision == other.record.sumo_collision
        assert one.record.ending == other.record.ending
        assert one.trace.x_m == pytest.approx(other.trace.x_m, abs=1e-6)
        assert one.trace.speed_mps == pytest.approx(other.trace.speed_mps, abs=1e-6)
        assert len(one.trace.walks) == len(other.trace.walks)
        met += one.record.pedestrians
    return met


def test_a_street_with_sidewalks_gives_what_the_generated_road_gives(
    tmp_path: Path, model, sumo
) -> None:
    net = built(Road(precision=9), tmp_path)
    own = scene(net, ":cross_c0")
    made = validate({"pedestrians": PEOPLE}, "test")  # 9 m, two lanes of 4.5 m, 4 m wide
    crosswalk, same = own.crosswalk(), made.crosswalk()
    for name in ("length_m", "width_m", "lane_centre_m", "lane_width_m"):
        assert getattr(crosswalk, name) == pytest.approx(getattr(same, name), abs=1e-7)
    assert assert_played_alike(own, made, model, sumo) > 6


def test_what_is_read_is_what_was_asked_for(tmp_path: Path) -> None:
    for lanes, oncoming in ((1, 1), (2, 3), (3, 0)):
        net = built(Road(lanes=lanes, oncoming=oncoming, lane_m=3.0), tmp_path / str(lanes))
        for lane in range(lanes):
            site = read_site(Place(net, ":cross_c0", f"approach_{lane + 1}"))
            assert (site.lanes, site.oncoming_lanes) == (lanes, oncoming)
            assert site.length_m == pytest.approx(3.0 * (lanes + oncoming), abs=0.03)
            assert site.ego.centre_m == pytest.approx(3.0 * (lane + 0.5), abs=0.03)
            assert site.bearing_deg == pytest.approx(40.0, abs=0.1)
            assert [way.oncoming for way in site.ways] == [False] * lanes + [True] * oncoming
            assert [way.index for way in site.ways] == [*range(lanes), *range(oncoming)]
            assert site.width_m == pytest.approx(4.0, abs=0.01)
    # So is a network that the harness builds.
    crossing = CrossingSection(length_m=14.0, lanes=2, oncoming_lanes=2, bearing_deg=77.0)
    net = build_network(crossing, tmp_path / "four", "four").net
    site = read_site(Place(net, lane=1))
    assert site.length_m == pytest.approx(14.0, abs=1e-6)
    assert site.ego.centre_m == pytest.approx(5.25, abs=1e-6)
    assert [way.centre_m for way in site.ways] == pytest.approx([1.75, 5.25, 12.25, 8.75], abs=1e-6)


def test_an_oblique_crosswalk_is_walked_along_its_own_line(tmp_path: Path, model, sumo) -> None:
    net = built(Road(oblique_deg=75.0, precision=6), tmp_path)
    own = scene(net, ":cross_c0")
    assert own.crossing.read is not None
    assert own.crossing.read.angle_deg == pytest.approx(75.0, abs=1e-3)
    # Two lanes of 4.5 m, cut at 75 degrees.
    slant = math.sin(math.radians(75.0))
    assert own.crossing.length_m == pytest.approx(9.0 / slant, abs=1e-4)
    assert own.crosswalk().lane_centre_m == pytest.approx(2.25 / slant, abs=1e-4)
    assert play_both(own, model, sumo) > 6


def test_a_one_way_street_of_one_lane(tmp_path: Path, model, sumo) -> None:
    net = built(Road(oncoming=0, lane_m=3.0), tmp_path / "usable")
    (row,) = list_crossings(read_network(net))
    assert (row.usable, row.oncoming_lanes) == (True, 0)
    assert row.length_m == pytest.approx(3.0, abs=0.03)
    assert play_both(scene(net, row.edge), model, sumo) > 6
    # 1.8 m in the middle of 2.5 m leave 0.35 m, and 2.1 m leave 0.2 m: less than a body's 0.25 m.
    geometry = {"length_m": 2.5, "oncoming_lanes": 0}
    validate({"crossing": geometry}, "test")
    with pytest.raises(InputError, match=r"leaves 0\.20 m to a kerb.*at least 0\.25 m"):
        validate({"crossing": geometry, "ego": {"width_m": 2.1}}, "test")


def test_a_written_trigger_lies_on_a_lane(tmp_path: Path) -> None:
    # Six seconds at 13.89 m/s are 83.3 m; the junction of the bend ends short of that.
    net = built(Road(straight_m=83.3, arm_deg=90.0), tmp_path)
    (row,) = list_crossings(read_network(net))
    path = tmp_path / "written.toml"
    path.write_text(scenario_text(net, row), encoding="utf-8")
    assert 30.0 < load_scenario(path).ego.trigger_range_m <= 83.34


def random_road(seed: int) -> Road:
    rng = random.Random(seed)
    return Road(
        lanes=rng.randint(1, 3),
        oncoming=rng.randint(0, 3),
        lane_m=rng.choice([2.8, 3.2, 3.65]),
        width_m=rng.choice([2.0, 3.0, 4.0, 6.0]),
        bearing_deg=rng.uniform(0, 360),
        straight_m=rng.uniform(60, 160),
        turn_deg=rng.choice([0.0, rng.uniform(15, 90), -rng.uniform(15, 90)]),
        arm_deg=rng.choice([None, None, rng.uniform(60, 120), -rng.uniform(60, 120)]),
        left_hand=rng.random() < 0.3,
    )


def try_road(seed: int, folder: Path, model, sumo) -> bool:
    """Whether a random road's crosswalk is usable; then it is run, and its row is true."""
    road = random_road(seed)
    net = built(road, folder)
    (row,) = list_crossings(read_network(net))
    if not row.usable:
        # Whatever the reason is, it has a figure.
        assert any(char.isdigit() for char in row.problem or ""), (road, row.problem)
        return False
    assert (row.lanes, row.oncoming_lanes) == (road.lanes, road.oncoming), road
    assert row.straight_m is not None
    if abs(road.turn_deg) > 1:
        assert row.straight_m < road.straight_m + 20, road
    range_m = min(60.0, math.floor(row.straight_m))
    scenario = scene(net, row.edge, ego={"trigger_range_m": range_m, "initial_speed_mps": 8.0})
    assert play_both(scenario, model, sumo) > 0, road
    return True


@pytest.mark.parametrize(
    ("seeds", "least"),
    [(range(3, 8), 4), pytest.param(range(100, 220), 100, marks=pytest.mark.slow)],
)
def test_random_roads(tmp_path: Path, seeds: range, least: int, model, sumo) -> None:
    assert sum(try_road(seed, tmp_path / str(seed), model, sumo) for seed in seeds) >= least


def test_conditions_are_refused_with_their_figures(tmp_path: Path, model, sumo) -> None:
    """A light that is ignored changes nothing."""
    turn = built(Road(turn_deg=60.0, straight_m=50.0), tmp_path / "turn")
    assert "bends by" in (text := refused(turn, ":cross_c0", ego={"trigger_range_m": 70.0}))
    assert "at most 4" in text or "at most 5" in text
    signal = built(Road(signal=True), tmp_path / "signal")
    assert "traffic light cross controls it" in refused(signal, ":cross_c0")
    crossing = {"net": str(signal), "edge": ":cross_c0", "ignore_signal": True}
    green = validate({"crossing": crossing, "pedestrians": PEOPLE}, "test")
    assert green.crosswalk().length_m == pytest.approx(9.0, abs=0.03)
    assert play_both(green, model, sumo)
    net = built(Road(), tmp_path / "plain")
    assert "one of its 1 crossings" in (text := refused(net, ":cross_c7"))
    assert "did you mean ':cross_c0'" in text
    place = {"net": str(net), "edge": ":cross_c0"}
    for crossing, words in (
        ({**place, "length_m": 9.0}, r"crossing\.length_m: cannot be combined with crossing\.net"),
        (
            {**place, "approach": "exit_1"},
            r"'exit_1' does not lead over the crosswalk; allowed: approach_1",
        ),
        ({"net": str(net)}, r"crossing\.edge: is not given"),
    ):
        with pytest.raises(InputError, match=words):
            validate({"crossing": crossing}, "test")
    narrow = built(Road(lane_m=1.0, lanes=3, oncoming=3), tmp_path / "narrow")
    assert "1.8 m is wider than the lane" in refused(narrow, ":cross_c0")


def test_what_the_ego_passes_is_said(tmp_path: Path) -> None:
    """Two junctions 100 m apart, drawn by hand: a light and a crosswalk at the first."""
    tracks = {"w": -250, "light": -100, "cross": 0, "e": 130}
    kind = {"light": "traffic_light"}
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="0" type="{kind.get(name, "priority")}"/>'
        for name, x in tracks.items()
    )
    names = list(tracks)
    edges = "".join(
        f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="1" speed="13.89" sidewalkWidth="2"/>'
        for one, other in pairwise(names)
        for a, b in ((one, other), (other, one))
    )
    walks = "".join(
        f'<crossing node="{node}" edges="{before}{node} {node}{before}" priority="true"/>'
        for before, node in (("w", "light"), ("light", "cross"))
    )
    net = converted(tmp_path, {"nodes": nodes, "edges": edges, "connections": walks})
    listed = {row.edge: row for row in list_crossings(read_network(net))}
    # From 83.3 m, six seconds at 50 km/h, the ego comes past nothing else.
    assert listed[":cross_c0"].passed == ()
    near, far = (
        scene(net, ":cross_c0", ego={"trigger_range_m": range_m}, arms={"human": "human_yield"})
        for range_m in (60.0, 130.0)
    )
    assert remarks(near) == []
    light, walk = sorted(remarks(far), reverse=True)
    assert re.match(r"the ego passes the traffic light light \d+ m before the crosswalk: st", light)
    assert re.match(r"the ego passes the crosswalk :light_c0 10\d m before the crosswalk: s", walk)
    assert 85 <= float(light.split()[7]) <= 115  # where the lane ends before its junction
    # Its own light is no surprise: it is refused unless it is ignored, and the list says how.
    row = listed[":light_c0"]
    assert not row.usable
    assert "--ignore-signal" in (row.problem or "")
    assert "--ignore-signal" in refusal("crossings", net, "--write", "a.toml", "--edge", row.edge)
    out = tmp_path / "green.toml"
    printed("crossings", net, "--ignore-signal", "--write", out, "--edge", row.edge)
    assert load_scenario(out).crossing.ignore_signal
    assert "stays green" in remarks(load_scenario(out))[0]


def test_a_network_without_a_crossing_says_what_to_do(tmp_path: Path) -> None:
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="9" y="0"/>'
    net = converted(tmp_path, {"nodes": nodes, "edges": '<edge id="ab" from="a" to="b"/>'})
    done = here("crossings", net)
    assert (done.returncode, "0 crossings, 0 usable" in done.stdout) == (0, True)
    assert "netconvert -s THIS --sidewalks.guess --crossings.guess" in done.stderr

    net = built(Road(turn_deg=60.0, straight_m=20.0), tmp_path / "short")
    (row,) = list_crossings(read_network(net))
    sentence = (
        r"a trigger range of 30 m exceeds the straight approach, which bends by \d\.\d° "
        r"1\d\.\d m before the crosswalk; allowed: at most 1\d\.\d+ m"
    )
    assert re.fullmatch(sentence, row.problem or ""), row.problem


def test_a_network_that_has_changed_is_refused(tmp_path: Path) -> None:
    net = built(Road(), tmp_path)
    planned = scene(net, ":cross_c0")
    recalled = validate(planned.model_dump(), "manifest.json")
    assert recalled == planned
    assert network_of(recalled) == net
    net.write_text(net.read_text() + "<!-- changed -->\n")
    with pytest.raises(InputError, match=r"crossing\.net: .* has changed \(sha256"):
        network_of(recalled)
    net.unlink()
    # What needs no simulation, a report of the run, needs no network.
    assert validate(planned.model_dump(), "manifest.json") == planned


def test_hostile_networks_get_one_line(tmp_path: Path) -> None:
    text = built(Road(), tmp_path).read_text()
    hostile = {
        "cut": text[: len(text) // 2],
        "word": "nothing of that",
        "other": "<edges/>",
        "garbage": '<net><edge id="a"/></net>',
        "number": text.replace('width="4.00"', 'width="four"'),
        "nan": text.replace('width="4.00"', 'width="nan"'),
        "endless": text.replace('width="4.00"', 'width="1e9"'),
        "point": re.sub(r'(width="4.00" shape=)"[^"]*"', r'\1"0,0"', text),
        "reference": text.replace('crossingEdges="back approach"', 'crossingEdges="none"'),
        "unplaced": re.sub("<location[^>]*>", "", text),
    }
    for name, content in hostile.items():
        path = tmp_path / f"{name}.net.xml"
        path.write_text(content)
        with pytest.raises(InputError) as caught:
            read_network(path)
        assert "\n" not in str(caught.value)
    path.write_text(text.replace(":cross_c0", ":cross_&lt;b&gt;[31m_c0"))
    (row,) = list_crossings(read_network(path))
    assert not row.usable
    assert "\n" not in (row.problem or "")
    refusal("crossings", tmp_path / "cut.net.xml")
    (row,) = json.loads(printed("crossings", tmp_path / "city.net.xml", "--json"))["crossings"]
    assert (row["edge"], row["usable"], row["longitude_deg"]) == (":cross_c0", True, None)


def test_a_packed_network_of_lanes_for_all_is_read_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    net, packed = built(Road(), tmp_path), tmp_path / "packed.net.xml.gz"
    text, cars, everybody = net.read_text(), 'disallow="pedestrian"', 'allow="all"'
    assert cars in text
    packed.write_bytes(gzip.compress(text.replace(cars, everybody).encode()))
    assert list_crossings(read_network(packed)) == list_crossings(read_network(net))
    monkeypatch.setattr(road_network, "_MOST_BYTES", len(text) // 2)
    with pytest.raises(InputError, match="MB unpacked; allowed: a part of it"):
        read_network(packed)


def test_a_mid_block_zebra_of_a_map(tmp_path: Path, model, sumo) -> None:
    converted = convert(MAPS / "zebra.osm", tmp_path)
    (row,) = list_crossings(read_network(converted.net))
    assert row.usable
    assert row.pedestrian_priority
    assert row.streets == ("Main Street",)
    assert (row.latitude_deg, row.longitude_deg) == pytest.approx((42.3, -83.7), abs=3e-5)
    assert row.speed_limit_mps == pytest.approx(30 / 3.6, abs=1e-3)
    path = tmp_path / "zebra.toml"
    path.write_text(scenario_text(converted.net, row), encoding="utf-8")
    scenario = load_scenario(path)
    assert scenario.arms.human == "human_yield"  # 30 km/h is above 8 m/s
    assert scenario.strategies["human_yield"]["reaction_time_s"] == 1.0
    assert scenario.pedestrians.behaviour == "threshold"
    assert play_both(scenario, model, sumo) > 0


@pytest.mark.parametrize("nodes", [(4, 2, 5), (4, 2)])
@pytest.mark.parametrize("kind", ["footway", "cycleway"])
def test_a_footway_that_meets_a_zebra_adds_no_crossing(
    tmp_path: Path, nodes: tuple[int, ...], kind: str, model, sumo
) -> None:
    """One zebra is painted there: SUMO's two lay 1.5 m apart, and both were called usable."""
    text = (MAPS / "zebra.osm").read_text()
    footway = "".join(f'<nd ref="{node}"/>' for node in nodes)
    footway = f'<way id="11" version="1">{footway}<tag k="highway" v="{kind}"/></way>'
    node = '<node id="{}" version="1" lat="{}" lon="-83.7000"/>'
    ends = node.format(4, 42.3004) + node.format(5, 42.2996)
    text = text.replace('<way id="10"', f'{ends}<way id="10"').replace("</osm>", f"{footway}</osm>")
    (tmp_path / "met.osm").write_text(text)
    converted = convert(tmp_path / "met.osm", tmp_path / "out")
    (row,) = list_crossings(read_network(converted.net))
    assert row.usable
    assert row.pedestrian_priority
    if kind == "footway":
        assert play_both(scene(converted.net, row.edge), model, sumo) > 0


def test_the_tags_of_a_map_decide_priority(tmp_path: Path) -> None:
    converted = convert(MAPS / "four_arms.osm", tmp_path)
    rows = {row.junction: row for row in list_crossings(read_network(converted.net))}
    assert rows["6"].pedestrian_priority  # marked
    assert not rows["7"].pedestrian_priority  # unmarked
    assert "8" not in rows  # no crossing
    assert rows["9"].pedestrian_priority  # uncontrolled, with an island
    assert [remark for remark in converted.remarks if "island" in remark]
    script = (tmp_path / "four_arms.commands.sh").read_text()
    assert script.count("netconvert ") == 2
    with pytest.raises(InputError, match="the file does not exist"):
        convert(tmp_path / "none.osm", tmp_path)


def test_a_grid_is_listed_and_run(tmp_path: Path, model, sumo) -> None:
    program = Path(sumo_package.SUMO_HOME) / "bin" / "netgenerate"
    words = "--grid --grid.number 3 --grid.length 150 --default.lanenumber 2 --sidewalks.guess"
    net = tmp_path / "grid.net.xml"
    command = [program, *words.split(), "--crossings.guess", "-o", net]
    subprocess.run(command, check=True, capture_output=True)
    rows = list_crossings(read_network(net))
    assert len(rows) == 20
    assert [row.usable for row in rows] == sorted((row.usable for row in rows), reverse=True)
    middle = [row for row in rows if row.junction == "B1"]
    assert [row.usable for row in middle] == [True] * 4
    for row in middle[:2]:
        # Lanes of 3.2 m, two each way; the junctions are 150 m apart, the crosswalk 18.8 m from
        # the far edge of its own and 10.4 m from the other's lane ends.
        assert row.length_m == pytest.approx(12.8, abs=0.02)
        assert play_both(scene(net, row.edge), model, sumo) > 0
