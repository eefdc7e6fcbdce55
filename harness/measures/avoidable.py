"""Episodes in; whether full braking or an attentive human would have prevented each crash, out.

Full braking obeys the limits of ``core.vocabulary.Vehicle``; docs/measures.md defines both.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator
from itertools import chain
from typing import NamedTuple

import numpy as np

from harness.core.actuation import GRAVITY_MPS2, CarState, response
from harness.core.vocabulary import PEDESTRIAN_RADIUS_M, FloatArray, Trace, Vehicle
from harness.measures.chunk import Chunk
from harness.measures.contacts import Strike
from harness.measures.ego import ego_state, motion_within
from harness.measures.motion.contact import Motion, first_contact_in_step_s

ATTENTIVE_DELAY_S = 0.4 + 0.75
"""Risk perception and reaction of the attentive driver (UN Regulation 157, annex 3)."""

ATTENTIVE_JERK_MPS3 = 12.65
"""Rate at which their deceleration grows (UN Regulation 157, annex 3)."""

ATTENTIVE_BRAKING_MPS2 = 0.774 * GRAVITY_MPS2
"""Their greatest deceleration (UN Regulation 157, annex 3)."""

_PIECE_S = 0.01
"""Longest piece of constant acceleration while the deceleration changes."""

_REACH_M = PEDESTRIAN_RADIUS_M + 0.01
"""Distance before the front bumper beyond which nobody is touched, with a margin for rounding."""


class _Piece(NamedTuple):
    """The motion of the ego from ``begin_s`` until the next piece begins."""

    begin_s: float
    motion: Motion


_Drive = Callable[[Trace, float], Iterator[_Piece]]
"""The pieces of a drive in the ego of a trace, which begins at a time (s)."""


def avoidable(chunk: Chunk) -> FloatArray:
    """1 if full braking from the moment of stepping off would have prevented the contact.

    The ego brakes at ``max_deceleration_mps2`` from its state at that moment until it stands, and
    stays there.  An ego that obeys late (``[actuation]``) is commanded to do so at that moment: it
    moves as in the run until the dead time ends, and then as its lag and its jerk let it, in pieces
    of constant acceleration of at most 10 ms.  The pedestrian walks as in the run, all the way
    across.  The value is 0 if they would still touch, even if the ego stands at that time.  It is
    NaN if there was no contact.
    """
    return _prevented(chunk, _full_braking)


def avoidable_attentive(chunk: Chunk) -> FloatArray:
    """1 if an attentive human driver in the ego's place would have avoided the contact.

    From its state at the moment of stepping off, the ego keeps its speed for 1.15 s.  Then its
    deceleration grows by 12.65 m/s³ up to 0.774 g, or up to ``max_deceleration_mps2`` if that is
    less, until it stands.  All else is as in ``avoidable``.  While the deceleration grows, the
    motion is cut into pieces of constant acceleration of at most 10 ms, so positions are off by at
    most 12.65 · 0.01³/12 m, which is 1 µm.

    Source: UN Regulation 157: the competent and careful human driver.
    """
    return _prevented(chunk, _attentive)


def _prevented(chunk: Chunk, drive: _Drive) -> FloatArray:
    """1 where a drive from the moment of stepping off on avoids the contact; NaN without one."""
    values = np.full(len(chunk.traces), np.nan)
    for number, strike in enumerate(chunk.strikes):
        if strike is not None:
            values[number] = not _still_hit(chunk, number, strike, drive)
    return values


def _braking(
    begin_s: float, x_m: float, speed_mps: float, deceleration_mps2: float
) -> Iterator[_Piece]:
    """Constant deceleration until the ego stands."""
    motion = Motion(x_m, speed_mps, -deceleration_mps2)
    stops_after_s = speed_mps / deceleration_mps2
    yield _Piece(begin_s, motion)
    yield _Piece(begin_s + stops_after_s, Motion(motion.at(stops_after_s), 0.0))


def _full_braking(trace: Trace, begin_s: float) -> Iterator[_Piece]:
    """Full braking, commanded at ``begin_s``."""
    vehicle = trace.vehicle
    braking = vehicle.max_deceleration_mps2
    if vehicle.obeys_at_once:
        return _braking(begin_s, *ego_state(trace, begin_s), braking)
    acts_s = min(begin_s + vehicle.dead_time_s, (len(trace.x_m) - 1) * trace.step_s)
    recorded = [_Piece(*piece) for piece in motion_within(trace, begin_s, acts_s)]
    gain = recorded[-1].motion.acceleration_mps2 if recorded else 0.0
    x, speed = ego_state(trace, acts_s)
    return chain(recorded, _obeying(acts_s, x, CarState(speed, gain), vehicle))


def _obeying(begin_s: float, x_m: float, state: CarState, vehicle: Vehicle) -> Iterator[_Piece]:
    """The response to full braking, until the ego stands."""
    braking, number = vehicle.max_deceleration_mps2, 0
    while state.speed_mps > 0:
        after = response(state, -braking, _PIECE_S, vehicle)
        gain = (after.speed_mps - state.speed_mps) / _PIECE_S
        motion = Motion(x_m, state.speed_mps, gain)
        yield _Piece(begin_s + number * _PIECE_S, motion)
        x_m, state, number = motion.at(_PIECE_S), after, number + 1
    yield _Piece(begin_s + number * _PIECE_S, Motion(x_m, 0.0))


def _attentive(trace: Trace, begin_s: float) -> Iterator[_Piece]:
    """The attentive driver: constant speed, growing deceleration, constant deceleration."""
    x_m, speed_mps = ego_state(trace, begin_s)
    deceleration_mps2 = min(ATTENTIVE_BRAKING_MPS2, trace.vehicle.max_deceleration_mps2)
    yield _Piece(begin_s, Motion(x_m, speed_mps))
    begin_s, x_m = begin_s + ATTENTIVE_DELAY_S, x_m + speed_mps * ATTENTIVE_DELAY_S
    jerk = ATTENTIVE_JERK_MPS3
    grows_s = min(deceleration_mps2 / jerk, math.sqrt(2 * speed_mps / jerk))
    pieces = math.ceil(grows_s / _PIECE_S)

    def state(elapsed_s: float) -> tuple[float, float]:
        x = x_m + speed_mps * elapsed_s - jerk * elapsed_s**3 / 6
        return x, max(0.0, speed_mps - jerk * elapsed_s**2 / 2)

    for number in range(pieces):
        elapsed_s = number * grows_s / pieces
        middle_s = elapsed_s + grows_s / pieces / 2
        yield _Piece(begin_s + elapsed_s, Motion(*state(elapsed_s), -jerk * middle_s))
    yield from _braking(begin_s + grows_s, *state(grows_s), deceleration_mps2)


def _still_hit(chunk: Chunk, number: int, strike: Strike, drive: _Drive) -> bool:
    """Whether another drive of the ego touches the pedestrian who was struck."""
    legs = chunk.legs
    legs_of_struck = np.flatnonzero(legs.walk == strike.walk)
    # If the pedestrian stepped off before the trace began, the drive begins with the trace.
    begin_s = max(0.0, float(legs.begin_s[legs_of_struck[0]]))
    pieces = [*drive(chunk.traces[number], begin_s)]
    ends_s = [piece.begin_s for piece in pieces[1:]] + [math.inf]
    reached_m = [piece.motion.place_m for piece in pieces[1:]] + [math.inf]
    for leg in legs_of_struck.tolist():
        leg_begin_s, leg_end_s = float(legs.begin_s[leg]), float(legs.end_s[leg])
        walker_x = Motion(float(legs.x_m[leg]), float(legs.x_mps[leg]))
        walker_y = Motion(float(legs.y_m[leg]), float(legs.y_mps[leg]), float(legs.y_mps2[leg]))
        # The ego moves forwards only, so a piece that ends short of the whole leg cannot touch.
        nearest_m = min(walker_x.place_m, walker_x.at(leg_end_s - leg_begin_s))
        first = bisect_left(reached_m, nearest_m - _REACH_M)
        for piece, end_s in zip(pieces[first:], ends_s[first:], strict=True):
            since_s, until_s = max(piece.begin_s, leg_begin_s), min(end_s, leg_end_s)
            if until_s < since_s:
                continue
            ego = piece.motion.after(since_s - piece.begin_s)
            walkers = (walker_x.after(since_s - leg_begin_s), walker_y.after(since_s - leg_begin_s))
            if first_contact_in_step_s(ego, *walkers, until_s - since_s, chunk.body) is not None:
                return True
    return False
