"""Takes a recording and its network and returns the measures of every straight passage."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from harness.core.encounter import StepMotion, Trace, Vehicle
from harness.core.errors import InputError, nearest_name
from harness.encounter.simulation.cutting import (
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
from harness.encounter.simulation.passages import PersonTrack, passage
from harness.encounter.simulation.recorded import Recorded, read_recorded
from harness.measures import measure
from harness.old.studies.conflicts.places import in_network
from harness.old.studies.conflicts.records import (
    TURN_DEG,
    ConflictFindings,
    ConflictPassage,
    CrosswalkConflicts,
)
from harness.old.studies.conflicts.vehicle_types import VehicleType, read_types, type_of
from harness.scenario import ConflictsSection
from harness.site import Crosswalk, RoadNetwork, crosswalks_of, read_network

Progress = Callable[[int, int, str], None]
_DEFAULTS = ConflictsSection()

_SHOWN = 5
"""Number of names that a message lists."""


def find_conflicts(
    files: Sequence[Path],
    net: Path,
    *,
    types: Sequence[Path] = (),
    edges: Sequence[str] = (),
    thresholds: ConflictsSection = _DEFAULTS,
    progress: Progress = lambda _done, _planned, _unit: None,
) -> ConflictFindings:
    """Measure every passage straight over a crosswalk in a recording.

    Args:
        files: FCD outputs of one simulation.
        net: its network.
        types: files that define its vehicle types.
        edges: ids of the crossings; empty means all.
        thresholds: beyond these a passage counts as a conflict.
        progress: called with the numbers done and planned, and the unit.

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
        raise _nothing_straight(crosswalks, counts)
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
            _at(each, len(walks[each.id]), measured, left_out)
            for each in crosswalks
            if each.refused is None
        ),
        undefined_types=undefined,
        unusable={each.id: each.refused for each in crosswalks if each.refused is not None},
        vehicle_records=recorded.vehicle_records,
        person_records=recorded.person_records,
        thresholds=thresholds,
    )


def _at(
    crosswalk: Crosswalk,
    walks: int,
    passages: Sequence[ConflictPassage],
    left_out: Mapping[tuple[str, str], int],
) -> CrosswalkConflicts:
    """Return the conflicts at one crosswalk."""

    return CrosswalkConflicts(
        crosswalk,
        walks,
        tuple(each for each in passages if each.crosswalk == crosswalk.id),
        {reason: count for (edge, reason), count in left_out.items() if edge == crosswalk.id},
    )


def _nothing_straight(crosswalks: Sequence[Crosswalk], counts: Mapping[str, int]) -> InputError:
    """Return the error for a recording in which every vehicle turns."""
    others = ", ".join(f"{count:,} {reason}" for reason, count in counts.items())
    problem = f"0 passages straight over it ({others})"
    return InputError(_crosswalks(crosswalks), problem, "one that vehicles pass straight")


def _names(files: Sequence[Path]) -> str:
    return ", ".join(map(str, files))


def _crosswalks(crosswalks: Sequence[Crosswalk]) -> str:
    ids = [each.id for each in crosswalks]
    return "crosswalk " + ", ".join(ids[:_SHOWN]) + ", …" * (len(ids) > _SHOWN)


def _chosen(network: RoadNetwork, net: Path, edges: Sequence[str]) -> tuple[Crosswalk, ...]:
    """Return the named crosswalks; all if none is named."""
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
    """Refuse a recording without vehicles near the crosswalks or without people on them."""
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
    """Return the measured passages by time, the counts of the others, and undefined types.

    Passages that are left out are counted by crosswalk and reason.
    """
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
    """Return the simulation's time in s at a trace's first state."""
    return float(cut.track.time_s[np.searchsorted(cut.track.x_m, trace.x_m[0])])


def _why_not(cut: Cut, kind: VehicleType) -> str | None:
    if cut.way.is_straight(kind.length_m):
        return "oblique" if cut.way.oblique else None
    return "turning" if cut.way.turn_deg >= TURN_DEG else "bending"


def _vehicle(cut: Cut, kind: VehicleType) -> Vehicle:
    """Return the constants of a passage.

    The driver's desired speed is not recorded, so v0 is the speed limit.
    """
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
