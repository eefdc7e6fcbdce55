"""Whether full braking would have prevented a crash."""

import numpy as np

from harness.core.encounter import FloatArray
from harness.measures.chunk import Chunk
from harness.measures.contacts import Strike
from harness.measures.ego import ego_state
from harness.measures.motion.contact import Motion, first_contact_in_step


def avoidable(chunk: Chunk) -> FloatArray:
    """1 if full braking from the moment of stepping off would have prevented the contact.

    The ego brakes at ``max_deceleration_mps2`` from its state at that moment until it stands, and
    stays there.  The pedestrian walks as in the run, all the way across.  The value is 0 if they
    would still touch, even if the ego stands at that time. It is NaN if there was no contact.
    """
    values = np.full(len(chunk.traces), np.nan)
    for number, strike in enumerate(chunk.strikes):
        if strike is not None:
            values[number] = not _still_hit(chunk, number, strike)
    return values


def _still_hit(chunk: Chunk, number: int, strike: Strike) -> bool:
    legs, braking = chunk.legs, chunk.vehicle.max_deceleration_mps2
    legs_of_struck = np.flatnonzero(legs.walk == strike.walk)
    # If the pedestrian stepped off before the trace began, the ego brakes from the trace's
    # beginning.
    begin = max(0.0, float(legs.begin_s[legs_of_struck[0]]))
    x, speed = ego_state(chunk.traces[number], begin)
    stands = begin + speed / braking
    for leg in legs_of_struck.tolist():
        leg_begin, leg_end = float(legs.begin_s[leg]), float(legs.end_s[leg])
        onset, middle = max(begin, leg_begin), min(max(stands, leg_begin), leg_end)
        for since, until, deceleration in ((onset, middle, braking), (middle, leg_end, 0.0)):
            if until < since:
                continue  # the leg ended before
            braked = min(since, stands) - begin
            ego = Motion(
                x + speed * braked - braking * braked**2 / 2,
                0.0 if deceleration == 0 else speed - braking * braked,
                -deceleration,
            )
            walked = since - leg_begin
            walker_x = Motion(
                float(legs.x_m[leg] + legs.x_mps[leg] * walked), float(legs.x_mps[leg])
            )
            gain = float(legs.y_mps2[leg])
            walker_y = Motion(
                float(legs.y_m[leg] + legs.y_mps[leg] * walked) + gain * walked**2 / 2,
                float(legs.y_mps[leg]) + gain * walked,
                gain,
            )
            touch = first_contact_in_step(ego, walker_x, walker_y, until - since, chunk.body)
            if touch is not None:
                return True
    return False
