"""Where a network lies on the ground, by the projection that its file names."""

from typing import NamedTuple

from harness.roads.road_network import RoadNetwork
from harness.roads.site import Site

_AHEAD_M = 50.0


class Whereabouts(NamedTuple):
    """A crosswalk's centre (WGS84) and the ego's direction clockwise from true north."""

    longitude_deg: float
    latitude_deg: float
    bearing_deg: float


class Geography:
    """The projection of a network.

    Args:
        network: as read.

    Raises:
        ValueError: it has no projection, or one that PROJ does not know.
    """

    def __init__(self, network: RoadNetwork) -> None:
        # Half a second of start-up that a scenario without a network of its own does not pay.
        import pyproj
        from pyproj.exceptions import ProjError

        words = network.location.get("projParameter", "!")
        if not words.startswith("+proj="):
            raise ValueError(f"no projection: {words[:40]!r}")
        try:
            self._projection = pyproj.Proj(words)
            self._ground = pyproj.Geod(ellps="WGS84")
            offset = network.location.get("netOffset", "0,0").split(",")
            self._offset = (float(offset[0]), float(offset[1]))
        except (ProjError, IndexError) as error:
            raise ValueError(f"no usable projection ({error})") from None

    def place(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Longitude and latitude of a point of the network."""
        east, north = self._offset
        longitude, latitude = self._projection(x_m - east, y_m - north, inverse=True)
        return float(longitude), float(latitude)

    def whereabouts(self, site: Site) -> Whereabouts:
        """Where a site's crosswalk is, and where its ego drives to."""
        frame = site.frame
        before, after = (
            self.place(*frame.to_network(x, site.ego.centre_m)) for x in (-_AHEAD_M, _AHEAD_M)
        )
        bearing, _, _ = self._ground.inv(*before, *after)
        centre = self.place(*frame.to_network(0.0, site.length_m / 2))
        return Whereabouts(*centre, float(bearing) % 360.0)
