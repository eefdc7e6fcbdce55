"""The passages of a user's own simulation as rows, step by step.

The columns are described in docs/files.md.  Times are times of the simulation.  x and y are in the
frame of the vehicle's way over the crosswalk.
"""

from collections.abc import Collection, Iterable, Iterator

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.encounter import Crossing, FloatArray, Vehicle
from harness.encounter.simulation.pairing import MeasuredPassage, SimulationOutcome
from harness.measures.motion.walking import cleared_s, states_at
from harness.old.store.schemas import SIMULATION_TRACES
from harness.old.store.simulations.simulation_tables import counted_passages
from harness.old.store.tables import Motion, Row, Tables, table_of, traces_table
from harness.old.store.walk_rows import pedestrian_row, shown_states

_ROUNDING = 1e-9


def simulation_trace_rows(cell: int, outcomes: Iterable[SimulationOutcome]) -> Tables:
    """The tables ``traces`` and ``scenes_over`` of every passage in ``passages_over``.

    A passage's number is the number of its row in ``passages_over`` within its arm.
    """
    numbered = [
        ({"cell": cell, "pair": outcome.pair, "arm": outcome.arm.value}, number, passage)
        for outcome in outcomes
        if outcome.reason is None
        for number, passage in enumerate(counted_passages(outcome))
    ]
    motions = (
        (keys, name, motion)
        for keys, number, passage in numbered
        for name, motion in _motions(number, passage)
    )
    scenes = [keys | _scene(number, passage) for keys, number, passage in numbered]
    return {"traces": traces_table(motions), "scenes_over": table_of("scenes_over", scenes)}


def only_passages(tables: Tables, kept: Collection[tuple[str, int]]) -> Tables:
    """The tables of a pair, with the traces of only some passages.

    Args:
        tables: the tables of one pair.
        kept: arm and number of each passage that is kept.
    """
    scenes, traces = (tables[name] for name in ("scenes_over", "traces"))
    arms, numbers = (scenes[name].to_pylist() for name in ("arm", "passage"))
    chosen = [key in kept for key in zip(arms, numbers, strict=True)]
    number = pc.struct_field(pc.extract_regex(traces["object"], r"^passage-(?P<n>\d+)"), "n")
    whose = zip(traces["arm"].to_pylist(), number.to_pylist(), strict=True)
    there = [(arm, int(text)) in kept for arm, text in whose]
    return tables | {
        "scenes_over": scenes.filter(pa.array(chosen, pa.bool_())),
        "traces": traces.filter(pa.array(there, pa.bool_())),
    }


def has_passages(tables: Tables, kept: Collection[tuple[str, int]]) -> bool:
    """Whether the tables of a pair have the traces of these passages."""
    if not {*SIMULATION_TRACES} <= tables.keys():
        return False
    arms, numbers = (tables["scenes_over"][name].to_pylist() for name in ("arm", "passage"))
    return {*kept} <= {*zip(arms, numbers, strict=True)}


def scene_parts(row: Row) -> tuple[Crossing, Vehicle]:
    """The crosswalk and the vehicle of a row of ``scenes_over``; its acceleration limits are 0."""
    crossing = Crossing(
        length_m=row["crossing_length_m"],
        width_m=row["crossing_width_m"],
        lane_centre_m=row["lane_centre_m"],
        lane_width_m=row["lane_width_m"],
    )
    vehicle = Vehicle(
        initial_speed_mps=row["free_speed_mps"],
        trigger_range_m=row["range_m"],
        detection_range_m=row["range_m"],
        length_m=row["vehicle_length_m"],
        width_m=row["vehicle_width_m"],
        max_acceleration_mps2=0.0,
        max_deceleration_mps2=0.0,
        resume_acceleration_mps2=0.0,
    )
    return crossing, vehicle


def _scene(number: int, passage: MeasuredPassage) -> Row:
    log, trace = passage.log, passage.trace
    crossing, vehicle = trace.crossing, trace.vehicle
    end_s = (len(trace.x_m) - 1) * trace.step_s
    return {
        "passage": number,
        "crosswalk": log.driven_way.way.crosswalk,
        "vehicle": log.name,
        "approach": log.driven_way.way.approach,
        "begin_s": log.time_s[0],
        "step_s": trace.step_s,
        "motion": trace.motion,
        "free_speed_mps": vehicle.initial_speed_mps,
        "range_m": vehicle.trigger_range_m,
        "vehicle_length_m": vehicle.length_m,
        "vehicle_width_m": vehicle.width_m,
        "crossing_length_m": crossing.length_m,
        "crossing_width_m": crossing.width_m,
        "lane_centre_m": crossing.lane_centre_m,
        "lane_width_m": crossing.lane_width_m,
        "walks": [pedestrian_row(walk, cleared_s(walk, crossing), end_s) for walk in trace.walks],
    }


def _motions(number: int, passage: MeasuredPassage) -> Iterator[tuple[str, Motion]]:
    """Name and motion of a passage's vehicle, and of each pedestrian at the steps of their walk."""
    trace, name = passage.trace, f"passage-{number}"
    times: FloatArray = (np.arange(len(trace.x_m)) * trace.step_s).astype(np.float64)
    begin_s = passage.log.time_s[0]
    gains = [*(np.diff(trace.speed_mps) / trace.step_s).tolist(), None]
    y_m = [trace.crossing.lane_centre_m] * len(times)
    yield name, (begin_s + times, trace.x_m, y_m, trace.speed_mps, gains)
    for walk in trace.walks:
        if walk.start_s is None:
            continue
        end_s = cleared_s(walk, trace.crossing)
        last_s = np.inf if end_s is None else end_s
        there = times[(times >= walk.start_s - _ROUNDING) & (times <= last_s)]
        x_m, ys_m, speed, gain = states_at(walk, trace.crossing, there)
        yield f"{name}-pedestrian-{walk.arrival.index}", (begin_s + there, x_m, ys_m, speed, gain)
    for index, states in shown_states(trace, times).items():
        seen_s, *columns = zip(*states, strict=True)
        yield f"{name}-shown-{index}", ([begin_s + each for each in seen_s], *columns)
