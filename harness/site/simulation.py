"""The chosen crosswalks of a user's own SUMO scenario, with the ways on which AVs drive."""

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from harness.core.errors import InputError, nearest_name
from harness.site.configuration import SumoConfig, read_config
from harness.site.crosswalks import Crosswalk, WayOver, crosswalks_of
from harness.site.locate import footpaths_of
from harness.site.road_network import RoadNetwork, read_network
from harness.site.site import Footpath

CAR_M = 5.0
"""Length of a car, SUMO's default."""


@dataclass(frozen=True)
class DrivenWay:
    """A way over a chosen crosswalk on which a strategy may drive.

    Attributes:
        way: the way.
        meets_vehicles: whether it crosses or joins the way of other vehicles inside the junction.
    """

    way: WayOver
    meets_vehicles: bool


@dataclass(frozen=True)
class Setting:
    """The crosswalks of a simulation.

    Attributes:
        config: the user's configuration.
        sha256: hash of the files that it names as inputs, and of its own.
        step_s: the step of both arms.
        range_m: R0, where a passage begins.
        crosswalks: the chosen crosswalks, and further ones within R0 of them.
        added: ids of these further crosswalks.
        ways: the ways over all of them.
        footpaths: the footpaths at both ends of each named crosswalk.
    """

    config: SumoConfig
    sha256: str
    step_s: float
    range_m: float
    crosswalks: tuple[Crosswalk, ...]
    added: tuple[str, ...]
    ways: tuple[DrivenWay, ...]
    footpaths: Mapping[str, tuple[Footpath, Footpath]]

    @property
    def bent(self) -> tuple[str, ...]:
        """Ids of the crosswalks over which no strategy may drive a car, since every way bends."""
        driven = {
            way.crosswalk
            for way in (each.way for each in self.ways)
            if way.is_straight(CAR_M) and way.straight_before_m >= self.range_m - 1e-6
        }
        return tuple(each.id for each in self.crosswalks if each.id not in driven)

    def lanes(self) -> Mapping[str, list[DrivenWay]]:
        """The ways by the lanes on which a vehicle is between R0 and the crosswalk."""
        by_lane: dict[str, list[DrivenWay]] = defaultdict(list)
        for each in self.ways:
            for lane in each.way.lanes:
                if lane.end_m > -self.range_m and lane.start_m < 0.0:
                    by_lane[lane.lane].append(each)
        return by_lane


def setting_at(
    path: Path, step_s: float | None, crossings: tuple[str, ...], range_m: float, where: str
) -> Setting:
    """The chosen crosswalks of a configuration; cached until its files change.

    Args:
        path: the configuration's file.
        step_s: a shorter step than the configuration's; None keeps the configuration's.
        crossings: ids of the chosen crosswalks.
        range_m: R0.
        where: the keys' names in messages.

    Raises:
        InputError: the configuration or a crosswalk is refused.
    """
    changed = _changed(path)
    files = tuple(map(_changed, _config_at(path, step_s, changed).inputs))
    return _setting_at(path, step_s, crossings, range_m, where, changed, files)


def _changed(file: Path) -> tuple[int, int]:
    """A file's time of last change in ns, and its size; (0, 0) if there is no file."""
    try:
        status = file.stat()
    except OSError:
        return 0, 0
    return status.st_mtime_ns, status.st_size


@lru_cache(maxsize=2)
def _config_at(path: Path, step_s: float | None, _changed: tuple[int, int]) -> SumoConfig:
    return read_config(path, step_s)


@lru_cache(maxsize=2)
def _setting_at(
    path: Path,
    step_s: float | None,
    crossings: tuple[str, ...],
    range_m: float,
    where: str,
    changed: tuple[int, int],
    _files_changed: tuple[tuple[int, int], ...],
) -> Setting:
    config = _config_at(path, step_s, changed)
    network = read_network(config.net)
    known = {crosswalk.id: crosswalk for crosswalk in crosswalks_of(network)}
    for crossing in crossings:
        _check(crossing, known, f"{where}.crossings")
    chosen, added = _grouped(crossings, known, range_m)
    ways = tuple(
        DrivenWay(way, _meets_vehicles(network, way))
        for crosswalk in chosen
        for way in crosswalk.ways
        if way.to_edge and not way.oblique
    )
    paths = {name: footpaths_of(network.crossings[name], over_refuge=True) for name in crossings}
    step_s = step_s or config.step_s
    return Setting(config, _sha256_of(config), step_s, range_m, chosen, added, ways, paths)


def _sha256_of(config: SumoConfig) -> str:
    digest = hashlib.sha256()
    for path in config.inputs:
        try:
            with path.open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        except OSError as error:
            raise InputError(str(path), f"cannot be read ({error.strerror})") from None
    return digest.hexdigest()


def _check(crossing: str, known: Mapping[str, Crosswalk], where: str) -> None:
    crosswalk = known.get(crossing)
    if crosswalk is None:
        allowed = f"one of the network's {len(known)} crossings"
        problem = f"no crossing {crossing!r}"
        raise InputError(where, problem, allowed, nearest_name(crossing, known))
    if crosswalk.problem is not None:
        allowed = "a crosswalk that `harness crossings` lists as usable"
        raise InputError(where, f"{crossing}: {crosswalk.problem}", allowed)


def _grouped(
    crossings: Iterable[str], known: Mapping[str, Crosswalk], range_m: float
) -> tuple[tuple[Crosswalk, ...], tuple[str, ...]]:
    """The chosen crosswalks and further ones within R0 on the same lanes, in the file's order.

    If a strategy handed a vehicle back between two such crosswalks, its front would be too near to
    the second one for SUMO to stop it.
    """
    chosen = set(crossings)
    grown = True
    while grown:
        grown = False
        for crosswalk in known.values():
            if crosswalk.id in chosen or crosswalk.signalled or crosswalk.refused is not None:
                continue
            if any(_near(crosswalk, known[other], range_m) for other in chosen):
                chosen.add(crosswalk.id)
                grown = True
    added = tuple(name for name in known if name in chosen and name not in set(crossings))
    return tuple(known[name] for name in known if name in chosen), added


def _near(crosswalk: Crosswalk, other: Crosswalk, range_m: float) -> bool:
    """Whether a vehicle meets one crosswalk within R0 of the other."""
    for way in crosswalk.ways:
        places = {lane.lane: lane.start_m for lane in way.lanes}
        for each in other.ways:
            if not way.is_straight(0.0) or not each.is_straight(0.0):
                continue
            for lane in each.lanes:
                start_m = places.get(lane.lane)
                # The other crosswalk lies on this lane: its x on this way is the distance.
                if start_m is None or not lane.start_m <= 0.0 <= lane.end_m:
                    continue
                if abs(start_m - lane.start_m) <= range_m:
                    return True
    return False


def _meets_vehicles(network: RoadNetwork, way: WayOver) -> bool:
    """Whether vehicles on other ways cross this one inside the junction, or join it there."""
    junction = network.net.getEdge(way.crosswalk).getToNode()
    internal = list(junction.getInternal())
    lanes = {lane.lane for lane in way.lanes}
    crossings = {f"{each}_0" for each in network.crossings}
    for number, lane in enumerate(internal):
        if lane not in lanes:
            continue
        for other, name in enumerate(internal):
            if other != number and name not in crossings and junction.areFoes(number, other):
                return True
    return False
