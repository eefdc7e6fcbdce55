"""Takes a recorded passage and returns the trace of a driver model or of the recorded vehicle."""

from dataclasses import replace

import numpy as np

from harness.core.encounter import Arrival, Ending, Strategy, Trace, Walk
from harness.encounter.cell_constants import CellConstants
from harness.encounter.loop import run_episode
from harness.engine.plain import PlainEngine
from harness.old.studies.validation.passages import BEYOND_S, Passage
from harness.strategies.constant_speed import ConstantSpeed


def drive(passage: Passage, strategy: Strategy) -> Trace:
    """Let a strategy drive a passage from its recorded start until its rear has left.

    The pedestrians walk as recorded and do not react.  The time limit is 30 s after the recorded
    vehicle has passed.

    Args:
        passage: the recorded passage.
        strategy: a new strategy object.
    """
    steps = len(passage.x_m) - 1 + round(BEYOND_S / passage.step_s)
    # An engine begins at v0.  Here the start speed differs from v0, except for the driver at
    # constant speed, whose v0 is the start speed.
    begun = replace(passage.vehicle, initial_speed_mps=passage.start_speed_mps)
    rules = CellConstants(
        vehicle=begun if isinstance(strategy, ConstantSpeed) else passage.vehicle,
        crossing=passage.crossing,
        kerb_wait_s=0.0,
        step_s=passage.step_s,
        timeout_s=steps * passage.step_s,
        behaviour="constant",
    )
    engine = PlainEngine(begun, passage.step_s)
    trace = run_episode(engine, strategy, passage.arrivals, _as_recorded, rules)
    return replace(trace, vehicle=passage.vehicle)


def recorded_trace(passage: Passage) -> Trace:
    """Return the recorded passage as a trace whose speeds are central differences."""
    x_m = passage.x_m
    walks = tuple(
        Walk(arrival, arrival.arrival_s, abs(arrival.path[-1].y_mps), legs=arrival.path)
        for arrival in passage.arrivals
        if arrival.path is not None
    )
    return Trace(
        vehicle=passage.vehicle,
        crossing=passage.crossing,
        step_s=passage.step_s,
        x_m=x_m,
        speed_mps=np.gradient(x_m, passage.step_s),
        walks=walks,
        ending=Ending.CROSSED,
        reason=None,
        sumo_collision=None,
        fallback=False,
    )


def _as_recorded(arrival: Arrival, *_seen: float | None) -> float:
    raise AssertionError(f"recorded pedestrian {arrival.index} chooses no speed")
