"""The Pareto front of (μ, κ), worked out by hand."""

import itertools

import pytest

from harness.statistics import (
    CrashTest,
    Interval,
    Place,
    Relation,
    pareto_front,
    relation_of_crashes,
    relation_of_times,
)

B, W, A, U = Relation.BETTER, Relation.WORSE, Relation.ALIKE, Relation.UNDECIDED


@pytest.mark.parametrize(
    ("limits", "counted_in_one", "adjusted_p", "expected"),
    [
        # Less time is better: a − b below 0 is in a's favour.
        ((-0.3, -0.1), 0, 0.04, B),
        ((0.1, 0.3), 0, 0.04, W),
        ((-0.1, -0.1), 0, 0.04, B),
        # Both the interval and the test adjusted within its family have to tell them apart.
        ((0.1, 0.3), 0, 0.05, U),
        ((-0.1, 0.3), 0, 0.04, U),
        ((0.0, 0.3), 0, 0.04, U),
        ((0.0, 0.0), 0, 1.0, A),
        # A pair that counts in one of them alone differs.
        ((0.0, 0.0), 1, 1.0, U),
        ((None, None), 0, 0.04, U),
    ],
)
def test_relation_of_times(limits, counted_in_one, adjusted_p, expected) -> None:
    difference = Interval(limits[0], *limits)
    assert relation_of_times(difference, counted_in_one, adjusted_p, 0.05) is expected


def test_relation_of_crashes() -> None:
    assert relation_of_crashes(CrashTest(100, 0, 8, 0.0078), 0.02, 0.05) is B
    assert relation_of_crashes(CrashTest(100, 8, 0, 0.0078), 0.02, 0.05) is W
    # What counts is the p adjusted within the family.
    assert relation_of_crashes(CrashTest(100, 8, 0, 0.0078), 0.06, 0.05) is U
    assert relation_of_crashes(CrashTest(100, 1, 0, 1.0), 1.0, 0.05) is U
    assert relation_of_crashes(CrashTest(100, 0, 0, 1.0), 1.0, 0.05) is A
    # A pair that ran in one of them alone differs.
    assert relation_of_crashes(CrashTest(99, 0, 0, 1.0, 1), 1.0, 0.05) is U
    # Nothing seen at all says nothing.
    assert relation_of_crashes(CrashTest(0, 0, 0, 1.0), 1.0, 0.05) is U


# Two cells: how 0 stands to 1 in (μ, κ), and both places.
TWO = [
    ((B, B), Place.FRONT, Place.DOMINATED),
    ((B, A), Place.FRONT, Place.DOMINATED),
    ((A, B), Place.FRONT, Place.DOMINATED),
    ((W, A), Place.DOMINATED, Place.FRONT),
    # Each better in one: a trade-off, both stay.
    ((B, W), Place.FRONT, Place.FRONT),
    ((A, A), Place.FRONT, Place.FRONT),
    # 0 is faster, but may crash more: 1 may be dominated or not; 0 surely is not.
    ((B, U), Place.FRONT, Place.UNDECIDED),
    ((U, W), Place.UNDECIDED, Place.FRONT),
    ((U, A), Place.UNDECIDED, Place.UNDECIDED),
    ((U, U), Place.UNDECIDED, Place.UNDECIDED),
]


@pytest.mark.parametrize(("relation", "first", "second"), TWO)
def test_two_cells(relation: tuple[Relation, Relation], first: Place, second: Place) -> None:
    standings = pareto_front(2, {(0, 1): relation})
    assert [standing.place for standing in standings] == [first, second]


def by_numbers(points: list[tuple[float, float]]) -> dict[tuple[int, int], tuple[Relation, ...]]:
    """Relations as they were if every difference could be told."""

    def relation(a: float, b: float) -> Relation:
        return A if a == b else B if a < b else W

    return {
        (i, j): tuple(relation(a, b) for a, b in zip(points[i], points[j], strict=True))
        for i, j in itertools.combinations(range(len(points)), 2)
    }


def test_front_of_known_points_and_of_what_cannot_be_told() -> None:
    # μ falls and κ rises from cautious to bold; the last two lie above the front.
    points = [(1.0, 0.0), (0.8, 0.01), (0.6, 0.05), (0.9, 0.02), (1.0, 0.06)]
    standings = pareto_front(5, by_numbers(points))
    assert [standing.place for standing in standings] == [Place.FRONT] * 3 + [Place.DOMINATED] * 2
    assert standings[3].dominated_by == (1,)
    assert standings[4].dominated_by == (0, 1, 2, 3)
    assert all(standing.open_against == () for standing in standings)
    assert [standing.place for standing in pareto_front(1, {})] == [Place.FRONT]
    # 2 is dominated by 0 whatever 1 is; 1 cannot be told from 0.
    relations = {(0, 1): (B, U), (0, 2): (B, B), (1, 2): (U, U)}
    standings = pareto_front(3, relations)
    assert [s.place for s in standings] == [Place.FRONT, Place.UNDECIDED, Place.DOMINATED]
    assert standings[1].open_against == (0, 2)
    assert (standings[2].dominated_by, standings[2].open_against) == ((0,), (1,))
