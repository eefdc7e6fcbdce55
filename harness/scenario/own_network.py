"""``[crossing] net``: a network of the user's own defines the crosswalk's other keys."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from harness.core.errors import InputError
from harness.scenario.scenario import Scenario
from harness.site import Place, Site, Stream, Survey, streams_of, survey
from harness.site.site import TOLERANCE_M

_READ: Mapping[str, Callable[[Survey], Any]] = {
    "latitude_deg": lambda facts: facts.where and facts.where.latitude_deg,
    "longitude_deg": lambda facts: facts.where and facts.where.longitude_deg,
    "bearing_deg": lambda facts: (facts.where or facts.site).bearing_deg,
    "length_m": lambda facts: facts.site.length_m,
    "width_m": lambda facts: facts.site.width_m,
    "pedestrian_priority": lambda facts: facts.site.pedestrian_priority,
    "lanes": lambda facts: facts.site.lanes,
    "oncoming_lanes": lambda facts: facts.site.oncoming_lanes,
    "lane_width_m": lambda facts: facts.site.ego.width_m,
    "road_speed_limit_mps": lambda facts: facts.site.ego.speed_limit_mps,
}
"""The keys of ``[crossing]`` that a network defines, each with its value in a survey."""

CLEAR_M = 1.0
"""Length of straight road that the ego needs after its rear has left the crosswalk."""
_CLEAR = f"ego.length_m + half the crosswalk's width + {CLEAR_M:g} m"


def with_own_network(tree: Mapping[str, Any], scenario: Scenario, source: str) -> Mapping[str, Any]:
    """The tree of a scenario, with the crosswalk's keys read from its network if it names one.

    A tree whose network has been read before (a manifest's) is unchanged and needs no network.

    Raises:
        InputError: keys exclude each other, or the crosswalk cannot be simulated; the message holds
            the value and the allowed ones.
    """
    crossing, where = scenario.crossing, f"{source}: crossing"
    if crossing.net is None:
        for key in ("edge", "approach", "ignore_signal", "read"):
            if getattr(crossing, key):
                raise InputError(
                    f"{where}.{key}", "is only allowed with crossing.net", "crossing.net with it"
                )
        return tree
    if crossing.edge is None:
        allowed = "the id of a crossing, as `harness crossings` lists them"
        raise InputError(f"{where}.edge", "is not given", allowed)
    request = (crossing.net, crossing.edge, crossing.approach, scenario.ego.lane)
    read = crossing.read
    if read is not None and request == (read.net, read.edge, read.approach, read.lane):
        return tree
    given = [key for key in _READ if key in crossing.model_fields_set and read is None]
    if given:
        problem = "cannot be combined with crossing.net, which defines it"
        raise InputError(f"{where}.{given[0]}", problem, "one of the two")
    if crossing.approach is not None and scenario.ego.lane:
        problem = "cannot be combined with crossing.approach, which defines it"
        raise InputError(f"{source}: ego.lane", problem, "one of the two")
    net = Path(crossing.net)
    facts = survey(Place(net, crossing.edge, crossing.approach, scenario.ego.lane))
    _check(facts.site, scenario, source)
    words = dict(zip(("net", "edge", "approach", "lane"), request, strict=True))
    return {
        **tree,
        "crossing": {
            **dict(tree["crossing"]),
            **{key: read_of(facts) for key, read_of in _READ.items()},
            "read": {
                **words,
                "sha256": facts.sha256,
                "lane_centre_m": facts.site.ego.centre_m,
                "angle_deg": facts.site.angle_deg,
                "ways": [
                    {"oncoming": way.oncoming, "centre_m": way.centre_m, "width_m": way.width_m}
                    for way in facts.site.ways
                ],
                "passed": [asdict(landmark) for landmark in facts.site.passed],
            },
        },
    }


def _check(site: Site, scenario: Scenario, source: str) -> None:
    """Refuse a crosswalk at which this scenario cannot be simulated."""
    ego, crossing = scenario.ego, scenario.crossing
    if scenario.traffic is not None:
        for stream in streams_of(site):
            if scenario.traffic.has_vehicles(oncoming=stream.way.oncoming):
                _check_stream(stream, site, scenario, source)
    else:
        try:
            site.ego.departure(ego.trigger_range_m)
        except InputError as error:
            raise InputError(f"{source}: {error.where}", error.problem, error.allowed) from None
        needed_m = _clear_m(site, scenario)
        if site.ego.straight_after_m < needed_m:
            what = f"the ego's lane is straight for {site.ego.straight_after_m:.1f} m"
            raise InputError(
                f"{source}: crossing.edge",
                f"{crossing.edge}: after the crosswalk {what} and {site.ego.ends_after}",
                f"at least {needed_m:.1f} m: {_CLEAR}",
            )
    if site.signal is not None and not crossing.ignore_signal:
        raise InputError(
            f"{source}: crossing.edge",
            f"{crossing.edge}: traffic light {site.signal.id} controls it",
            "an unsignalized crosswalk, or crossing.ignore_signal = true (green for everybody)",
        )


def _check_stream(stream: Stream, site: Site, scenario: Scenario, source: str) -> None:
    """Refuse a lane on which vehicles cannot approach the crosswalk in the same way as the ego."""
    ego, way = scenario.ego, stream.way
    lane = f"lane {stream.approach.edge}_{stream.approach.lane}"
    or_none = f", or traffic.{'oncoming' if way.oncoming else 'flow'}_per_hour = 0"
    range_m, per_step_m = ego.trigger_range_m, ego.initial_speed_mps * scenario.experiment.step_s
    where = f"{source}: ego.trigger_range_m"
    if range_m > way.straight_before_m + TOLERANCE_M:
        allowed = f"at most {way.straight_before_m:.6g} m{or_none}"
        raise InputError(where, f"{range_m!r}: the approach of {lane} {way.ends_before}", allowed)
    if stream.entry_x_m(range_m, per_step_m) is None:
        begins_m = -stream.begins_x_m
        problem = f"{range_m!r}: vehicles enter {lane} only {begins_m:.6g} m before the crosswalk"
        raise InputError(where, problem, f"at most {begins_m:.6g} m{or_none}")
    after_m, needed_m = min(way.straight_after_m, stream.ends_x_m), _clear_m(site, scenario)
    if after_m < needed_m:
        clear = _CLEAR
        if scenario.known_traffic.types:
            clear = clear.replace("ego.length_m", "the longest type's length_m")
        problem = f"{lane} turns or joins another lane {after_m:.1f} m after the crosswalk"
        raise InputError(
            f"{source}: crossing.edge",
            f"{scenario.crossing.edge}: {problem}",
            f"at least {needed_m:.1f} m: {clear}{or_none}",
        )


def _clear_m(site: Site, scenario: Scenario) -> float:
    return scenario.longest_vehicle_m + site.width_m / 2 + CLEAR_M
