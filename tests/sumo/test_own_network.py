"""A network of one's own in; what any reader refuses of it.

The networks are netconvert's and netgenerate's; lengths and angles are those they were asked for.
"""

import cmath
import gzip
import math
import re
from pathlib import Path

import pytest

from harness.core.errors import InputError
from harness.engine.network.build import run_netconvert
from harness.site import read_network, road_network


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


def test_a_packed_network_of_lanes_for_all_is_read_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    net, packed = street(tmp_path), tmp_path / "packed.net.xml.gz"
    text, cars, everybody = net.read_text(), 'disallow="pedestrian"', 'allow="all"'
    assert cars in text
    packed.write_bytes(gzip.compress(text.replace(cars, everybody).encode()))
    assert [*read_network(packed).crossings] == [*read_network(net).crossings]
    monkeypatch.setattr(road_network, "_MOST_BYTES", len(text) // 2)
    with pytest.raises(InputError, match="MB unpacked; allowed: a part of it"):
        read_network(packed)
