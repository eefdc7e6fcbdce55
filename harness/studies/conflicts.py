"""Conflicts of vehicles and people in SUMO's FCD output, measured as a simulation's passages."""

import json
import math
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow.compute as pc
import pyarrow.dataset as ds
import shapely

from harness.core.encounter import FloatArray, StepMotion, Vehicle
from harness.core.errors import InputError, reading
from harness.engine.fcd import records, sizes_of
from harness.results.finding import Plain
from harness.results.notes import Note
from harness.results.result import Result, listed
from harness.results.simulated import which
from harness.results.tables import PASSAGES, Row
from harness.scenario.sections import ConflictsSection
from harness.simulation.cars import PASSED, Car, Passage
from harness.simulation.opening import chosen
from harness.simulation.passages import passages
from harness.simulation.walked import Axis, Seen, Walked, walked_of
from harness.simulation.zones import Zones
from harness.site.town import Connection, Town

_MOST_ROWS = 12
"""Rows of the first screen, and of the worst passages."""
_KINDS = {"with people": "met", "contacts": "touched", "PET": "pet", "TTC": "ttc", "DRAC": "drac"}
"""What is counted, with the rows of the table of passages that it counts."""
_SHOWN = (
    *("crosswalk", "vehicle", "manoeuvre", "front_s", "contact_person", "contact_speed_mps"),
    *("pet_s", "min_ttc_s", "max_drac_mps2"),
)
_RANGE_M = 50.0
"""A passage begins this far before the crosswalk's centre."""
_CUT_OFF = "its records end"
_MOST_DIGITS = 7
_BESIDE_M = 3.0
"""Whoever is first further from a crosswalk is not on it: the file is of another network."""


def conflicts(
    files: Sequence[Path],
    net: Path,
    types: Sequence[Path],
    edges: Sequence[str],
    limits: ConflictsSection,
) -> tuple[Result, list[Row]]:
    """What a recording shows, and a row for each passage.

    Args:
        files: FCD outputs of one simulation.
        net: its network.
        types: files that define its vehicle types; FCD has neither lengths nor widths.
        edges: ids of the crosswalks; empty: all that are usable.
        limits: a passage beyond one of these is a conflict.

    Raises:
        InputError: a file cannot be used, nobody crosses, or no vehicle passes.
    """
    town, where = Town.read(net), ", ".join(map(str, files))
    usable = [name for name, each in town.crosswalks.items() if each.refused is None]
    names = [chosen(town, name, "--edge").id for name in edges] or usable
    walked = {*names}.union(*map(town.areas, names))
    vehicles, walkers, step_s = _read_ways(files, walked)
    zones = Zones(town, step_s, names)
    drives = _Drives(zones, sizes_of(net, types))
    found = [each for way in vehicles for each in drives.passages(way)]
    people = _walks(walkers, town, names)
    if not found or not any(people.values()):
        kind, ways = ("people", walkers) if found else ("vehicles", vehicles)
        problem = f"0 of {len({way.id for way in ways}):,} {kind} are over a crosswalk"
        allowed = "FCD of this network with both, or --person-fcd; without --fcd-output.geo"
        raise InputError(where, problem, allowed)
    motion = _motion(found, step_s)
    columns = passages(found, people, zones, step_s, motion or "euler")
    values = zip(*columns.values(), strict=True)
    table = PASSAGES.of([dict(zip(columns, of, strict=True)) for of in values])
    fields = {name: pc.field(name) for name in table.column_names}
    masks = {name: which(kind, limits) for name, kind in _KINDS.items()}
    frame = ds.dataset(table).to_table(columns=fields | masks).to_pandas()
    bad = frame[frame[["PET", "TTC", "DRAC"]].any(axis=1)][[*_SHOWN]]
    bad = bad.sort_values([*_SHOWN[-4:-1]], ascending=[False, True, True])
    rows, worst = _found(frame, people), listed("", _plain(bad[:_MOST_ROWS])).screen
    every = listed("", rows).screen
    result = replace(
        listed("conflicts", rows[:_MOST_ROWS], f"Conflicts at {len(people)} crosswalks"),
        closing=("The worst passages, and all crosswalks: --full; all passages: --table FILE.csv",),
        scope=f"{rows[0]['passages']:,} passages, {rows[0]['people']:,} people",
        about=f"PET < {limits.pet_s:g} s, TTC < {limits.ttc_s:g} s, DRAC > {limits.drac_mps2:g} "
        "m/s²; a contact is a conflict of every kind",
        full=(replace(every, title="All crosswalks"), replace(worst, title="The worst passages")),
        notes=_notes(drives, found, step_s, motion),
        facts=dict(files=where, net=str(net), step_s=step_s, **limits.model_dump()),
        records=rows,
    )
    return result, table.drop_columns(["cell", "pair", "arm"]).to_pylist()


