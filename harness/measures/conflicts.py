"""Measures of conflicts: gap, TTC, time advantage, PET, speed at the contact.

Gap, TTC and time advantage are extremes over the states of the record: the beginning of each step,
and the moment at which a pedestrian steps off.
"""

import numpy as np

from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, STANDING_MPS, FloatArray, Side, advantage_s
from harness.measures.chunk import Chunk
from harness.measures.ego import crossing_time_s
from harness.measures.motion.contact import gap_m
from harness.measures.steps import time_at_s, x_range


def contact_speed_mps(chunk: Chunk) -> FloatArray:
    """The ego's speed at the contact in m/s; NaN if there was no contact."""
    return np.array(
        [np.nan if strike is None else strike.speed_mps for strike in chunk.strikes], dtype=float
    )


def min_gap_m(chunk: Chunk) -> FloatArray:
    """Smallest distance of the ego's rectangle and the disc's edge in m; 0 after a contact."""
    met = chunk.met
    distance = gap_m(met.ahead_m, met.walker_y_m, chunk.body)
    return np.where(chunk.crashed, 0.0, chunk.smallest(met.trace, distance))


def min_ttc_s(chunk: Chunk) -> FloatArray:
    """Smallest time to collision in s (Hayward 1972), of rectangle and disc; 0 at a contact."""
    return np.where(chunk.crashed, 0.0, chunk.smallest(chunk.met.trace, chunk.ttc_s))


def time_advantage_s(
    range_m: FloatArray, speed_mps: FloatArray, lateral_m: FloatArray, walking_mps: FloatArray
) -> FloatArray:
    """abs(R/v − L/v_p) in s while both approach the point where their paths cross; else infinite.

    Nobody approaches it who stands: below 0.1 m/s, as SUMO has it.  Vehicles and people that have
    stopped keep speeds of rounding errors.
    """
    both = (range_m > 0) & (lateral_m > 0)
    both &= (speed_mps >= STANDING_MPS) & (walking_mps >= STANDING_MPS)
    advantage = np.full(len(both), np.inf)
    approaching = (each[both] for each in (range_m, speed_mps, lateral_m, walking_mps))
    advantage[both] = advantage_s(*approaching)
    return advantage


def min_time_advantage_s(chunk: Chunk) -> FloatArray:
    """Smallest ``time_advantage_s`` of the record."""
    met = chunk.met
    lateral_m = (chunk.crossing.lane_centre_m - met.walker_y_m) * np.sign(met.walker_y_mps)
    walking_mps = np.abs(met.walker_y_mps)
    advantage = time_advantage_s(met.ahead_m, met.speed_mps, lateral_m, walking_mps)
    return chunk.smallest(met.trace, advantage)


def pet_s(chunk: Chunk) -> FloatArray:
    """Smallest PET over the pedestrians of the record in s; NaN after a crash.

    The conflict area is the part of the road that both the ego's width and the pedestrian's disc
    cover.  It moves along the road with the pedestrian.  A pedestrian who is in it when their walk
    begins, as after a warm-up, enters it then.  PET is 0 if both were in the area at once without
    touching (at a corner).  It is undefined if either of them never enters it.  Pedestrians keep
    their speed after the trace's end.  Source: Allen, Shin, Cooper 1978.
    """
    legs, crossing, vehicle = chunk.legs, chunk.crossing, chunk.vehicle
    half = vehicle.width_m / 2 + PEDESTRIAN_RADIUS_M
    near, far = (crossing.to_lane_m(side) for side in (Side.NEAR, Side.FAR))
    to_lane = np.where(legs.from_far, far, near)
    length = crossing.length_m
    enters = time_at_s(legs, np.maximum(0.0, to_lane - half), length)
    leaves = time_at_s(legs, np.minimum(length, to_lane + half), length)
    began = np.array([walk.start_s for walk in legs.walks], dtype=float)
    # A pedestrian who leaves the area without entering it was in it from the start.
    enters = np.where(np.isnan(enters) & ~np.isnan(leaves), began, enters)
    trace = legs.walk_trace
    nearest, farthest = x_range(legs, enters, leaves)
    ego_enters = _bumper_at(chunk, nearest - PEDESTRIAN_RADIUS_M)
    ego_leaves = _bumper_at(chunk, farthest + vehicle.length_m + PEDESTRIAN_RADIUS_M)
    # NaN propagates: a pedestrian who never reaches the area has no PET.
    pet = np.where(leaves <= ego_enters, ego_enters - leaves, np.maximum(0.0, enters - ego_leaves))
    counts = ~np.isnan(pet) & (began < chunk.end_s[trace]) & ~chunk.crashed[trace]
    return chunk.smallest(trace[counts], pet[counts])


def _bumper_at(chunk: Chunk, x_m: FloatArray) -> FloatArray:
    """The time at which the bumper reaches each pedestrian's ``x_m``; NaN if it never does."""
    known: dict[tuple[int, float], float] = {}  # most pedestrians walk along the same line
    times = []
    for key in zip(chunk.legs.walk_trace.tolist(), x_m.tolist(), strict=True):
        if key not in known:
            time = crossing_time_s(chunk.traces[key[0]], key[1])
            known[key] = np.nan if time is None else time
        times.append(known[key])
    return np.array(times)
