"""Paths, zones and towns against SUMO's own positions, angles and right of way."""

import tomllib
from collections import Counter, defaultdict, namedtuple
from collections.abc import Iterator
from pathlib import Path

import libsumo
import numpy as np
import pytest
import shapely

from harness.core.errors import EngineError
from harness.core.vocabulary import FloatArray
from harness.engine.ids import edge_of
from harness.engine.protocol import CAR
from harness.engine.session import Session, interface, vehicle_types
from harness.engine.town_reader import read_town
from harness.simulation.listing import crossings_of, scenario_text
from harness.site.town import NO_VEHICLES, RAIL, Town
from harness.site.zone import zone_of
from tests.scenes import refuses
from tests.towns import call, grid, town, write_config

POINT_M = (0.5, 1e-6)
"""Length and width of a body whose front is a point."""
QUIET = {"no-step-log": "true", "no-warnings": "true"}


Seen = namedtuple("Seen", "connection s place bodies length_m width_m")
"""A vehicle on a connection by SUMO: s by its odometer, where it is, and its body there."""


def driven(config: Path, end_s: float) -> Iterator[tuple[list[str], FloatArray, float, float]]:
    """Of every vehicle: its lanes, (position, odometer, x, y, angle) at each step, and its size."""
    lanes, rows, sizes = defaultdict(list), defaultdict(list), {}
    session = Session(config, QUIET)
    cars = session.vehicles
    while session.goes_on(end_s):
        session.step()
        for name in cars.ids():
            lanes[name].append(cars.lane(name))
            moved = (cars.lane_position_m(name), cars.odometer_m(name))
            place = libsumo.vehicle.getPosition(name)
            rows[name].append((*moved, *place, libsumo.vehicle.getAngle(name)))
            sizes[name] = session.built(name)[:2]
    session.close()
    return ((lanes[name], np.array(rows[name]), *sizes[name]) for name in rows)


def seen(town: Town, config: Path, end_s: float) -> Iterator[Seen]:
    """Every vehicle's way over a junction, from the lane before it to the lane beyond it."""
    every = {each for at in town.crosswalks.values() for each in at.connections}
    by_lane = {each.via[0]: each for each in every}
    for lanes, rows, length_m, width_m in driven(config, end_s):
        for i in range(1, len(lanes)):
            found = by_lane.get(lanes[i]) if lanes[i] != lanes[i - 1] else None
            if found is None or lanes[i - 1] != found.from_lane:
                continue
            start = i
            while start and lanes[start - 1] == found.from_lane:
                start -= 1
            road = town.path(found)
            ahead = {lane.id: at for lane, at in zip(road.lanes, road.starts_m, strict=False)}
            end = i
            while end < len(lanes) and lanes[end] in ahead:
                end += 1
            # The odometer's value at the stop line, taken once: when the lane is entered.
            at_m = ahead[lanes[start]] + rows[start, 0]
            _, odometer_m, x, y, angle_deg = rows[start:end].T
            front, heading = x + 1j * y, np.exp(1j * np.radians(90.0 - angle_deg))
            left, rear = heading * 1j * width_m / 2, front - length_m * heading
            corners = np.stack([front - left, front + left, rear + left, rear - left], axis=1)
            bodies = np.stack([corners.real, corners.imag], axis=2)
            s = odometer_m - odometer_m[0] + at_m
            yield Seen(found, s, front, bodies, length_m, width_m)


def step_of(hits: "np.ndarray[tuple[int], np.dtype[np.bool_]]") -> int | None:
    return int(np.argmax(hits)) if hits.any() else None


TOWNS = [("stretched", 25, 150), ("left", 24, 150)]
SLOW = [("", 21, 600), ("", 22, 600), ("", 27, 600), ("lanes", 23, 300), ("zebras", 26, 300)]