def _motion(found: Sequence[Passage], step_s: float) -> StepMotion | None:
    """How vehicles move between two records: the rule by which the speeds give the distances.

    That is Euler's rule (the new speed) or the ballistic one (the mean of both).  If it is neither,
    the simulation's steps are shorter than the time between records: None, and the vehicles get the
    mean speeds between their places.
    """
    moved = np.concatenate([np.diff(each.xs_m) for each in found])
    before = np.concatenate([each.speeds_mps[:-1] for each in found])
    after = np.concatenate([each.speeds_mps[1:] for each in found])
    rules: dict[StepMotion, np.ndarray] = {"euler": after, "ballistic": (after + before) / 2}
    changing = np.abs(after - before) > 0.05
    if not changing.any():
        return "euler"
    off_m = {of: np.median(np.abs(moved - v * step_s)[changing]) for of, v in rules.items()}
    best = min(rules, key=off_m.__getitem__)
    if off_m[best] < 0.011 + 0.01 * step_s:
        return best
    for each in found:
        driven_mps = np.diff(each.xs_m) / step_s
        each.speeds_mps = np.concatenate((each.speeds_mps[:1], driven_mps))
    return None


def _found(frame: pd.DataFrame, people: Mapping[str, Sequence[Walked]]) -> list[dict[str, Plain]]:
    """A record for each crosswalk, the worst first, after one for all of them.

    Who crosses two crosswalks is one person.
    """
    ids = [(name, each.id) for name, here in people.items() for each in here]
    walks = pd.DataFrame(ids, columns=["crosswalk", "people"])
    twice, walked = (pd.concat([of.assign(crosswalk="all"), of]) for of in (frame, walks))
    groups = twice.groupby("crosswalk")
    found = pd.DataFrame({"people": walked.groupby("crosswalk")["people"].nunique()})
    found = found.join(groups.size().rename("passages"), how="outer")
    found = found.join(groups[[*_KINDS]].sum()).fillna(0).astype(int)
    found = found.join(groups["pet_s"].min().rename("least PET, s"))
    found = found.sort_values(["contacts", "PET", "TTC", "with people"], ascending=False)
    return _plain(pd.concat([found.loc[["all"]], found.drop("all")]).reset_index(names="crosswalk"))


def _plain(frame: pd.DataFrame) -> list[dict[str, Plain]]:
    """The rows of a frame, rounded, with None for what is undefined."""
    rows: list[dict[str, Plain]] = json.loads(frame.round(2).to_json(orient="records"))
    return rows


class _Way(NamedTuple):
    """A vehicle or a person from one record to the next, without a gap.

    Attributes:
        id, type: SUMO's.
        runs: its lanes, or a person's edges, in order.  Each has (time, position, speed), or (time,
            x, y), of every record on it, one after another.
    """

    id: str
    type: str
    runs: "list[tuple[str, array[float]]]"


