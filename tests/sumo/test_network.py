"""The network is where, how long and in which direction it was asked to be.

Places and directions are judged in longitude and latitude by the WGS84 ellipsoid's radii of
curvature, written out below; SUMO is only asked to turn its coordinates into degrees.
"""

import gzip
import math
from contextlib import closing
from pathlib import Path

import libsumo
import pytest

from harness.core.errors import EngineError
from harness.engine import network, sources
from harness.engine.network import CACHE_VARIABLE, build_network, network_of
from harness.engine.town_reader import read_town
from harness.scenario import Scenario, load_scenario
from harness.scenario.sections import CrossingSection
from tests.scenes import refuses
from tests.sites import NETWORKS, frame_of, geometries


def site(*numbers: float) -> CrossingSection:
    """Latitude, longitude, bearing, length and width of a crosswalk."""
    keys = ("latitude_deg", "longitude_deg", "bearing_deg", "length_m", "width_m")
    return CrossingSection.model_validate(dict(zip(keys, numbers, strict=True)))


SHIPPED = NETWORKS / "cctc"
CCTC = load_scenario("cctc").crossing
GEOMETRIES = {
    **geometries(),
    "north": site(42.278415, -83.735580, 0.0, 6.0, 3.0),
    "east at the date line": site(60.17, 179.9995, 90.0, 14.0, 6.0),
    "south-west, southern": site(-33.868820, 151.209290, 200.0, 9.0, 3.0),
    "far south and west": site(-54.801912, -179.9, 123.4, 6.0, 4.0),
    "widest at the equator": site(0.0, 0.0000001, 359.9, 40.0, 20.0),
    "narrowest in the far north": site(84.0, 10.0, 45.0, 4.0, 1.0),
}
# WGS84: its defining semi-major axis and flattening.
AXIS_M = 6_378_137.0
FLATTENING = 1 / 298.257223563


