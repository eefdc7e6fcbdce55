"""A driver's outcome in a passage, measured on its trace."""

from dataclasses import dataclass

import numpy as np

from harness.core.encounter import Contact, Ending, FloatArray, Trace
from harness.measures import measure
from harness.measures.ego import crossing_time, ego_state
from harness.studies.validation.passages import Passage

HORIZONS_S = (1.0, 2.0, 4.0)
"""When positions are compared."""

_STANDING_MPS = 0.1


@dataclass(frozen=True, eq=False)
class DriverOutcome:
    """One passage as one driver drove it, recorded or simulated.

    Attributes:
        trace: of the passage.
        pass_time_s: from the start until the rear has left the crosswalk; the time that was
            given where it had not (``timed_out``).
        x_m: (3,) the bumper after ``HORIZONS_S``; NaN once it has passed.
        first: (n,) whether it was at the pedestrian's conflict point before they passed it, for
            each pedestrian of the passage who had not passed at the start.
        least_speed_mps: of the whole passage.
        pet_s, time_advantage_s: as in docs/measures.md; None where undefined.
        contact: whether it touched anybody.
        contact_explained: whether only a pedestrian who cannot react explains it: they walked
            into its flank or into a standing vehicle, or full braking since they came would not
            have helped.
    """

    trace: Trace
    pass_time_s: float
    timed_out: bool
    x_m: FloatArray
    first: np.ndarray
    least_speed_mps: float
    pet_s: float | None
    time_advantage_s: float | None
    contact: bool
    contact_explained: bool


def outcome_of(passage: Passage, trace: Trace) -> DriverOutcome:
    """Measure one trace of a passage, recorded or simulated."""
    record = measure([trace])[0]
    pass_time_s, timed_out = pass_time_of(passage, trace)
    ended_s = (len(trace.x_m) - 1) * trace.step_s
    touched, struck_at = record.contact is not None, record.contact_speed_mps
    explained = touched and (
        record.contact is Contact.SIDE
        or (struck_at is not None and struck_at < _STANDING_MPS)
        or not record.avoidable
    )
    return DriverOutcome(
        trace=trace,
        pass_time_s=pass_time_s,
        timed_out=timed_out,
        x_m=np.array([ego_state(trace, at)[0] if at < ended_s else np.nan for at in HORIZONS_S]),
        first=order_of(passage, trace),
        least_speed_mps=float(trace.speed_mps.min()),
        pet_s=record.pet_s,
        time_advantage_s=record.min_time_advantage_s,
        contact=touched,
        contact_explained=explained,
    )


def pass_time_of(passage: Passage, trace: Trace) -> tuple[float, bool]:
    """(pass time in s, whether it is the time that was given because the vehicle did not pass)."""
    passed = crossing_time(trace, passage.crossing.width_m / 2 + passage.vehicle.length_m)
    if passed is not None:
        return passed, False
    # Reaching the edge is decided with a tolerance of 1 nm, which may leave it just short.
    return (len(trace.x_m) - 1) * trace.step_s, trace.ending is Ending.TIMED_OUT


def order_of(passage: Passage, trace: Trace) -> np.ndarray:
    """(n,) bool: whether it was first, for each pedestrian who had not passed at the start."""
    counts = passage.passing_s > 0
    places, passing_s = passage.conflict_x_m[counts], passage.passing_s[counts]
    times = [crossing_time(trace, place) for place in places.tolist()]
    first = [
        time is not None and time <= passing
        for time, passing in zip(times, passing_s.tolist(), strict=True)
    ]
    return np.array(first, dtype=bool)