def _read_ways(files: Sequence[Path], edges: Iterable[str]) -> tuple[list[_Way], list[_Way], float]:
    """The ways of all vehicles, those of people on some edges, and the time between two records.

    Args:
        files: FCD outputs of one simulation.
        edges: crosswalks and walking areas.

    Raises:
        InputError: a file is no FCD, or has less than two times.
    """
    walked, vehicles, people = frozenset(edges), list[_Way](), list[_Way]()
    last: dict[tuple[bool, str], _Way] = {}
    step_s = math.inf
    for file in files:
        now_s = math.inf
        for time_s, row in records(file):
            if time_s > now_s:
                step_s = min(step_s, round(time_s - now_s, 6))
            now_s = time_s
            driven = bool(row.get("lane"))
            if not driven and row.get("edge") not in walked:
                continue
            on, a, b = ("lane", "pos", "speed") if driven else ("edge", "x", "y")
            with reading(file):
                name, values = (driven, row["id"]), (time_s, float(row[a]), float(row[b]))
                way = last.get(name)
                if way is None or time_s - way.runs[-1][1][-3] > 1.5 * step_s:
                    way = last[name] = _Way(row["id"], row["type"], [])
                    (vehicles if driven else people).append(way)
            if not way.runs or way.runs[-1][0] != row[on]:
                way.runs.append((row[on], array("d")))
            way.runs[-1][1].extend(values)
    if step_s == math.inf:
        raise InputError(str(files[0]), "has no two times with vehicles", "FCD of some steps")
    return vehicles, people, step_s


class _Drives:
    """The passages of recorded vehicles over some crosswalks.

    Args:
        zones: the zones of the crosswalks.
        sizes: length, width, acceleration, deceleration and top speed of each type, in m and s.

    Attributes:
        town: the network.
        undefined: the types without a size, which get that of SUMO's car.
        jumps: number of places to which no way leads.
    """

    def __init__(self, zones: Zones, sizes: Mapping[str, Sequence[float]]) -> None:
        self.town, self._zones, self._sizes = zones.town, zones, sizes
        self.undefined, self.jumps = set[str](), 0

    def passages(self, way: _Way) -> Iterator[Passage]:
        """The passages of a vehicle, whose places are put on one axis.

        Raises:
            InputError: a lane is not in the network.
        """
        # SUMO names the copy of a type for a single vehicle type@vehicle.
        size = self._sizes.get(way.type) or self._sizes.get(way.type.partition("@")[0])
        self.undefined |= set() if size else {way.type}
        length_m, width_m, gain, loss, most_mps = size or self._sizes["DEFAULT_VEHTYPE"]
        body = Vehicle(1.0, _RANGE_M, _RANGE_M, length_m, width_m, gain, loss, gain)
        car = Car(way.id, way.type, False, body, 1.0, most_mps)
        last, start_m, links, states = "", 0.0, dict[float, Connection](), list[FloatArray]()
        for lane, of in way.runs:
            at_m, chain = start_m, self._chain(last, lane)
            if last and not chain and _edge(lane) != _edge(last):
                self.jumps += not last.startswith(":")
                yield from self._over(car, np.concatenate(states), links)
                at_m, links, states = 0.0, {}, []
            for each, link in chain:
                if _edge(each) == _edge(lane):
                    # It is inside the junction, and goes on from the lane of this connection.
                    last = link.from_lane
                    break
                if each == link.from_lane:
                    start_m = at_m
                    links[at_m + self.town.lane(each).length_m] = link
                at_m += self.town.lane(each).length_m
            else:
                last, start_m = lane, at_m
            states.append(np.add(np.reshape(of, (-1, 3)), [0.0, at_m, 0.0]))
        yield from self._over(car, np.concatenate(states), links)

    @cache  # noqa: B019 - as long as the recording is measured
    def _chain(self, lane: str, goal: str) -> Sequence[tuple[str, Connection]]:
        """The lanes from one to the next edge, with their connection."""
        town = self.town
        try:
            town.lane(goal)
        except KeyError:
            allowed = "FCD of this network"
            raise InputError(f"lane {goal}", "is not in the network", allowed) from None
        if not lane or _edge(lane) == _edge(goal):
            return ()
        links = [link for each in town.lanes(_edge(lane)) for link in town.ahead(each)]
        links = [of for of in links if _edge(goal) in map(_edge, (*of.via, of.to_lane))]
        links.sort(key=lambda of: (goal in of.via, of.from_lane == lane, goal == of.to_lane))
        return [(each, link) for link in links[-1:] for each in (link.from_lane, *link.via)]

    def _over(
        self, car: Car, states: FloatArray, links: Mapping[float, Connection]
    ) -> Iterator[Passage]:
        """The passages over the crosswalks of connections, by the place of the stop line."""
        body, at_m = car.vehicle, states[:, 1]
        for stop_m, link in links.items():
            for crosswalk in self._zones.crosswalks(link):
                found = self._zones.at(link, crosswalk, body.length_m, body.width_m)
                if found is None:
                    continue
                passage = Passage(car, crosswalk, link, *found, stop_m, body)
                begin_m, last = passage.centre_m - _RANGE_M, len(at_m) - 1
                first, end = np.searchsorted(at_m, (begin_m, passage.last_m)).tolist()
                passage.ended = PASSED if end <= last else _CUT_OFF
                begin_s = np.interp(begin_m, at_m, states[:, 0])
                passage.trace_offset_s = float(states[min(first, last), 0] - begin_s)
                way_m = min(max(passage.centre_m - float(at_m[0]), 0.1), _RANGE_M)
                passage.begin(float(states[min(first, last), 0]), way_m)
                passage.xs_m = at_m[first : end + 1] - passage.centre_m
                passage.speeds_mps = states[first : end + 1, 2].copy()
                yield passage


