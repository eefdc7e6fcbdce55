"""A network of one's own in; what `harness crossings` lists of it, and what any reader refuses.

The networks are netconvert's and netgenerate's; lengths and angles are those they were asked for.
"""

import cmath
import gzip
import json
import math
import re
from pathlib import Path

import pytest

from harness.core.errors import InputError
from harness.engine.network.build import run_netconvert
from harness.engine.network.crossings import list_crossings
from harness.site import crosswalks_of, read_network, road_network
from tests import towns
from tests.batches import here, printed, refusal


def street(folder: Path, lanes: int = 1, oncoming: int = 1, left_hand: str = "") -> Path:
    """A street with sidewalks, lanes of 3 m and bearing 40°, with one crosswalk 4 m wide."""
    along = cmath.rect(1, math.radians(90 - 40.0))
    places = {"start": -150 * along, "cross": 0j, "end": 130 * along}
    edges = [
        ("approach", "start", "cross", lanes),
        ("exit", "cross", "end", lanes),
        ("back_in", "end", "cross", oncoming),
        ("back", "cross", "start", oncoming),
    ]
    if not oncoming:  # the other side of a one-way street has no sidewalk
        places["path"] = 40j * along * (-1 if left_hand else 1)
    folder.mkdir(parents=True, exist_ok=True)
    nodes = [
        f'<node id="{name}" x="{at.real:.6f}" y="{at.imag:.6f}" type="priority"/>'
        for name, at in places.items()
    ]
    lines = [
        f'<edge id="{name}" from="{a}" to="{b}" numLanes="{count}" width="3"'
        ' speed="13.89" sidewalkWidth="2" priority="5"/>'
        for name, a, b, count in edges
        if count
    ]
    if not oncoming:
        lines.append('<edge id="foot" from="cross" to="path" allow="pedestrian" width="2"/>')
    crossed = "approach back" if oncoming else "approach"
    crossing = f'<crossing node="cross" edges="{crossed}" width="4" priority="true"/>'
    tables = {"nodes": "".join(nodes), "edges": "".join(lines), "connections": crossing}
    return converted(folder, tables, *filter(None, [left_hand]))


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


@pytest.mark.parametrize("left_hand", ["", "--lefthand"])
def test_what_is_listed_is_what_was_asked_for(tmp_path: Path, left_hand: str) -> None:
    for lanes, oncoming in ((1, 1), (2, 3), (3, 0)):
        net = street(tmp_path / str(lanes), lanes, oncoming, left_hand)
        (row,) = list_crossings(read_network(net))
        turned = 180.0 * (abs((row.bearing_deg or 0.0) - 40.0) > 90.0)
        assert row.bearing_deg == pytest.approx(40.0 + turned, abs=0.1)
        ways = (oncoming, lanes) if turned else (lanes, oncoming)
        assert (row.lanes, row.oncoming_lanes) == ways
        assert row.length_m == pytest.approx(3.0 * (lanes + oncoming), abs=0.03)
        assert row.width_m == pytest.approx(4.0, abs=0.01)
        assert (row.edge, row.problem) == (":cross_c0", None)


def test_a_network_without_a_crossing_says_what_to_do(tmp_path: Path) -> None:
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="9" y="0"/>'
    net = converted(tmp_path, {"nodes": nodes, "edges": '<edge id="ab" from="a" to="b"/>'})
    done = here("crossings", net)
    assert (done.returncode, "0 crossings" in done.stdout) == (0, True)
    assert "netconvert -s THIS --sidewalks.guess --crossings.guess" in done.stderr


def test_hostile_networks_get_one_line(tmp_path: Path) -> None:
    text = street(tmp_path).read_text()
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
    assert row.lanes == 1
    listing = printed("crossings", path)
    assert "\x1b" not in listing
    assert listing.count("\n") == 2
    refusal("crossings", path, "--write", tmp_path / "x.toml", "--edge", row.edge)
    refusal("crossings", tmp_path / "cut.net.xml")
    (row,) = json.loads(printed("crossings", tmp_path / "city.net.xml", "--json"))["crossings"]
    assert (row["edge"], row["lanes"], row["problem"]) == (":cross_c0", 1, None)


def test_a_packed_network_of_lanes_for_all_is_read_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    net, packed = street(tmp_path), tmp_path / "packed.net.xml.gz"
    text, cars, everybody = net.read_text(), 'disallow="pedestrian"', 'allow="all"'
    assert cars in text
    packed.write_bytes(gzip.compress(text.replace(cars, everybody).encode()))
    assert list_crossings(read_network(packed)) == list_crossings(read_network(net))
    monkeypatch.setattr(road_network, "_MOST_BYTES", len(text) // 2)
    with pytest.raises(InputError, match="MB unpacked; allowed: a part of it"):
        read_network(packed)


def test_a_grid_is_listed(tmp_path: Path) -> None:
    words = "--grid --grid.number 3 --grid.length 150 --default.lanenumber 2 --sidewalks.guess"
    towns.call(tmp_path, "netgenerate", *words.split(), "--crossings.guess", "-o", "grid.net.xml")
    rows = list_crossings(read_network(tmp_path / "grid.net.xml"))
    assert len(rows) == 20
    # Lanes of 3.2 m, two each way.
    assert [row.length_m for row in rows] == pytest.approx([12.8] * 20, abs=0.02)
    assert {(row.lanes, row.oncoming_lanes) for row in rows} == {(2, 2)}
    assert {round(row.bearing_deg or 0.0) % 90 for row in rows} == {0}
