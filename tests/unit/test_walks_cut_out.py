"""Walks over a crosswalk, cut out of records that were written by hand."""

from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from harness.encounter.simulation.cutting import people_over

CROSSWALK: Any = SimpleNamespace(id=":J_c0")


def test_a_walk_has_all_records_before_the_crossing_and_one_after() -> None:
    """Two walks over one crosswalk, there and back, recorded every second."""
    edges = [":J_w0", ":J_w0", ":J_c0", ":J_c0", ":J_w1", ":J_w1", ":J_c0", ":J_w0"]
    records = pd.DataFrame(
        {
            "id": "p",
            "time_s": [float(second) for second in range(len(edges))],
            "x": 0.0,
            "y": [-2.0, -1.0, 1.0, 3.0, 5.0, 5.0, 2.0, -1.0],
            "edge": edges,
        }
    )
    there, back = people_over(records, [CROSSWALK], 1.0)[":J_c0"]
    assert there.time_s.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert there.y_m.tolist() == [-2.0, -1.0, 1.0, 3.0, 5.0]
    assert there.on_crossing.tolist() == [False, False, True, True, False]
    assert back.time_s.tolist() == [4.0, 5.0, 6.0, 7.0]
    assert back.on_crossing.tolist() == [False, False, True, False]


@pytest.mark.parametrize("pause_s", [1.0, 10.0])
def test_records_before_a_pause_belong_to_no_walk(pause_s: float) -> None:
    """Someone whom the records lose for 10 s, as on a ride, begins anew."""
    times = [0.0, pause_s, pause_s + 1.0]
    records = pd.DataFrame(
        {
            "id": "p",
            "time_s": times,
            "x": 0.0,
            "y": [-2.0, -1.0, 1.0],
            "edge": [":J_w0", ":J_w0", ":J_c0"],
        }
    )
    (walk,) = people_over(records, [CROSSWALK], 1.0)[":J_c0"]
    assert walk.time_s.tolist() == (times if pause_s == 1.0 else times[1:])
