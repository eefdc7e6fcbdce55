"""Chooses the passages of a user's own simulation that are worth watching."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import pandas as pd

from harness.core.encounter import Arm
from harness.old.store.tables import Row
from harness.old.studies.runs.run_data import RunData

Key = tuple[int, int]
"""(cell, pair)."""

MOST_PAIRS = 4
"""Maximum number of pairs with shown passages; each repeats a whole simulation."""

_EACH_CONTACTS = 5
_EACH = 3
"""Number of passages for each reason."""

_BY = {
    "smallest PET": "pet_s",
    "smallest TTC": "min_ttc_s",
    "largest DRAC": "-max_drac_mps2",
    "longest delay": "-delay_s",
}
"""Reasons with their column; a minus before it selects the largest values."""

_ARM_WORDS = {Arm.AV: "AV's arm", Arm.HUMAN: "reference's arm"}


@dataclass(frozen=True)
class ChosenPassage:
    """A passage worth watching, with the same vehicle's passage in the other arm.

    Attributes:
        key: cell and pair.
        arm: the arm in which it is worth watching.
        crosswalk, vehicle: ids.
        numbers: index of its row in ``passages_over``, for each arm that has the passage.
        reasons: the reasons why it is worth watching.
    """

    key: Key
    arm: Arm
    crosswalk: str
    vehicle: str
    numbers: Mapping[Arm, int]
    reasons: tuple[str, ...]


_Where = tuple[int, int, str, str, int]
"""(cell, pair, crosswalk, vehicle, number of the vehicle's earlier passages there)."""


def chosen_passages(run: RunData) -> tuple[ChosenPassage, ...]:
    """Return the most striking passages of at most ``MOST_PAIRS`` pairs, contacts first."""
    rows = _numbered(run.passages_over)
    return tuple(_chosen(rows, None if run.kept_traces else MOST_PAIRS))


def most_striking(
    rows: pd.DataFrame, vehicle: str | None = None, crosswalk: str | None = None
) -> Row | None:
    """Return the most striking passage of an arm; None if there is none.

    A contact comes first, then the smallest PET, the smallest TTC and the longest delay.

    Args:
        rows: rows of ``passages_over`` of one arm of a pair.
        vehicle: id of a vehicle to which the choice is restricted.
        crosswalk: id of a crosswalk to which the choice is restricted.
    """
    if vehicle is not None:
        rows = rows[rows["vehicle"] == vehicle]
    if crosswalk is not None:
        rows = rows[rows["crosswalk"] == crosswalk]
    for _, members in _reasons(rows, each=1):
        if len(members):
            rows = members
            break
    return next(({str(key): row[key] for key in row} for row in rows[:1].to_dict("records")), None)


def chosen_pairs(run: RunData) -> dict[str, list[Key]]:
    """Return the pairs of the chosen passages, by reason."""
    pairs: dict[str, list[Key]] = {}
    for passage in chosen_passages(run):
        for reason in passage.reasons:
            keys = pairs.setdefault(reason, [])
            if passage.key not in keys:
                keys.append(passage.key)
    return pairs


def numbers_of(run: RunData, cell: int, pair: int) -> set[tuple[str, int]]:
    """Return arm and index of each shown passage of a pair."""
    return {
        (arm.value, number)
        for passage in chosen_passages(run)
        if passage.key == (cell, pair)
        for arm, number in passage.numbers.items()
    }


def _numbered(rows: pd.DataFrame) -> pd.DataFrame:
    """Add each row's index in its arm and the number of the vehicle's earlier passages there."""
    arm = ["cell", "pair", "arm"]
    return rows.assign(
        number=rows.groupby(arm).cumcount(),
        before=rows.groupby([*arm, "crosswalk", "vehicle"]).cumcount(),
    )


def _reasons(rows: pd.DataFrame, each: int = _EACH) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield reasons with the rows of one arm, the most striking first.

    Vehicles that are not AVs count only if they had a contact.  In the reference arm a vehicle
    counts as an AV if it is an AV in the other arm.
    """
    yield "contact", rows[rows["contact_time_s"].notna()].head(max(each, _EACH_CONTACTS))
    automated = rows[rows["automated"]]
    for words, column in _BY.items():
        name = column.removeprefix("-")
        defined = automated.dropna(subset=name)
        yield words, defined.sort_values(name, ascending=name == column, kind="stable").head(each)


def _chosen(rows: pd.DataFrame, most_pairs: int | None) -> Iterator[ChosenPassage]:
    by_reason: dict[str, list[tuple[Arm, _Where]]] = {}
    arms = {arm: rows[rows["arm"] == arm.value] for arm in Arm}
    for (words, av), (_, human) in zip(*(_reasons(arms[arm]) for arm in Arm), strict=True):
        for arm, members in ((Arm.AV, av), (Arm.HUMAN, human)):
            by_reason[f"{words}, {_ARM_WORDS[arm]}"] = [(arm, where) for where in _wheres(members)]
    kept = set(_pairs(list(by_reason.values()))[:most_pairs])
    reasons: dict[_Where, list[str]] = {}
    first: dict[_Where, Arm] = {}
    for words, members in by_reason.items():
        for arm, where in members:
            if where[:2] in kept:
                reasons.setdefault(where, []).append(words)
                first.setdefault(where, arm)
    numbers = {
        arm: dict(zip(_wheres(part), part["number"], strict=True)) for arm, part in arms.items()
    }
    for where, why in reasons.items():
        there = {arm: int(known[where]) for arm, known in numbers.items() if where in known}
        yield ChosenPassage(where[:2], first[where], where[2], where[3], there, tuple(why))


def _wheres(rows: pd.DataFrame) -> list[_Where]:
    columns = (rows[name] for name in ("cell", "pair", "crosswalk", "vehicle", "before"))
    return [
        (int(cell), int(pair), crosswalk, vehicle, int(before))
        for cell, pair, crosswalk, vehicle, before in zip(*columns, strict=True)
    ]


def _pairs(lists: Sequence[Sequence[tuple[Arm, _Where]]]) -> list[Key]:
    """Return the pairs of the passages, beginning with the first passage of each reason."""
    in_turn = (each for rank in zip_longest(*lists) for each in rank if each is not None)
    return list(dict.fromkeys(where[:2] for _, where in in_turn))