@pytest.mark.parametrize(
    ("kind", "seed", "end_s"),
    [*TOWNS, *(pytest.param(*each, marks=pytest.mark.slow) for each in SLOW)],
)
def test_vehicles_are_where_their_path_says(
    tmp_path: Path, kind: str, seed: int, end_s: int
) -> None:
    """In SUMO's step: the front point in 99.5 %, the body's first and last touch within one."""
    config = town(tmp_path, seed, end_s, kind=kind)
    here = read_town(tmp_path / "net.net.xml")
    assert {each.left_hand for each in here.crosswalks.values()} == {kind == "left"}
    assert {each.refused for each in here.crosswalks.values()} == {None}
    assert {each.prioritized for each in here.crosswalks.values()} == {kind == "zebras"}
    zones = {}
    fronts, firsts, lasts, manoeuvres = Counter(), Counter(), Counter(), Counter()
    for each in seen(here, config, end_s):
        road = here.path(each.connection)
        np.testing.assert_allclose(road.position(each.s), each.place, atol=1e-3)
        outlines = road.outline(each.s, each.length_m, each.width_m)
        known = each.s - each.length_m > road.starts_m[0]  # before it, the rear is on another lane
        np.testing.assert_allclose(outlines[known], each.bodies[known], atol=2e-3)
        there = each.connection.via[0].rsplit("_", 2)[0]
        for crosswalk in (at for at in here.crosswalks.values() if at.id[: -len("_c0")] == there):
            body = zone_of(road, crosswalk, each.length_m, each.width_m)
            point = zone_of(road, crosswalk, *POINT_M)
            size = each.length_m, each.width_m
            zones[each.connection, crosswalk, size] = body
            zones[each.connection, crosswalk, POINT_M] = point
            touching = shapely.intersects(shapely.polygons(each.bodies), crosswalk.area)
            if body is None or each.s[-1] < body.last_m:
                assert body is not None or not touching.any()
                continue
            inside = shapely.contains_xy(crosswalk.area, each.place.real, each.place.imag)
            within = (each.s >= body.first_m) & (each.s <= body.last_m)
            assert touching.any() or not within.any() or body.split
            if touching.any():
                firsts[(step_of(touching) or 0) - (step_of(within) or 0)] += 1
                lasts[(step_of(touching[::-1]) or 0) - (step_of(within[::-1]) or 0)] += 1
                manoeuvres[each.connection.manoeuvre] += 1
            if point is not None and inside.any() and not inside[0]:
                fronts[(step_of(inside) or 0) - (step_of(each.s >= point.first_m) or 0)] += 1
    assert fronts.total() > 500
    assert fronts[0] >= 0.995 * fronts.total()
    assert set(firsts) <= {-1, 0, 1}
    assert set(lasts) <= {-1, 0, 1}
    assert min(manoeuvres[name] for name in ("straight", "left", "right")) > 50
    split = sum(each is not None and each.split for each in zones.values())
    assert split <= 0.02 * len(zones)


@pytest.fixture(scope="module")
def junctions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A side street at a main road; the road's end; a footway over a railway."""
    folder = tmp_path_factory.mktemp("junctions")
    nodes = {"w": (-100, 0), "c": (0, 0), "e": (100, 0), "n": (0, 100)}
    nodes |= {"a": (300, -50), "x": (300, 0), "b": (300, 50), "p": (250, 0), "q": (350, 0)}
    main, side = 'priority="3" sidewalkWidth="2"', 'priority="1" sidewalkWidth="2"'
    roads = {"w c": main, "c e": main, "n c": side, "a x": 'allow="rail"', "x b": 'allow="rail"'}
    roads |= dict.fromkeys(("p x", "x q"), 'allow="pedestrian" width="2"')
    edges = "".join(
        f'<edge id="{a}_{b}" from="{a}" to="{b}" numLanes="1" speed="13.9" {how}/>'
        for ends, how in roads.items()
        for a, b in (ends.split(), ends.split()[::-1])
    )
    points = (f'<node id="{each}" x="{x}" y="{y}"/>' for each, (x, y) in nodes.items())
    (folder / "n.nod.xml").write_text(f"<nodes>{''.join(points)}</nodes>")
    (folder / "e.edg.xml").write_text(f"<edges>{edges}</edges>")
    (folder / "c.con.xml").write_text(
        """<connections><crossing node="c" edges="w_c c_w"/><crossing node="e" edges="c_e e_c"/>
        <crossing node="c" edges="n_c c_n" priority="1"/><crossing node="x" edges="a_x x_a"/>
        </connections>"""
    )
    files = ("-n", "n.nod.xml", "-e", "e.edg.xml", "-x", "c.con.xml", "-o", "net.net.xml")
    call(folder, "netconvert", *files, "--no-turnarounds")
    return folder / "net.net.xml"


def test_who_gives_way_and_what_is_refused(junctions: Path) -> None:
    """By the rules of the road; a zebra alone makes no connection give way to vehicles."""
    here = read_town(junctions)
    by_roads = {frozenset(each.roads): each for each in here.crosswalks.values()}
    zebra, street = by_roads[frozenset(["n_c", "c_n"])], by_roads[frozenset(["w_c", "c_w"])]
    assert (zebra.prioritized, street.prioritized) == (True, False)
    assert zebra.refused is street.refused is None
    assert by_roads[frozenset(["c_e", "e_c"])].refused == NO_VEHICLES
    assert by_roads[frozenset(["a_x", "x_a"])].refused == RAIL
    rules = {
        (each.from_lane[:3], each.to_lane[:3]): (each.manoeuvre, each.gives_way)
        for each in zebra.connections
    }
    assert rules == {
        ("w_c", "c_e"): ("straight", False),
        ("e_c", "c_w"): ("straight", False),
        ("e_c", "c_n"): ("right", False),  # over the zebra
        ("w_c", "c_n"): ("left", True),  # through oncoming traffic
        ("n_c", "c_e"): ("left", True),
        ("n_c", "c_w"): ("right", True),
    }