@pytest.fixture(scope="module")
def nets(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("nets")
    return {
        name: build_network(geometry, folder / str(number), "site")
        for number, (name, geometry) in enumerate(GEOMETRIES.items())
    }


@pytest.fixture(params=GEOMETRIES)
def case(request: pytest.FixtureRequest, nets: dict[str, Path]) -> tuple[CrossingSection, Path]:
    return GEOMETRIES[request.param], nets[request.param]


def ground_m(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """East and north metres from a to b, both (longitude, latitude) in degrees, some 100 m apart.

    Radii of curvature at the middle latitude: e² = f(2 − f), N = a/√(1 − e² sin²φ),
    M = N(1 − e²)/(1 − e² sin²φ).
    """
    latitude = math.radians((a[1] + b[1]) / 2)
    squared = FLATTENING * (2 - FLATTENING)
    bulge = 1 - squared * math.sin(latitude) ** 2
    normal = AXIS_M / math.sqrt(bulge)
    meridian = normal * (1 - squared) / bulge
    turn = (b[0] - a[0] + 180) % 360 - 180
    east = math.radians(turn) * normal * math.cos(latitude)
    return east, math.radians(b[1] - a[1]) * meridian


def bearing_deg(a: tuple[float, float], b: tuple[float, float]) -> float:
    east, north = ground_m(a, b)
    return math.degrees(math.atan2(east, north))


def angle_between(a_deg: float, b_deg: float) -> float:
    return abs((a_deg - b_deg + 180) % 360 - 180)


@pytest.mark.usefixtures("no_simulation")
def test_the_centre_is_at_the_coordinates_and_metres_and_north_are_true(
    case: tuple[CrossingSection, Path],
) -> None:
    geometry, net = case
    to_network = frame_of(geometry).to_network
    # The nodes are metres east and north of the centre.
    assert to_network(0.0, geometry.length_m / 2) == pytest.approx((0.0, 0.0), abs=1e-6)
    libsumo.start(["sumo", "--net-file", str(net), "--no-step-log", "--no-warnings"])
    with closing(libsumo):
        degrees = libsumo.simulation.convertGeo
        place = degrees(0.0, 0.0)
        road = [degrees(*to_network(x, 0.0)) for x in (-20.0, 20.0)]
        walk = [degrees(*to_network(0.0, y)) for y in (0.0, geometry.length_m)]
    asked = (geometry.longitude_deg, geometry.latitude_deg)
    assert math.hypot(*ground_m(asked, place)) < 0.001
    assert angle_between(bearing_deg(*road), geometry.bearing_deg) < 0.002
    # The kerb at y = 0 is on the ego's right, so the walk from it leads to the left.
    assert angle_between(bearing_deg(*walk), geometry.bearing_deg - 90) < 0.002
    assert math.hypot(*ground_m(*road)) == pytest.approx(40.0, rel=1e-6)
    assert math.hypot(*ground_m(*walk)) == pytest.approx(geometry.length_m, rel=1e-6)


def near_to(*points: tuple[float, float]) -> tuple[object, ...]:
    return tuple(pytest.approx(point, abs=2e-6) for point in points)


def test_crossing_is_unsignalized_and_spans_kerb_to_kerb(
    case: tuple[CrossingSection, Path],
) -> None:
    """The near kerb is half a length to the right of the ego's direction."""
    geometry, net = case
    length = geometry.length_m
    (crosswalk,) = read_town(net).crosswalks.values()
    assert (crosswalk.prioritized, crosswalk.signalled, crosswalk.refused) == (True, False, None)
    ends = crosswalk.axis.coords
    bearing = math.radians(geometry.bearing_deg)
    near = (math.cos(bearing) * length / 2, -math.sin(bearing) * length / 2)
    far = (-near[0], -near[1])
    assert (ends[0], ends[-1]) in (near_to(near, far), near_to(far, near))
    assert crosswalk.width_m == pytest.approx(geometry.width_m, abs=2e-6)


def test_bad_names_and_files_are_refused(tmp_path: Path) -> None:
    refuses("network name", lambda: build_network(CCTC, tmp_path, "../site"))
    (tmp_path / "file").write_text('<net version="1.20"/>')
    refuses("cannot be written", lambda: build_network(CCTC, tmp_path / "file", "site"))
    (tmp_path / "cut").write_text((SHIPPED / "cctc.net.xml").read_text()[:3000])
    refuses("cannot be read", lambda: read_town(tmp_path / "missing"))
    refuses("is not a complete SUMO network", lambda: read_town(tmp_path / "cut"))


def test_a_network_that_netconvert_does_not_build_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    edges = sources._TEMPLATES["edg.xml"].replace('to="far"', 'to="nowhere"')
    monkeypatch.setitem(sources._TEMPLATES, "edg.xml", edges)
    with pytest.raises(EngineError, match=r"^netconvert: .*nowhere") as caught:
        build_network(CCTC, tmp_path, "site")
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_other_geometries_are_built_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    geometry = CrossingSection(bearing_deg=10.0)
    net = network_of(Scenario(crossing=geometry))
    assert net.is_relative_to(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(network, "build_network", lambda *_: pytest.fail("built twice"))
        assert network_of(Scenario(crossing=geometry)) == net
    assert network_of(Scenario(crossing=CrossingSection(bearing_deg=11.0))) != net
    monkeypatch.setattr("harness.engine.network.metadata.version", lambda _: "another")
    assert network_of(Scenario(crossing=geometry)) != net


def test_a_packed_network_is_read_alike(tmp_path: Path) -> None:
    net = SHIPPED / "cctc.net.xml"
    (tmp_path / "packed.net.xml.gz").write_bytes(gzip.compress(net.read_bytes()))
    (one,), (other,) = (
        read_town(each).crosswalks.values() for each in (net, tmp_path / "packed.net.xml.gz")
    )
    assert (one.id, one.axis, one.roads) == (other.id, other.axis, other.roads)
