"""Decelerations: how hard the ego braked, and how hard it had to brake.

The required deceleration refers to states on a collision course with the front: if both kept their
velocities, they would touch while the pedestrian is ahead of the bumper.  Braking would not avoid a
contact in which the pedestrian walks into the side of the ego.
"""

import numpy as np

from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, ROUNDING, BoolArray, FloatArray, IntArray
from harness.measures.chunk import Chunk


def max_deceleration_mps2(chunk: Chunk) -> FloatArray:
    """Largest −Δv/Δt over the steps in m/s²; 0 if it never braked, NaN without a step."""
    ego = chunk.ego
    trace, state = chunk.record_steps
    largest = chunk.largest(trace, ego.speed_mps[state] - ego.speed_mps[state + 1])
    return np.maximum(largest, 0.0) / chunk.step_s


def max_jerk_mps3(chunk: Chunk) -> FloatArray:
    """Largest abs(Δa)/Δt from one step of the record to the next, in m/s³; NaN without a step.

    Before the trigger the ego drove at constant speed.  Acceleration changes within one step, so
    the value depends on the length of the step.
    """
    trace, _, jerk = _comfort(chunk)
    return chunk.largest(trace, np.abs(jerk))


def rms_acceleration_mps2(chunk: Chunk) -> FloatArray:
    """Root mean square of Δv/Δt over the steps of the record in m/s²; NaN without a step."""
    trace, acceleration, _ = _comfort(chunk)
    return _root_mean_square(chunk, trace, acceleration)


def rms_jerk_mps3(chunk: Chunk) -> FloatArray:
    """Root mean square of the jerk of ``max_jerk_mps3`` over the steps; NaN without a step."""
    trace, _, jerk = _comfort(chunk)
    return _root_mean_square(chunk, trace, jerk)


def max_drac_mps2(chunk: Chunk) -> FloatArray:
    """Largest deceleration rate to avoid a crash over the states, in m/s²; NaN after a contact.

    The pedestrian's disc is d ahead of the bumper and leaves the ego's path after time T.  DRAC is
    the smallest constant deceleration with which the bumper does not reach the disc before that
    time.  It is 2 (v − d/T)/T if the ego still moves then (v T ≤ 2d); otherwise the ego must stop,
    and it is v²/2d.  It grows without bound before a contact.  Source: Cooper and Ferguson 1976,
    Archer 2005; for crossing paths as in SUMO's SSM device.
    """
    met = chunk.met
    at_risk = _on_course_with_front(chunk)
    ahead = met.ahead_m[at_risk] - PEDESTRIAN_RADIUS_M
    speed, walking = met.closing_mps[at_risk], met.walker_y_mps[at_risk]
    _, right, left = chunk.body
    y = met.walker_y_m[at_risk]
    to_leave = np.where(walking > 0, left - y, y - right) + PEDESTRIAN_RADIUS_M
    with np.errstate(divide="ignore", invalid="ignore"):
        leaves_s = np.where(walking == 0, np.inf, to_leave / np.abs(walking))
        rolling = 2 * (speed - ahead / leaves_s) / leaves_s
        stopping = speed**2 / (2 * ahead)
        drac = np.where(speed * leaves_s <= 2 * ahead, rolling, stopping)
    return np.where(chunk.crashed, np.nan, chunk.largest(met.trace[at_risk], drac))


def required_deceleration_mps2(chunk: Chunk) -> FloatArray:
    """Constant deceleration to stop before the pedestrian from first sight, v²/2d, in m/s².

    First sight is the first state in which the pedestrian has stepped off and the ego is within its
    detection range.  Only pedestrians on a collision course with the front at that state count; the
    value is the largest over them.
    """
    met = chunk.met
    in_sight = np.abs(met.x_m) <= chunk.vehicle.detection_range_m + ROUNDING
    walk = met.walk[in_sight]
    first = np.flatnonzero(in_sight)[np.concatenate(([True], walk[1:] != walk[:-1]))[: len(walk)]]
    first = first[_on_course_with_front(chunk)[first]]
    ahead = met.ahead_m[first] - PEDESTRIAN_RADIUS_M
    return chunk.largest(met.trace[first], met.closing_mps[first] ** 2 / (2 * ahead))


def _on_course_with_front(chunk: Chunk) -> BoolArray:
    """For every row of ``met``: whether it is on a collision course with the front."""
    met, ttc = chunk.met, chunk.ttc_s
    with np.errstate(invalid="ignore"):
        ahead_then = met.ahead_m - met.closing_mps * ttc
    room = met.ahead_m > PEDESTRIAN_RADIUS_M
    return np.isfinite(ttc) & room & (ahead_then >= -ROUNDING)


def _comfort(chunk: Chunk) -> tuple[IntArray, FloatArray, FloatArray]:
    """For every step of the records: its episode, Δv/Δt, and its change from the step before."""
    ego, step_s = chunk.ego, chunk.step_s
    trace, state = chunk.record_steps
    acceleration = (ego.speed_mps[state + 1] - ego.speed_mps[state]) / step_s
    before = np.concatenate(([0.0], acceleration[:-1]))[: len(acceleration)]
    before[state == ego.first[trace]] = 0.0
    return trace, acceleration, (acceleration - before) / step_s


def _root_mean_square(chunk: Chunk, trace: IntArray, values: FloatArray) -> FloatArray:
    # The sum of an episode is in the order of its steps, so it does not depend on the chunk.
    sums = np.bincount(trace, weights=values**2, minlength=len(chunk.traces))
    with np.errstate(invalid="ignore"):
        return np.sqrt(sums / chunk.steps)
