"""A network in; its pedestrian crossings out, each usable or with the reason why not."""

from dataclasses import dataclass
from pathlib import Path

from harness.core.encounter import PEDESTRIAN_RADIUS_M
from harness.core.errors import InputError
from harness.scenario.own_network import CLEAR_M
from harness.scenario.sections import CrossingSection, EgoSection
from harness.site import RoadNetwork, Site, site_at
from harness.site.road_network import junction_of

RANGE_M = EgoSection().trigger_range_m
"""A crosswalk is usable only if its approach is long enough for the default trigger range."""


@dataclass(frozen=True)
class CrossingRow:
    """A crossing; unknown values are None, and ``problem`` says why it is not usable."""

    edge: str
    junction: str
    streets: tuple[str, ...]
    problem: str | None
    approach: str | None = None
    longitude_deg: float | None = None
    latitude_deg: float | None = None
    lanes: int | None = None
    oncoming_lanes: int | None = None
    length_m: float | None = None
    width_m: float | None = None
    angle_deg: float | None = None
    speed_limit_mps: float | None = None
    pedestrian_priority: bool | None = None
    signal: str | None = None
    straight_m: float | None = None
    trigger_range_m: float | None = None
    passed: tuple[str, ...] = ()

    @property
    def usable(self) -> bool:
        """Whether the harness can simulate this crossing."""
        return self.problem is None


def list_crossings(network: RoadNetwork, *, ignore_signal: bool = False) -> list[CrossingRow]:
    """All crossings of a network, usable ones first, then by id.

    Args:
        network: the network.
        ignore_signal: whether a crossing with a traffic light is usable; the light then stays green
            for everybody.
    """
    rows = []
    for edge in network.crossings.values():
        roads = edge.getCrossingEdges()
        streets = tuple(dict.fromkeys(road.getName() or road.getID() for road in roads))
        names = (edge.getID(), junction_of(edge), streets)
        try:
            site = site_at(network, edge.getID(), all_ways=False)
        except InputError as error:
            problem = error.problem + (f"; allowed: {error.allowed}" if error.allowed else "")
            rows.append(CrossingRow(*names, problem))
            continue
        rows.append(_row(network, site, names, ignore_signal=ignore_signal))
    return sorted(rows, key=lambda row: (not row.usable, row.edge))


def _row(
    network: RoadNetwork,
    site: Site,
    names: tuple[str, str, tuple[str, ...]],
    *,
    ignore_signal: bool,
) -> CrossingRow:
    centre = site.frame.to_network(0.0, site.length_m / 2)
    longitude, latitude = network.on_the_ground(*centre) or (None, None)
    # The paper's trigger is six seconds away at v0.
    range_m = site.ego.longest_range_m(max(RANGE_M, 6.0 * site.ego.speed_limit_mps))
    last_m = EgoSection().length_m + site.width_m / 2
    before = [stretch for stretch in site.ego.stretches if stretch.start_m < 0][-1]
    return CrossingRow(
        *names,
        problem=_problem(site, ignore_signal=ignore_signal),
        approach=f"{before.edge}_{before.lane}",
        longitude_deg=longitude,
        latitude_deg=latitude,
        lanes=site.lanes,
        oncoming_lanes=site.oncoming_lanes,
        length_m=site.length_m,
        width_m=site.width_m,
        angle_deg=site.angle_deg,
        speed_limit_mps=site.ego.speed_limit_mps,
        pedestrian_priority=site.pedestrian_priority,
        signal=None if site.signal is None else site.signal.id,
        straight_m=site.ego.straight_before_m,
        trigger_range_m=range_m,
        passed=tuple(
            str(landmark) for landmark in site.passed if -range_m <= landmark.x_m <= last_m
        ),
    )


