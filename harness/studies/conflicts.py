"""Conflicts of vehicles and people in SUMO's FCD output, measured as a simulation's passages."""

import json
from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby, islice
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.compute as pc
import pyarrow.dataset as ds

from harness.core.encounter import StepMotion
from harness.core.errors import InputError
from harness.engine.fcd import records, sizes_of
from harness.results.finding import Plain
from harness.results.notes import Note
from harness.results.result import Result, listed
from harness.results.simulated import which
from harness.results.tables import PASSAGES, Row
from harness.scenario.sections import ConflictsSection
from harness.simulation.cars import Passage
from harness.simulation.listing import chosen
from harness.simulation.passages import passages
from harness.simulation.walked import Walked
from harness.simulation.zones import Zones
from harness.site.town import Town
from harness.studies.recorded import CUT_OFF, Drives, read_ways, walks

_MOST_ROWS = 12
"""Rows of the first screen, and of the worst passages."""
_KINDS = {"with people": "met", "contacts": "touched", "PET": "pet", "TTC": "ttc", "DRAC": "drac"}
"""What is counted, with the rows of the table of passages that it counts."""
_SHOWN = (
    *("crosswalk", "vehicle", "manoeuvre", "front_s", "contact_person", "contact_speed_mps"),
    *("pet_s", "min_ttc_s", "max_drac_mps2"),
)


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
    names = [chosen(town, name).id for name in edges] or usable
    times = [time_s for time_s, _ in islice(groupby(records(files[0]), lambda of: of[0]), 200)]
    if len(times) < 2:
        raise InputError(str(files[0]), "has no two times with vehicles", "FCD of some steps")
    step_s = round(float(np.diff(times).min()), 6)
    zones = Zones(town, step_s, names)
    drives, walked = Drives(zones, sizes_of(net, types)), {*names}.union(*map(town.areas, names))
    vehicles, walkers = read_ways(files, walked, step_s)
    found = [each for way in vehicles for each in drives.passages(way)]
    people = walks(walkers, town, names)
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
    order = {"contact_speed_mps": False, "pet_s": True, "min_ttc_s": True}
    bad = frame[frame[["PET", "TTC", "DRAC"]].any(axis=1)]
    bad = bad.sort_values([*order], ascending=[*order.values()])[[*_SHOWN]]
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
        facts={
            **{"files": where, "net": str(net), "step_s": step_s, "motion": motion or "places"},
            **limits.model_dump(),
        },
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
    changing = np.abs(after - before) > 0.05
    rules: dict[StepMotion, np.ndarray] = {"euler": after, "ballistic": (after + before) / 2}
    for motion, speed_mps in rules.items():
        off_m = np.abs(moved - speed_mps * step_s)[changing]
        if not len(off_m) or np.median(off_m) < 0.011 + 0.01 * step_s:
            return motion
    for each in found:
        driven_mps = np.diff(each.xs_m) / step_s
        each.speeds_mps = array("d", [*each.speeds_mps[:1], *driven_mps.tolist()])
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


def _notes(
    drives: Drives, found: Sequence[Passage], step_s: float, motion: StepMotion | None
) -> tuple[Note, ...]:
    """What was left out and why, and how the records were read."""
    refused = Counter(of.refused for of in drives.town.crosswalks.values() if of.refused)
    undefined, jumps = ", ".join(sorted(drives.undefined)), drives.jumps
    cut_off = sum(each.ended == CUT_OFF for each in found)
    split = sum(each.zone.split for each in found)
    said = {
        "types": undefined and f"No --types file defines {undefined}: measured as SUMO's car.",
        "cut off": cut_off and f"{cut_off:,} passages have no end: {CUT_OFF}.",
        "jumps": jumps and f"At {jumps:,} places a vehicle jumps: no passage is measured there.",
        "crosswalks": refused
        and f"Left out: {'; '.join(f'{n:,} crosswalks, {why}' for why, n in refused.items())}.",
        "grazed": split
        and f"{split:,} passages touch their crosswalk twice, or for less than a step.",
        "records": f"Records are {step_s:g} s apart; times between them are interpolated. "
        + "These are not SUMO's steps: vehicles move evenly between them. " * (motion is None)
        + "Whoever waits and never goes is not in them.",
    }
    return tuple(Note(key, rank, key, of) for rank, (key, of) in enumerate(said.items()) if of)
