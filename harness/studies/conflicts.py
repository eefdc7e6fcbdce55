"""Conflicts of vehicles and people in SUMO's FCD output, measured as a simulation's passages."""

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
import shapely

from harness.core.encounter import StepMotion, Vehicle
from harness.core.errors import InputError
from harness.engine.fcd import records, sizes_of
from harness.results.finding import Plain
from harness.results.notes import Note
from harness.results.result import Result, listed
from harness.results.simulated import which
from harness.results.tables import PASSAGES, Row
from harness.scenario.sections import ConflictsSection
from harness.simulation.cars import Car, Passage
from harness.simulation.listing import chosen
from harness.simulation.passages import passages
from harness.simulation.walked import Axis, Walked, walked_of
from harness.simulation.zones import Zones
from harness.site.town import Town
from harness.studies.recorded import CUT_OFF, RANGE_M, Reader

_CAR = "DEFAULT_VEHTYPE"
_MOST_ROWS = 12
"""Rows of the first screen, and of the worst passages."""
_BESIDE_M, _MOST_BESIDE = 3.0, 0.1
"""People are elsewhere if more of their records than this share are further from the crosswalk."""
_EXACT_DIGITS = 7
_KINDS = {"with people": "met", "contacts": "touched", "PET": "pet", "TTC": "ttc", "DRAC": "drac"}
"""What is counted, with the rows of the table of passages that it counts."""
_WORST = {
    **{name: name.replace("_", " ") for name in ("crosswalk", "vehicle", "type", "manoeuvre")},
    **{"front_s": "at, s", "contact_person": "touched", "contact_speed_mps": "speed then, m/s"},
    **{"pet_s": "PET, s", "min_ttc_s": "TTC, s", "max_drac_mps2": "DRAC, m/s²"},
}


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
    town = Town.read(net)
    usable = [name for name, each in town.crosswalks.items() if each.refused is None]
    names = [chosen(town, name).id for name in edges] or usable
    times = [time_s for time_s, _ in islice(groupby(records(files[0]), lambda of: of[0]), 200)]
    if len(times) < 2:
        raise InputError(str(files[0]), "has no two times with vehicles", "FCD of some steps")
    step_s = round(float(np.diff(times).min()), 6)
    zones = Zones(town, step_s, names)
    reader = Reader(zones, names, _cars(net, types), step_s)
    for file in files:
        reader.read(file)
    people = _walked(reader, town, ", ".join(map(str, files)))
    motion, explained = _motion(reader.passages, step_s)
    columns = passages(reader.passages, people, zones, step_s, motion)
    values = zip(*columns.values(), strict=True)
    table = PASSAGES.of([dict(zip(columns, of, strict=True)) for of in values])
    masks = {name: which(kind, limits) for name, kind in _KINDS.items()}
    fields = {name: pc.field(name) for name in _WORST}
    frame = ds.dataset(table).to_table(columns=fields | masks).to_pandas()
    found = _found(frame, people)
    bad = frame[frame[["PET", "TTC", "DRAC"]].any(axis=1)]
    order = {"contact_speed_mps": False, "pet_s": True, "min_ttc_s": True}
    bad = bad.sort_values([*order], ascending=[*order.values()])[[*_WORST]].rename(columns=_WORST)
    shown = listed(
        "conflicts",
        found[:_MOST_ROWS],
        f"Conflicts at {len(people)} crosswalks",
        ["The worst passages, and all crosswalks: --full; every passage: --table FILE.csv"],
    )
    result = replace(
        shown,
        scope=f"{found[0]['passages']:,} passages, {found[0]['people']:,} people",
        about=f"PET < {limits.pet_s:g} s, TTC < {limits.ttc_s:g} s, DRAC > {limits.drac_mps2:g} "
        "m/s²; a contact is a conflict of every kind",
        full=tuple(
            replace(listed("", rows).screen, title=title)
            for title, rows in (
                ("All crosswalks", found),
                ("The worst passages", _plain(bad[:_MOST_ROWS])),
            )
        ),
        notes=_notes(reader, town, step_s, explained),
        facts={
            "files": ", ".join(map(str, files)),
            "net": str(net),
            "step_s": step_s,
            "motion": motion if explained else "places",
            **{f"{kind}_records": reader.counts[kind] for kind in ("vehicles", "people")},
            **limits.model_dump(),
        },
        records=found,
    )
    return result, table.drop_columns(["cell", "pair", "arm"]).to_pylist()


