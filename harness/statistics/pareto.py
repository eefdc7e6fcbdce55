"""Which cells no other beats in both the ratio of times and κ, as far as the pairs can tell."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from harness.statistics.intervals import Interval
from harness.statistics.paired import CrashTest


class Relation(StrEnum):
    """How one cell stands to another in one measure; less is better in both measures."""

    BETTER = "better"
    WORSE = "worse"
    ALIKE = "alike"
    """The same in every single pair."""
    UNDECIDED = "undecided"

    def reversed(self) -> "Relation":
        """The other way round."""
        turned = {Relation.BETTER: Relation.WORSE, Relation.WORSE: Relation.BETTER}
        return turned.get(self, self)


class Place(StrEnum):
    """A cell's place on the front, and the cells that matter for it."""

    FRONT = "on the front"
    DOMINATED = "dominated"
    UNDECIDED = "undecided"


@dataclass(frozen=True, slots=True)
class Standing:
    """A cell's place on the Pareto front of (ratio of times, κ).

    ``dominated_by`` and ``open_against`` hold positions of other cells: those that dominate it,
    and those of which it cannot be told whether they do.
    """

    place: Place
    dominated_by: tuple[int, ...]
    open_against: tuple[int, ...]


def relation_of_times(
    difference: Interval, counted_in_one: int, adjusted_p: float, level: float
) -> Relation:
    """The relation by a paired difference a − b.

    Decided where its interval leaves out 0 and the sign-flip test, adjusted within its family,
    rejects at ``level``.  Cells of which ``counted_in_one`` pairs count in one alone are never
    alike.
    """
    if difference.low is None or difference.high is None:
        return Relation.UNDECIDED
    if difference.low == difference.high == 0 and counted_in_one == 0:
        return Relation.ALIKE
    if adjusted_p >= level or difference.low <= 0 <= difference.high:
        return Relation.UNDECIDED
    return Relation.BETTER if difference.high < 0 else Relation.WORSE


def relation_of_crashes(test: CrashTest, adjusted_p: float, level: float) -> Relation:
    """Decided where the McNemar test, adjusted within its family, rejects at ``level``."""
    if test.pairs and test.only_a == test.only_b == test.ran_in_one == 0:
        return Relation.ALIKE
    if adjusted_p >= level:
        return Relation.UNDECIDED
    return Relation.BETTER if test.only_a < test.only_b else Relation.WORSE


def pareto_front(
    count: int, relations: Mapping[tuple[int, int], tuple[Relation, Relation]]
) -> list[Standing]:
    """The place of every cell.

    A dominates B if it is better in one measure and better or alike in the other.  It does not if
    B is better in a measure, or if both are alike.  Otherwise it cannot be told.  A cell is on the
    front if no cell dominates it and all can be told.

    Args:
        count: number of cells.
        relations: of a to b in (ratio of times, κ), for each a < b.
    """
    standings = []
    for b in range(count):
        dominating: list[int] = []
        untold: list[int] = []
        for a in range(count):
            if a == b:
                continue
            if a < b:
                pair: Sequence[Relation] = relations[a, b]
            else:
                pair = [relation.reversed() for relation in relations[b, a]]
            if Relation.WORSE in pair or set(pair) == {Relation.ALIKE}:
                continue
            (untold if Relation.UNDECIDED in pair else dominating).append(a)
        place = Place.DOMINATED if dominating else Place.UNDECIDED if untold else Place.FRONT
        standings.append(Standing(place, tuple(dominating), tuple(untold)))
    return standings
