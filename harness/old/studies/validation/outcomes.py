"""Takes a trace of a passage and returns the driver's outcome: times, positions and contacts."""

from dataclasses import dataclass

import numpy as np

from harness.core.encounter import Contact, Ending, FloatArray, Trace
from harness.measures import measure
from harness.measures.ego import crossing_time, ego_state
from harness.old.studies.validation.passages import Passage

HORIZONS_S = (1.0, 2.0, 4.0)
"""Times in s after the start at which positions are compared."""

_STANDING_MPS = 0.1


@dataclass(frozen=True, eq=False)
class DriverOutcome:
    """The outcome of one driver, recorded or simulated, in one passage.

    Attributes:
        trace: the trace of the passage.
        pass_time_s: time from the start until the rear has left the crosswalk; the time limit if
            ``timed_out``.
        timed_out: whether the time limit ended the passage.
        x_m: (3,) position of the front bumper after ``HORIZONS_S``; NaN after the passage.
        first: (n,) whether the vehicle reached the conflict point before the pedestrian, for each
            pedestrian who had not passed it at the start.
        least_speed_mps: lowest speed of the passage.
        pet_s, time_advantage_s: the measures of docs/measures.md; None if undefined.
        contact: whether the vehicle touched a pedestrian.
        contact_explained: whether the contact happened only because recorded pedestrians cannot
            react.  Either they walked into the vehicle's flank or into a standing vehicle, or full
            braking since their arrival would not have avoided the contact.
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
    """Return the pass time in s, and whether the vehicle timed out; then it is the time limit."""
    passed = crossing_time(trace, passage.crossing.width_m / 2 + passage.vehicle.length_m)
    if passed is not None:
        return passed, False
    # An engine ends the passage within 1 nm of the edge, so the rear may not quite have left.
    return (len(trace.x_m) - 1) * trace.step_s, trace.ending is Ending.TIMED_OUT


def order_of(passage: Passage, trace: Trace) -> np.ndarray:
    """Return ``DriverOutcome.first``, bool of shape (n,)."""
    counts = passage.passing_s > 0
    places, passing_s = passage.conflict_x_m[counts], passage.passing_s[counts]
    times = [crossing_time(trace, place) for place in places.tolist()]
    first = [
        time is not None and time <= passing
        for time, passing in zip(times, passing_s.tolist(), strict=True)
    ]
    return np.array(first, dtype=bool)