def _walks(ways: Sequence[_Way], town: Town, crosswalks: Iterable[str]) -> dict[str, list[Walked]]:
    """Everybody who went over each crosswalk.

    They are seen from the walking area before it until their first place beyond it, which shows
    when they reached the kerb.
    """
    people: dict[str, list[Walked]] = {name: [] for name in crosswalks}
    x = np.array([each for way in ways for _, of in way.runs for each in of[1::3]])
    digits = next((n for n in range(_MOST_DIGITS) if np.allclose(x, x.round(n), 0.0, 1e-9)), 99)
    # A place is off by half of its last digit in both directions.
    rounding_m = 10.0**-digits / 2**0.5
    none = ("", np.empty((0, 3)))
    for way in ways:
        runs = [none, *((edge, np.reshape(of, (-1, 3))) for edge, of in way.runs), none]
        for (_, before), (edge, there), (_, after) in zip(runs, runs[1:], runs[2:], strict=False):
            at = town.crosswalks.get(edge)
            if edge in people and at and at.area.dwithin(shapely.Point(there[0, 1:]), _BESIDE_M):
                places = np.concatenate([before, there, after[:1]])
                on = [len(before) <= i < len(before) + len(there) for i in range(len(places))]
                axis, (time_s, xs, ys) = Axis(at), (array("d", of.tolist()) for of in places.T)
                first_m = axis.along_m(xs[0], ys[0])
                seen = Seen(way.id, len(people[edge]), first_m, time_s, xs, ys, on)
                walked = walked_of(seen, axis, rounding_m)
                people[edge] += [walked] if walked else []
    return people


def _edge(lane: str) -> str:
    return lane.rpartition("_")[0]


def _notes(
    drives: _Drives, found: Sequence[Passage], step_s: float, motion: StepMotion | None
) -> tuple[Note, ...]:
    """What was left out and why, and how the records were read."""
    refused = Counter(of.refused for of in drives.town.crosswalks.values() if of.refused)
    undefined, jumps = ", ".join(sorted(drives.undefined)), drives.jumps
    cut_off = sum(each.ended == _CUT_OFF for each in found)
    said = {
        "types": undefined and f"No --types file defines {undefined}: measured as SUMO's car.",
        "cut off": (cut_off or jumps)
        and f"Passages not measured whole: at {cut_off:,} records end, at {jumps:,} they jump.",
        "crosswalks": refused
        and f"Left out: {'; '.join(f'{n:,} crosswalks, {why}' for why, n in refused.items())}.",
        "records": f"Records are {step_s:g} s apart; times between them are interpolated. "
        + "These are not SUMO's steps: vehicles move evenly between them. " * (motion is None)
        + "Whoever waits and never goes is not in them.",
    }
    return tuple(Note(key, rank, key, of) for rank, (key, of) in enumerate(said.items()) if of)
