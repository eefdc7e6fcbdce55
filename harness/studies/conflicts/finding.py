"""From a recording and its network to the measures of every passage straight over a crosswalk."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.encounter import Ending, StepMotion, Trace, Vehicle
from harness.core.errors import InputError, nearest_name
from harness.episode.simulation.cutting import (
    RANGE_M,
    Cut,
    by_places,
    cuts_of,
    motion_of,
    people_over,
    step_of,
    wanted_edges,
    wanted_lanes,
    ways_by_edges,
)
from harness.episode.simulation.passages import PersonTrack, passage
from harness.episode.simulation.recorded import Recorded, read_recorded
from harness.measures import EpisodeRecord, crossing_time, measure
from harness.measures.catalogue import COLUMNS
from harness.scenario.sections import ConflictsSection
from harness.site import Crosswalk, RoadNetwork, crosswalks_of, read_network
from harness.statistics.conflicts import CONFLICTS
from harness.studies.conflicts.places import in_network
from harness.studies.conflicts.vehicle_types import VehicleType, read_types, type_of

Progress = Callable[[int, int, str], None]

_SHOWN = 5
"""Number of names that a message lists."""


@dataclass(frozen=True)
class ConflictPassage:
    """A passage straight over a crosswalk: a row of ``passages.parquet``, and its trace.

    ``begin_s`` is the simulation's time at which the trace begins.
    """

    crosswalk: str
    vehicle: str
    type: str
    approach: str
    begin_s: float
    record: EpisodeRecord
    trace: Trace
    people: tuple[str, ...]
    """Ids of the people who are on the crosswalk during the passage, by index of their arrival."""

    def row(self) -> dict[str, Any]:
        """The passage as a row of the table."""
        record, edge_s = self.record, crossing_time(self.trace, -self.trace.crossing.width_m / 2)
        index, contact_s = record.contact_index, record.contact_time_s
        return {
            "crosswalk": self.crosswalk,
            "approach": self.approach,
            "vehicle": self.vehicle,
            "type": self.type,
            "begin_s": self.begin_s,
            "edge_s": None if edge_s is None else self.begin_s + edge_s,
            "range_m": self.trace.vehicle.trigger_range_m,
            "length_m": self.trace.vehicle.length_m,
            "width_m": self.trace.vehicle.width_m,
            "speed_mps": float(self.trace.speed_mps[0]),
            "people": record.pedestrians,
            "ending": record.ending.value,
            "contact": None if record.contact is None else record.contact.value,
            "contact_person": None if index is None else self.people[index],
            "contact_s": None if contact_s is None else self.begin_s + contact_s,
            **{name: getattr(record, name) for name in COLUMNS},
        }

    def is_conflict(self, name: str, thresholds: ConflictsSection) -> bool:
        """Whether it is a conflict of a kind of ``CONFLICTS``; a contact is one of every kind."""
        kind = next(each for each in CONFLICTS if each.name == name)
        value, limit = getattr(self.record, kind.column), getattr(thresholds, kind.threshold)
        if self.record.ending is Ending.CRASHED:
            return True
        return value is not None and bool(value > limit if kind.above else value < limit)


@dataclass(frozen=True)
class CrosswalkConflicts:
    """What was found at one crosswalk.

    ``not_measured`` has the number of passages by why they are not measured.
    """

    crosswalk: Crosswalk
    walks: int
    passages: tuple[ConflictPassage, ...]
    not_measured: Mapping[str, int]

    def row(self, thresholds: ConflictsSection) -> dict[str, Any]:
        """The crosswalk as a row of the summary."""
        met = [each for each in self.passages if each.record.pedestrians]
        records = [each.record for each in met]
        return {
            "crosswalk": self.crosswalk.id,
            "length_m": self.crosswalk.length_m,
            "width_m": self.crosswalk.width_m,
            "signalled": self.crosswalk.signalled,
            "people": self.walks,
            "passages": len(self.passages),
            "with_people": len(met),
            "contacts": sum(record.ending is Ending.CRASHED for record in records),
            **{
                f"conflicts_{kind.name}": sum(
                    each.is_conflict(kind.name, thresholds) for each in met
                )
                for kind in CONFLICTS
            },
            "min_pet_s": _extreme(min, [record.pet_s for record in records]),
            "min_ttc_s": _extreme(min, [record.min_ttc_s for record in records]),
            "max_drac_mps2": _extreme(max, [record.max_drac_mps2 for record in records]),
            **{reason: self.not_measured.get(reason, 0) for reason in REASONS},
        }


REASONS = {
    "turning": "the way is not straight from 10 m before the crosswalk until the rear has left it",
    "oblique": "the way meets the crosswalk at more than 20° from a right angle",
}
"""Why a passage is counted and not measured."""


@dataclass(frozen=True)
class ConflictFindings:
    """The conflicts of a recording.

    ``undefined_types`` has the number of passages by type without a definition; they are measured
    as passenger cars.  ``by_places`` says that the recorded speeds do not explain the recorded
    places, so that vehicles move between their places at constant speed.  ``unusable`` has the
    crosswalks at which nothing can be measured, and why.
    """

    files: tuple[Path, ...]
    net: Path
    step_s: float
    motion: StepMotion
    by_places: bool
    rounding_m: float
    geo: bool
    crosswalks: tuple[CrosswalkConflicts, ...]
    undefined_types: Mapping[str, int]
    unusable: Mapping[str, str]
    vehicle_records: int
    person_records: int
    thresholds: ConflictsSection = field(default_factory=ConflictsSection)

    @property
    def passages(self) -> list[ConflictPassage]:
        """The passages of all crosswalks."""
        return [each for crosswalk in self.crosswalks for each in crosswalk.passages]


def _extreme(best: Callable[..., float], values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return best(known) if known else None


def find_conflicts(
    files: Sequence[Path],
    net: Path,
    *,
    types: Sequence[Path] = (),
    edges: Sequence[str] = (),
    progress: Progress = lambda _done, _planned, _unit: None,
) -> ConflictFindings:
    """Measure every passage straight over a crosswalk in a recording.

    Args:
        files: FCD outputs of one simulation.
        net: its network.
        types: files that define its vehicle types.
        edges: ids of the crossings; empty: all.
        progress: told (done, planned, what is counted).

    Raises:
        InputError: a file cannot be used, nobody crosses, or no vehicle passes.
    """
    known_types = read_types(types)
    network = read_network(net)
    crosswalks = _chosen(network, net, edges)
    lanes, areas = wanted_lanes(network, crosswalks), wanted_edges(crosswalks)
    recorded = read_recorded(
        list(files), lanes, areas, lambda done, planned: progress(done, planned, "bytes")
    )
    _check_recorded(recorded, files, net, crosswalks)
    step_s = step_of(recorded.vehicles)
    people, rounding_m, geo = in_network(recorded.people, network, crosswalks, net)
    walks = people_over(people, crosswalks, step_s)
    cuts = list(cuts_of(recorded.vehicles, ways_by_edges(network, crosswalks), step_s))
    if not cuts:
        problem = f"0 vehicles of {_names(files)} go over {_crosswalks(crosswalks)}"
        raise InputError(str(net), problem, "the network of this simulation, and its crossings")
    motion, explained = motion_of(cuts, step_s)
    if not explained:
        motion = "euler"
        cuts = [Cut(cut.way, cut.vehicle, by_places(cut.track)) for cut in cuts]
    measured, left_out, undefined = _measured(
        cuts, walks, recorded.types, known_types, motion, rounding_m, progress
    )
    if not measured:
        counts = Counter[str]()
        for (_, reason), count in left_out.items():
            counts[reason] += count
        others = ", ".join(f"{count:,} {reason}" for reason, count in counts.items())
        problem = f"0 passages straight over it ({others})"
        raise InputError(_crosswalks(crosswalks), problem, "one that vehicles pass straight")
    progress(len(cuts), len(cuts), "passages")
    return ConflictFindings(
        files=tuple(files),
        net=net,
        step_s=step_s,
        motion=motion,
        by_places=not explained,
        rounding_m=rounding_m,
        geo=geo,
        crosswalks=tuple(
            CrosswalkConflicts(
                each,
                len(walks[each.id]),
                tuple(passage for passage in measured if passage.crosswalk == each.id),
                {
                    reason: count
                    for (crosswalk, reason), count in left_out.items()
                    if crosswalk == each.id
                },
            )
            for each in crosswalks
            if each.refused is None
        ),
        undefined_types=undefined,
        unusable={each.id: each.refused for each in crosswalks if each.refused is not None},
        vehicle_records=recorded.vehicle_records,
        person_records=recorded.person_records,
    )


def _names(files: Sequence[Path]) -> str:
    return ", ".join(map(str, files))


def _crosswalks(crosswalks: Sequence[Crosswalk]) -> str:
    ids = [each.id for each in crosswalks]
    return "crosswalk " + ", ".join(ids[:_SHOWN]) + ", …" * (len(ids) > _SHOWN)


def _chosen(network: RoadNetwork, net: Path, edges: Sequence[str]) -> tuple[Crosswalk, ...]:
    """All crosswalks, or those named."""
    ids = network.crossings
    if not ids:
        allowed = "one with crossings: netconvert --crossings.guess adds them"
        raise InputError(str(net), "the network has no crossing", allowed)
    for edge in edges:
        if edge not in ids:
            some = ", ".join([*ids][:_SHOWN]) + ", …" * (len(ids) > _SHOWN)
            raise InputError("--edge", f"no crossing {edge!r}", some, nearest_name(edge, ids))
    crosswalks = crosswalks_of(network)
    chosen = tuple(each for each in crosswalks if not edges or each.id in edges)
    if not any(each.ways for each in chosen):
        reasons = [each.refused or "no way of vehicles leads over it" for each in chosen]
        raise InputError(_crosswalks(chosen), reasons[0], "a crosswalk that vehicles cross")
    return chosen


def _check_recorded(
    recorded: Recorded, files: Sequence[Path], net: Path, crosswalks: Sequence[Crosswalk]
) -> None:
    """Refuse a recording without vehicles near, or people on, the crosswalks."""
    names = _names(files)
    if not recorded.vehicle_records:
        raise InputError(names, "has no vehicles", "SUMO's --fcd-output")
    if not recorded.person_records:
        allowed = "a simulation with people; those of --person-fcd-output: --person-fcd FILE"
        raise InputError(names, "has no people", allowed)
    if recorded.vehicles.empty:
        problem = f"none of its {recorded.vehicle_records:,} records of vehicles is near"
        raise InputError(names, f"{problem} {_crosswalks(crosswalks)}", f"the network, not {net}?")
    if not recorded.people["edge"].isin([each.id for each in crosswalks]).any():
        problem = f"none of its {recorded.person_records:,} records of people is on"
        raise InputError(names, f"{problem} {_crosswalks(crosswalks)}", "a crosswalk that is used")


def _measured(
    cuts: Sequence[Cut],
    walks: Mapping[str, Sequence[PersonTrack]],
    type_names: Mapping[str, str],
    types: Mapping[str, VehicleType],
    motion: StepMotion,
    rounding_m: float,
    progress: Progress,
) -> tuple[list[ConflictPassage], Counter[tuple[str, str]], Counter[str]]:
    """The passages by time, those left out by crosswalk and reason, and undefined types."""
    left_out: Counter[tuple[str, str]] = Counter()
    undefined: Counter[str] = Counter()
    times = {
        crosswalk: np.array([(each.time_s[0], each.time_s[-1]) for each in people]).reshape(-1, 2)
        for crosswalk, people in walks.items()
    }
    passages = []
    for done, cut in enumerate(cuts):
        if done % 100 == 0:
            progress(done, len(cuts), "passages")
        name = type_names.get(cut.vehicle) or ""
        kind, known = type_of(name, types)
        reason = _why_not(cut, kind)
        if reason is not None:
            left_out[cut.way.crosswalk, reason] += 1
            continue
        undefined.update([] if known else [name])
        begins, ends = times[cut.way.crosswalk].T
        there = np.flatnonzero((begins <= cut.track.time_s[-1]) & (ends >= cut.track.time_s[0]))
        people = [walks[cut.way.crosswalk][number] for number in there.tolist()]
        trace = passage(
            cut.track, people, cut.way, _vehicle(cut, kind), motion=motion, rounding_m=rounding_m
        )
        if len(trace.x_m) < 2:
            continue
        passages.append(
            ConflictPassage(
                crosswalk=cut.way.crosswalk,
                vehicle=cut.vehicle,
                type=name,
                approach=cut.way.approach,
                begin_s=_begin_s(cut, trace),
                record=measure([trace])[0],
                trace=trace,
                people=tuple(person.id for person in people),
            )
        )
    passages.sort(key=lambda each: (each.begin_s, each.vehicle))
    return passages, left_out, undefined


def _begin_s(cut: Cut, trace: Trace) -> float:
    """The simulation's time of a trace's first state."""
    return float(cut.track.time_s[np.searchsorted(cut.track.x_m, trace.x_m[0])])


def _why_not(cut: Cut, kind: VehicleType) -> str | None:
    if cut.way.oblique and cut.way.is_straight(kind.length_m):
        return "oblique"
    return None if cut.way.is_straight(kind.length_m) else "turning"


def _vehicle(cut: Cut, kind: VehicleType) -> Vehicle:
    """The constants of a passage; nobody knows the driver's own speed, so v0 is the limit."""
    range_m = min(RANGE_M, -float(cut.track.x_m[0]), cut.way.straight_before_m)
    return Vehicle(
        initial_speed_mps=min(cut.way.crossing.speed_limit_mps or math.inf, kind.max_speed_mps),
        trigger_range_m=range_m,
        detection_range_m=range_m,
        length_m=kind.length_m,
        width_m=kind.width_m,
        max_acceleration_mps2=kind.acceleration_mps2,
        max_deceleration_mps2=kind.deceleration_mps2,
        resume_acceleration_mps2=kind.acceleration_mps2,
    )
