"""The Pareto front of ratio of times and κ: whether each cell is on it, or is undecided."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from harness.statistics.intervals import Interval
from harness.statistics.paired import CrashTest


class Relation(StrEnum):
    """The relation of one cell to another in one measure; smaller is better in both measures."""

    BETTER = "better"
    WORSE = "worse"
    ALIKE = "alike"
    """The measure is equal in every pair."""
    UNDECIDED = "undecided"

    def reversed(self) -> "Relation":
        """The relation of the second cell to the first."""
        turned = {Relation.BETTER: Relation.WORSE, Relation.WORSE: Relation.BETTER}
        return turned.get(self, self)


class Place(StrEnum):
    """The place of a cell relative to the front."""

    FRONT = "on the front"
    DOMINATED = "dominated"
    UNDECIDED = "undecided"


@dataclass(frozen=True, slots=True)
class Standing:
    """A cell's place on the Pareto front of (ratio of times, κ).

    ``dominated_by`` holds the positions of the cells that dominate it.  ``open_against`` holds the
    positions of the cells for which this is undecided.
    """

    place: Place
    dominated_by: tuple[int, ...]
    open_against: tuple[int, ...]


def relation_of_times(
    difference: Interval, counted_in_one: int, adjusted_p: float, level: float
) -> Relation:
    """The relation by a paired difference a − b.

    It is decided if the interval excludes 0 and the sign-flip test, adjusted within its family,
    rejects at ``level``.  ``counted_in_one`` is the number of pairs that count in only one cell.
    If there are any, the cells are never alike.
    """
    if difference.low is None or difference.high is None:
        return Relation.UNDECIDED
    if difference.low == difference.high == 0 and counted_in_one == 0:
        return Relation.ALIKE
    if adjusted_p >= level or difference.low <= 0 <= difference.high:
        return Relation.UNDECIDED
    return Relation.BETTER if difference.high < 0 else Relation.WORSE


def relation_of_crashes(test: CrashTest, adjusted_p: float, level: float) -> Relation:
    """The relation by crash rates, decided if the adjusted McNemar test rejects at ``level``."""
    if test.pairs and test.only_a == test.only_b == test.ran_in_one == 0:
        return Relation.ALIKE
    if adjusted_p >= level:
        return Relation.UNDECIDED
    return Relation.BETTER if test.only_a < test.only_b else Relation.WORSE


def pareto_front(
    count: int, relations: Mapping[tuple[int, int], tuple[Relation, Relation]]
) -> list[Standing]:
    """The place of every cell.

    A dominates B if A is better in one measure, and better or alike in the other.  A does not
    dominate B if B is better in a measure, or if the cells are alike in both.  Otherwise it is
    undecided.  A cell is on the front if it is decided that no cell dominates it.

    Args:
        count: number of cells.
        relations: relations of cell a to cell b in (ratio of times, κ), for each a < b.
    """
    standings = []
    for b in range(count):
        dominating: list[int] = []
        undecided: list[int] = []
        for a in range(count):
            if a == b:
                continue
            if a < b:
                pair: Sequence[Relation] = relations[a, b]
            else:
                pair = [relation.reversed() for relation in relations[b, a]]
            if Relation.WORSE in pair or set(pair) == {Relation.ALIKE}:
                continue
            (undecided if Relation.UNDECIDED in pair else dominating).append(a)
        place = Place.DOMINATED if dominating else Place.UNDECIDED if undecided else Place.FRONT
        standings.append(Standing(place, tuple(dominating), tuple(undecided)))
    return standings