@pytest.fixture(scope="module")
def busy(junctions: Path) -> Path:
    """Within an hour: six vehicles turn left, three go straight on, two people walk."""
    cars = "".join(
        f'<flow id="{start}" begin="0" end="3000" number="{number}" from="{start}" to="{end}"/>'
        for start, end, number in (("w_c", "c_n", 6), ("e_c", "c_w", 3))
    )
    people = "".join(
        f'<person id="p{n}" depart="{1300 + n}" departPos="80"><walk edges="w_c c_w"/></person>'
        for n in range(2)
    )
    (junctions.parent / "r.rou.xml").write_text(f"<routes>{cars}{people}</routes>")
    files = {"net-file": "net.net.xml", "route-files": "r.rou.xml", "end": "3600"}
    return write_config(junctions.parent, {**files, "step-length": "1"})


def test_who_passes_a_crosswalk(busy: Path, tmp_path: Path) -> None:
    usable, refused = crossings_of(busy, tmp_path)
    rows = {frozenset(each.roads.split(" / ")): each for each in usable + refused}
    street, zebra = rows[frozenset(["w_c", "c_w"])], rows[frozenset(["n_c", "c_n"])]
    assert street[2:8] == (9, 2, 3, 6, 0, 0)
    assert zebra[2:8] == (6, 0, 0, 6, 0, 0)
    assert next(iter(rows.values())) == street  # the busiest stands first
    assert [each.refused for each in rows.values()] == [None, None, NO_VEHICLES, RAIL]


def test_a_scenario_for_chosen_crosswalks(busy: Path, tmp_path: Path) -> None:
    names = [each.crosswalk for rows in crossings_of(busy, tmp_path) for each in rows]
    text = scenario_text(busy, names[:1], busy)
    scenario = tomllib.loads(text)
    assert scenario["simulation"]["file"] == busy.as_posix()
    assert scenario["simulation"]["crossings"] == names[:1]
    assert scenario["simulation"]["step_s"] == 0.1  # the configuration's is 1 s
    # v²/2a with 13.9 m/s and 2 m/s² is 48.3 m; in steps of 5 m.
    assert scenario["ego"]["trigger_range_m"] == 50.0
    refuses("a railway leads over it", lambda: scenario_text(busy, names[-1:], busy))
    refuses(r"did you mean ':c_c\d'", lambda: scenario_text(busy, [":c_c9"], busy))


def test_a_path_begins_upstream_where_one_lane_leads_on(junctions: Path) -> None:
    here = read_town(junctions)
    # Of the lanes at the junction c, only c_e is entered from two lanes, w_c and n_c.
    path = here.path(next(way for way in here.connections.values() if way.from_lane == "w_c_1"))
    assert path.lanes[0].id == "w_c_1"  # nothing is upstream
    assert path.starts_m[0] == pytest.approx(-100.0, abs=10.0)


def test_one_session_in_a_process(tmp_path: Path) -> None:
    config = grid(tmp_path, 10)
    session = Session(config, QUIET)
    with pytest.raises(EngineError, match="only one SUMO simulation"):
        Session(config, QUIET)
    session.close()
    with pytest.raises(EngineError, match=r"SUMO did not start: .*nothing\.sumocfg"):
        Session(tmp_path / "nothing.sumocfg", QUIET)
    # A start that failed leaves nothing behind.
    assert vehicle_types(config)["DEFAULT_VEHTYPE"] == CAR


@pytest.mark.slow
def test_the_same_simulation_in_another_process(tmp_path: Path) -> None:
    """Every function answers alike through libsumo and through TraCI."""
    config, answers = grid(tmp_path, 30), []
    for runs in ("here", "apart"):
        session = Session(config, QUIET, runs)
        while session.goes_on(30.0):
            session.step()
        cars, people = session.vehicles, session.people
        name, person = min(cars.ids()), min(interface(runs).person.getIDList())
        session.ignore(name, [person])
        asked = [getattr(cars, each)(name) for each in cars.__slots__ if asks(each)]
        asked += [getattr(people, each)(person) for each in people.__slots__ if asks(each)]
        asked += [session.follows(name, 10.0, 4.5), session.lanes_ahead(name, cars.lane(name))]
        asked += [session.last.collisions(), session.last.teleported(), session.step_s]
        asked.append(session.last.vehicles_on(edge_of(cars.lane(name))))
        answers.append([tuple(each) if isinstance(each, list) else each for each in asked])
        session.close()
    assert answers[0] == answers[1]


def asks(name: str) -> bool:
    return name not in ("ids", "walk", "remove") and not name.startswith("set_")
