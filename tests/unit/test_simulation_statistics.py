"""Crosswalks compared over pairs."""

import pyarrow as pa
import pytest

from harness.old.store.schemas import TABLES
from harness.old.store.simulations.simulation_statistics import crosswalk_rows

STUDENT_3 = 4.302652729911275 / 3**0.5
"""Half-width of a 95 % interval of three values with the standard deviation 1 (Student's t)."""


def rows_of(column: str, key: str, quantity: str, av: list, human: list) -> pa.Table:
    """Rows of ``simulations`` by pair; a text instead of a number is the reason of a failure."""
    rows = []
    for pair, values in enumerate(zip(av, human, strict=True)):
        for arm, value in zip(("av", "human"), values, strict=True):
            failed = isinstance(value, str)
            struct = [] if failed else [{key: "A", quantity: value}]
            reason = value if failed else None
            rows.append({"cell": 0, "pair": pair, "arm": arm, "reason": reason, column: struct})
    return pa.Table.from_pylist(rows, schema=TABLES["simulations"])


@pytest.mark.parametrize(
    ("compared", "column", "key", "quantity"),
    [
        (crosswalk_rows, "crosswalks", "crosswalk", "pedestrian_wait_s"),
    ],
)
def test_differences_are_means_over_the_pairs_in_which_no_arm_failed(
    compared, column: str, key: str, quantity: str
) -> None:
    av, human = [11.0, 12.0, 13.0, 99.0, 5.0], [10.0, 10.0, 10.0, "lost", None]
    rows = compared(rows_of(column, key, quantity, av, human), 0.95)
    (row,) = [row for row in rows if row["number"] == quantity]
    assert row["pairs"] == 3  # one pair failed, in another one nobody waited
    assert row["difference"] == pytest.approx(2.0)
    assert row["difference_ci_low"] == pytest.approx(2.0 - STUDENT_3)
    assert row["difference_ci_high"] == pytest.approx(2.0 + STUDENT_3)
    assert (row["av"], row["human"]) == (12.0, 10.0)
    # Three equal values do not show their spread.
    assert row["human_ci_low"] is row["human_ci_high"] is None
