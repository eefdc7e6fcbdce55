"""The first contact of every episode."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, Contact, Ending, IntArray, Trace
from harness.measures.ego import body_of, ego_state
from harness.measures.motion.contact import Body, Motion, first_contact_in_step_s
from harness.measures.steps import Rows


@dataclass(frozen=True, slots=True)
class Strike:
    """A contact: its time, number of the walk in ``Legs``, place on the ego, and speed."""

    time_s: float
    walk: int
    contact: Contact
    speed_mps: float


def strikes_of(traces: Sequence[Trace], rows: Rows) -> list[Strike | None]:
    """The first contact of every trace, computed exactly where bounding boxes overlap."""
    strikes: list[Strike | None] = [None] * len(traces)
    body = body_of(traces[0])
    struck: set[int] = set()
    for row in _close_rows(rows, body):
        walk, trace = int(rows.walk[row]), int(rows.trace[row])
        if walk in struck or traces[trace].ending is Ending.FAILED:
            continue
        ego = Motion(
            float(rows.x_m[row]), float(rows.speed_mps[row]), float(rows.acceleration_mps2[row])
        )
        walker_x = Motion(float(rows.walker_x_m[row]), float(rows.walker_x_mps[row]))
        walker_y = Motion(
            float(rows.walker_y_m[row]),
            float(rows.walker_y_mps[row]),
            float(rows.walker_y_mps2[row]),
        )
        duration = float(rows.stop_s[row] - rows.start_s[row])
        within = first_contact_in_step_s(ego, walker_x, walker_y, duration, body)
        if within is None:
            continue
        struck.add(walk)
        time = float(rows.start_s[row]) + within
        earlier = strikes[trace]
        if earlier is None or time < earlier.time_s:
            x, _ = ego_state(traces[trace], time)
            strikes[trace] = Strike(
                time,
                walk,
                Contact.FRONT if x <= walker_x.at(within) else Contact.SIDE,
                max(0.0, ego.speed_mps + ego.acceleration_mps2 * within),
            )
    return strikes


def _close_rows(rows: Rows, body: Body) -> IntArray:
    """Rows in which the boxes around the paths of body and disc overlap."""
    length, right, left = body
    radius = PEDESTRIAN_RADIUS_M
    duration = rows.stop_s - rows.start_s
    x, y = rows.walker_x_m, rows.walker_y_m
    x_stop = x + rows.walker_x_mps * duration
    y_stop = y + rows.walker_y_mps * duration + rows.walker_y_mps2 * duration**2 / 2
    return np.flatnonzero(
        (rows.x_stop_m >= np.minimum(x, x_stop) - radius)
        & (rows.x_m <= np.maximum(x, x_stop) + length + radius)
        & (np.maximum(y, y_stop) >= right - radius)
        & (np.minimum(y, y_stop) <= left + radius)
        & (duration >= 0)
    )