def _problem(site: Site, *, ignore_signal: bool) -> str | None:
    """Why the crossing is not usable, with value and allowed values; None if it is usable."""
    ego, way = EgoSection(), site.ego
    if site.signal is not None and not ignore_signal:
        return (
            f"traffic light {site.signal.id} controls it; --ignore-signal (in a scenario "
            "crossing.ignore_signal = true) keeps it green for everybody"
        )
    for name, word, value in (
        ("length_m", "long", site.length_m),
        ("width_m", "wide", site.width_m),
    ):
        low, high = _bounds(name)
        if not low <= value <= high:
            return f"it is {value:.2f} m {word}; allowed: {low:g} to {high:g} m"
    if way.width_m < ego.width_m:
        return f"the ego ({ego.width_m:g} m) is wider than its lane ({way.width_m:.2f} m)"
    room = min(way.centre_m, site.length_m - way.centre_m) - ego.width_m / 2
    if room < PEDESTRIAN_RADIUS_M:
        least = f"{PEDESTRIAN_RADIUS_M:g} m, the radius of a pedestrian"
        return f"{room:.2f} m remain between the ego and a kerb, less than {least}"
    try:
        way.departure(RANGE_M)
    except InputError as error:
        return f"a trigger range of {error.problem}; allowed: {error.allowed}"
    needed = ego.length_m + site.width_m / 2 + CLEAR_M
    if way.straight_after_m < needed:
        return (
            f"beyond it the road is straight for {way.straight_after_m:.1f} m and "
            f"{way.ends_after}; a car needs {needed:.1f} m to leave it"
        )
    return None


def _bounds(name: str) -> tuple[float, float]:
    low, high = CrossingSection.model_fields[name].metadata
    return float(low.ge), float(high.le)


def scenario_text(net: Path, row: CrossingRow) -> str:
    """A commented scenario file for a crossing, at the road's own speed limit.

    Args:
        net: path of the network, as it appears in the scenario file.
        row: a usable crossing.
    """
    assert row.speed_limit_mps is not None
    assert row.straight_m is not None
    speed = row.speed_limit_mps
    where = ""
    if row.longitude_deg is not None:
        where = f" at {row.latitude_deg:.6f}°, {row.longitude_deg:.6f}°"
    fast = speed > _MODELLED_MPS
    return _SCENARIO.format(
        streets=" / ".join(row.streets).replace("\n", " "),
        where=where,
        net=_quoted(net.as_posix()),
        edge=_quoted(row.edge),
        approach=_quoted(row.approach or ""),
        signal=_GREEN if row.signal else "",
        speed=f"{speed:.6g}",
        kmh=f"{3.6 * speed:.4g}",
        range=f"{row.trigger_range_m:.6g}",
        length=f"{row.length_m:.2f}",
        lanes=row.lanes,
        oncoming=row.oncoming_lanes,
        straight=f"{row.straight_m:.1f}",
        pedestrians=_WALKERS if fast else "",
        human="human_yield" if fast else "human_gmm",
        why=_FAST if fast else "the driver of the interaction model",
        response=_RESPONSE if fast else "",
    )


_MODELLED_MPS = 8.0
"""Vehicles of the interaction model's data drive up to this speed."""


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


_FAST = "above 8 m/s the interaction model has no data on drivers"
_GREEN = """
ignore_signal = true   # the traffic light stays green for vehicles and pedestrians"""
_WALKERS = """
[pedestrians.walking_speed]   # above 8 m/s the interaction model has no data on walking speeds
mean_mps = 1.34
std_mps = 0.26
"""
_RESPONSE = """
[strategies.human_yield]
reaction_time_s = 1.0         # median; drivers differ, as measured: docs/strategies.md
reaction_time_sigma = 0.4
comfortable_deceleration_sigma = 0.28
"""
_SCENARIO = """# {streets}{where}: {length} m, {lanes} lane(s), {oncoming} oncoming.
# Written by `harness crossings`; its geometry is read from the network.

[crossing]
net = {net}
edge = {edge}
approach = {approach}   # the ego's lane; it is straight for {straight} m{signal}

[ego]
initial_speed_mps = {speed}   # the road's speed limit, {kmh} km/h
trigger_range_m = {range}     # six seconds away, if the approach is straight that far

[pedestrians]
flow_per_hour = 250.0
behaviour = "threshold"       # as in a laboratory; at measured crosswalks waits are 4.4 s too long
{pedestrians}
[arms]
av = "gap_yield"
human = "{human}"             # {why}
{response}"""