def _cars(net: Path, types: Sequence[Path]) -> Mapping[str, Car]:
    """A vehicle of each type; "" is SUMO's car."""
    cars = {}
    for name, (length_m, width_m, gain, loss, most_mps) in sizes_of(net, types).items():
        body = Vehicle(1.0, RANGE_M, RANGE_M, length_m, width_m, gain, loss, gain)
        cars[name] = Car("", name, False, body, 1.0, most_mps)
    return cars | {"": cars[_CAR]}


def _walked(reader: Reader, town: Town, where: str) -> dict[str, list[Walked]]:
    """Everybody who went over each crosswalk.

    Raises:
        InputError: the recording has no passages or people, or is of another network.
    """
    for what, any_of in (("vehicles", reader.passages), ("people", any(reader.people.values()))):
        if not any_of:
            problem = f"0 of {reader.counts[what]:,} records of {what} are over a crosswalk"
            raise InputError(where, problem, f"FCD of this network with {what}, or --person-fcd")
    # A place is off by half of its last digit in both directions.
    rounding_m = 10.0**-reader.digits / 2**0.5 if reader.digits < _EXACT_DIGITS else 0.0
    people, beside_m = {}, []
    for name, here in reader.people.items():
        crosswalk = town.crosswalks[name]
        found = (walked_of(each, Axis(crosswalk), rounding_m) for each in here)
        people[name] = [each for each in found if each is not None]
        for each in here:
            places = shapely.points(np.column_stack((each.x, each.y))[np.array(each.on, bool)])
            beside_m += shapely.distance(places, crosswalk.area).tolist()
    if np.mean(np.array(beside_m) > _BESIDE_M) > _MOST_BESIDE:
        allowed = "FCD of this network, without --fcd-output.geo"
        raise InputError(where, "the people on its crosswalks are recorded elsewhere", allowed)
    return people


def _motion(found: Sequence[Passage], step_s: float) -> tuple[StepMotion, bool]:
    """How vehicles move between two records, and whether the records show it.

    Either Euler's rule (the new speed) or the ballistic one (the mean of both) gives the distance
    of a step.  If neither does, the simulation's steps are shorter than the time between records,
    and the vehicles get the mean speeds between their places.
    """
    moved = np.concatenate([np.diff(each.xs_m) for each in found])
    before = np.concatenate([each.speeds_mps[:-1] for each in found])
    after = np.concatenate([each.speeds_mps[1:] for each in found])
    changing = np.abs(after - before) > 0.05
    if not changing.any():
        return "euler", True
    euler = float(np.median(np.abs(moved - after * step_s)[changing]))
    ballistic = float(np.median(np.abs(moved - (after + before) / 2 * step_s)[changing]))
    if min(euler, ballistic) < 0.011 + 0.01 * step_s:
        return ("euler" if euler <= ballistic else "ballistic"), True
    for each in found:
        driven = np.diff(each.xs_m) / step_s
        each.speeds_mps = array("d", [*each.speeds_mps[:1], *driven.tolist()])
    return "euler", False


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
    rounded = frame.round(2).astype(object)
    rows: list[dict[str, Plain]] = rounded.where(rounded.notna(), None).to_dict("records")  # type: ignore[assignment]
    return rows


def _notes(reader: Reader, town: Town, step_s: float, explained: bool) -> tuple[Note, ...]:
    """What was left out and why, and how the records were read."""
    refused = Counter(each.refused for each in town.crosswalks.values() if each.refused)
    left_out = "; ".join(f"{count:,} since {why}" for why, count in refused.items())
    cut_off = sum(each.ended == CUT_OFF for each in reader.passages)
    split = sum(each.zone.split for each in reader.passages)
    jumps, types = reader.counts["jumps"], ", ".join(sorted(reader.undefined))
    said = {
        "types": types and f"No --types file defines {types}: measured as SUMO's car.",
        "cut off": cut_off and f"{cut_off:,} passages have no end: {CUT_OFF}.",
        "jumps": jumps and f"At {jumps:,} places a vehicle jumps: no passage is measured there.",
        "crosswalks": left_out and f"Crosswalks left out: {left_out}.",
        "grazed": split
        and f"{split:,} passages touch their crosswalk twice, or for less than a step.",
        "motion": not explained
        and "Records are further apart than SUMO's steps: vehicles move evenly between them.",
        "records": f"Records are {step_s:g} s apart; times between them are interpolated. "
        "Whoever waits and never goes is not in them.",
    }
    return tuple(Note(key, rank, key, of) for rank, (key, of) in enumerate(said.items()) if of)
