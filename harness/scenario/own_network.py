"""``[crossing] net``: what a network of the user's own says takes the place of the keys."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harness.errors import InputError
from harness.roads import Place, Site, Survey, survey
from harness.scenario.sections import Scenario

READ_KEYS = (
    "latitude_deg",
    "longitude_deg",
    "bearing_deg",
    "length_m",
    "width_m",
    "pedestrian_priority",
    "lanes",
    "oncoming_lanes",
    "lane_width_m",
    "road_speed_limit_mps",
)
"""The keys of ``[crossing]`` that a network says."""

_CLEAR_M = 1.0
"""How much straight road has to follow where the ego's rear has left the crosswalk."""


def with_own_network(tree: Mapping[str, Any], scenario: Scenario, source: str) -> Mapping[str, Any]:
    """The tree of a scenario with its crosswalk read from its own network, if it names one.

    A tree that has been read before, a manifest's, stays as it is: the network need not be there.

    Raises:
        InputError: keys that do not go together, or a crosswalk that cannot be simulated; with the
            figure, and what would do.
    """
    crossing, where = scenario.crossing, f"{source}: crossing"
    if crossing.net is None:
        for key in ("edge", "approach", "ignore_signal", "read"):
            if getattr(crossing, key):
                raise InputError(f"{where}.{key}", "belongs to a network", "crossing.net beside it")
        return tree
    if crossing.edge is None:
        allowed = "the id of a crossing, as `harness crossings` lists them"
        raise InputError(f"{where}.edge", "is not given", allowed)
    asked = (crossing.net, crossing.edge, crossing.approach, scenario.ego.lane)
    read = crossing.read
    if read is not None and asked == (read.net, read.edge, read.approach, read.lane):
        return tree
    if scenario.traffic is not None:
        problem = "has traffic, which runs in networks of the harness's own alone"
        raise InputError(f"{where}.net", problem, "the crosswalk's geometry, or no [traffic]")
    given = [key for key in READ_KEYS if key in crossing.model_fields_set and read is None]
    if given:
        problem = "is given beside crossing.net, which says it"
        raise InputError(f"{where}.{given[0]}", problem, "one of the two")
    if crossing.approach is not None and scenario.ego.lane:
        problem = "is given beside crossing.approach, which says it"
        raise InputError(f"{source}: ego.lane", problem, "one of the two")
    net = Path(crossing.net)
    found = survey(Place(net, crossing.edge, crossing.approach, scenario.ego.lane))
    _check(found.site, scenario, source)
    words = dict(zip(("net", "edge", "approach", "lane"), asked, strict=True))
    return {
        **tree,
        "crossing": {
            **dict(tree["crossing"]),
            **_geometry(found),
            "read": {
                **words,
                "sha256": found.sha256,
                "lane_centre_m": found.site.ego.centre_m,
                "angle_deg": found.site.angle_deg,
            },
        },
    }


def _geometry(found: Survey) -> dict[str, Any]:
    site, where = found.site, found.where
    return {
        "latitude_deg": None if where is None else where.latitude_deg,
        "longitude_deg": None if where is None else where.longitude_deg,
        "bearing_deg": site.bearing_deg if where is None else where.bearing_deg,
        "length_m": site.length_m,
        "width_m": site.width_m,
        "pedestrian_priority": site.pedestrian_priority,
        "lanes": site.lanes,
        "oncoming_lanes": site.oncoming_lanes,
        "lane_width_m": site.ego.width_m,
        "road_speed_limit_mps": site.ego.speed_limit_mps,
    }


def _check(site: Site, scenario: Scenario, source: str) -> None:
    """Refuse what this scenario cannot do at this crosswalk."""
    ego, crossing = scenario.ego, scenario.crossing
    try:
        site.ego.departure(ego.trigger_range_m)
    except InputError as error:
        raise InputError(f"{source}: {error.where}", error.problem, error.allowed) from None
    needed = ego.length_m + site.width_m / 2 + _CLEAR_M
    if site.ego.straight_after_m < needed:
        raise InputError(
            f"{source}: crossing.edge",
            f"{crossing.edge}: beyond it the ego's lane is straight for "
            f"{site.ego.straight_after_m:.1f} m and {site.ego.ends_after}",
            f"at least {needed:.1f} m: ego.length_m + half the crosswalk's width + {_CLEAR_M:g} m",
        )
    if site.signal is not None and not crossing.ignore_signal:
        raise InputError(
            f"{source}: crossing.edge",
            f"{crossing.edge}: traffic light {site.signal.id} rules it",
            "an unsignalized crosswalk, or crossing.ignore_signal = true: green for both",
        )
