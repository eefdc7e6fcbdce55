"""The rows of the tables of hours of traffic.  The columns are described in docs/files.md."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from harness.core.encounter import Arm, Ending, Walk
from harness.encounter.traffic.lanes import lanes_of
from harness.encounter.traffic.pairing import HourOutcome
from harness.encounter.traffic.passages import Passage
from harness.encounter.traffic.saturation import least_late
from harness.measures import EpisodeRecord
from harness.measures.motion.walking import cleared_s
from harness.old.statistics import CONFLICTS
from harness.old.store.schemas import HOUR_TABLES, PASSAGES
from harness.old.store.tables import Row, Tables, table_of
from harness.old.store.walk_rows import pedestrian_row
from harness.scenario import ConflictsSection

MINUTE_S = 60.0

_RECORD = PASSAGES.names[PASSAGES.get_field_index("ending") :]


@dataclass(frozen=True, slots=True)
class _Counted:
    """The part of an hour that counts: vehicles and people due between warm-up and end."""

    begin_s: float
    end_s: float
    passages: Sequence[Passage]
    walks: Sequence[Walk]


def hour_rows(cell: int, outcomes: Iterable[HourOutcome]) -> Tables:
    """The tables ``hours``, ``passages``, ``pedestrians`` and ``queues``.

    Times count from the end of the warm-up.  Vehicles and people who were due before it, or after
    the hour, have no row.  A failed arm has a row only in ``hours``.
    """
    rows: dict[str, list[Row]] = {name: [] for name in HOUR_TABLES}
    for outcome in outcomes:
        keys = {"cell": cell, "pair": outcome.pair, "arm": outcome.arm.value}
        if outcome.reason is not None:
            rows["hours"].append(keys | {"reason": outcome.reason})
            continue
        counted = _counted(outcome)
        types = [kind.name for kind in outcome.scenario.known_traffic.types]
        passages = [_passage_row(passage, counted.begin_s, types) for passage in counted.passages]
        limits = outcome.scenario.conflicts
        numbers = _numbers(outcome, counted) | passage_counts(passages, limits)
        rows["hours"].append(keys | numbers)
        for row in passages:
            rows["passages"].append(keys | row)
        for walk in counted.walks:
            rows["pedestrians"].append(keys | walk_row(outcome, walk, counted.begin_s))
        for row in _queue_rows(outcome):
            rows["queues"].append(keys | row)
    return {name: table_of(name, content) for name, content in rows.items()}


def _counted(outcome: HourOutcome) -> _Counted:
    traffic = outcome.scenario.known_traffic
    begin_s, end_s = traffic.warm_up_s, traffic.warm_up_s + traffic.duration_s

    def counts(passage: Passage) -> bool:
        time_s = passage.passed_s if traffic.saturated else passage.scheduled_s
        return time_s is not None and begin_s - 1e-9 <= time_s < end_s - 1e-9

    passages = [passage for passage in outcome.passages if counts(passage)]
    walks = [walk for walk in outcome.log.walks if begin_s <= walk.arrival.arrival_s < end_s]
    return _Counted(begin_s, end_s, passages, walks)


def _numbers(outcome: HourOutcome, counted: _Counted) -> Row:
    """The row of an arm in ``hours``: sums, means and numbers over its counted time."""
    walks, last_s = counted.walks, outcome.log.last_step * outcome.scenario.experiment.step_s
    waits = [(last_s if w.start_s is None else w.start_s) - w.arrival.arrival_s for w in walks]
    let_go = [outcome.log.let_go[i] for w in walks if (i := w.arrival.index) in outcome.log.let_go]
    numbers = _vehicle_numbers(outcome, counted) | {
        "pedestrians": len(walks),
        "never_went": sum(walk.start_s is None for walk in walks),
        "pedestrian_delay_s": _mean(waits),
        "walking_mps": _mean([walk.speed_mps for walk in walks if walk.speed_mps is not None]),
        "had_to_wait": len(let_go),
        "let_go": sum(let_go),
    }
    traffic, delays = outcome.scenario.known_traffic, list[float]()
    if not traffic.saturated:
        # A vehicle that has not passed by the end is delayed at least until then.
        v0 = outcome.scenario.ego.initial_speed_mps
        delays = [_at_least(passage, last_s, v0) for passage in counted.passages]
        numbers |= _delays(outcome, counted, delays) | _late(outcome, counted)
        numbers["person_delay_h"] = (traffic.occupancy * sum(delays) + sum(waits)) / 3600.0
    return numbers


def _vehicle_numbers(outcome: HourOutcome, counted: _Counted) -> Row:
    """Numbers of vehicles, of their passages and of their queues."""
    passages, queues = counted.passages, np.array(outcome.log.queues, dtype=float)
    queues_m = np.array(outcome.log.queues_m, dtype=float)
    automated = [passage for passage in passages if _automated(outcome, passage)]
    driven = automated if outcome.arm is Arm.AV else passages
    met = [passage.record for passage in driven if passage.record.pedestrians]
    through = [p.passed_s for p in outcome.passages if p.passed_s is not None]
    in_time = sum(counted.begin_s <= passed_s < counted.end_s for passed_s in through)
    return {
        "vehicles": len(passages),
        "automated": len(automated) if outcome.arm is Arm.AV else 0,
        "met": len(met),
        "fallbacks": sum(record.fallback for record in met),
        "not_through": sum(passage.passed_s is None for passage in passages),
        "throughput_per_hour": in_time / (counted.end_s - counted.begin_s) * 3600.0,
        "queue_mean": float(queues.mean()) if queues.size else None,
        "queue_p95": float(np.quantile(queues, 0.95)) if queues.size else None,
        "queue_p95_m": float(np.quantile(queues_m, 0.95)) if queues_m.size else None,
        "queue_longest": int(queues.max()) if queues.size else None,
    }


def _delays(
    outcome: HourOutcome, counted: _Counted, delays: Sequence[float]
) -> dict[str, float | None]:
    """Mean delays of all vehicles, of vehicles that are AVs in the AV's arm, and of each third."""
    passages, third_s = counted.passages, (counted.end_s - counted.begin_s) / 3
    automated = [_automated(outcome, passage) for passage in passages]
    # Without a permanent queue every vehicle that counts has a schedule.
    due_s = [(passage.scheduled_s or 0.0) - counted.begin_s for passage in passages]
    ways_s = [(p.due_s or 0.0) - (p.scheduled_s or 0.0) for p in passages]
    control = [p.control_delay_s for p in passages if p.control_delay_s is not None]
    return {
        "vehicle_delay_s": _mean(delays),
        "automated_delay_s": _mean([*compress(delays, automated)]),
        "other_delay_s": _mean([*compress(delays, (not marked for marked in automated))]),
        "first_third_delay_s": _mean([*compress(delays, (time_s < third_s for time_s in due_s))]),
        "last_third_delay_s": _mean(
            [*compress(delays, (time_s >= 2 * third_s for time_s in due_s))]
        ),
        "control_delay_s": _mean(control),
        "travel_time_s": sum(delays) + sum(ways_s),
    }


def _late(outcome: HourOutcome, counted: _Counted) -> dict[str, int]:
    """The least number of late vehicles in each half, including vehicles from the warm-up.

    A vehicle is late from the time at which it is due to pass until it passes.
    """
    begin_s, end_s = counted.begin_s, counted.end_s
    both = ((p.due_s or 0.0, p.passed_s) for p in outcome.passages)
    times = [(due_s, math.inf if passed_s is None else passed_s) for due_s, passed_s in both]
    due = np.array([due_s for due_s, _ in times])
    late = np.array([(d, left) for d, left in times if left > d]).reshape(-1, 2)
    half_s = (begin_s + end_s) / 2
    return {
        "late_first_half": least_late(late[:, 0], late[:, 1], begin_s, half_s),
        "late_second_half": least_late(late[:, 0], late[:, 1], half_s, end_s),
        "due_through": int(((due > begin_s) & (due <= end_s)).sum()),
    }


def _at_least(passage: Passage, last_s: float, speed_mps: float) -> float:
    if passage.delay_s is not None:
        return passage.delay_s
    assert passage.scheduled_s is not None
    at_x_m = passage.vehicle.x_m if passage.inserted_s is not None else passage.vehicle.insert_x_m
    driven_s = (at_x_m - passage.vehicle.insert_x_m) / speed_mps
    return max(0.0, last_s - passage.scheduled_s - driven_s)


def _automated(outcome: HourOutcome, passage: Passage) -> bool:
    """Whether ``arms.av`` drives this vehicle in the AV's arm; both arms have the same vehicles."""
    return passage.vehicle.plan.uniform < outcome.scenario.known_traffic.av_share


def passage_counts(passages: Sequence[Row], limits: ConflictsSection) -> dict[str, float | None]:
    """Columns of ``hours`` from its rows of ``passages``: stops, crashes, conflicts.

    ``reached`` counts the vehicles that reached the crosswalk's near edge or crashed before it.
    Only their crashes and conflicts count; ``conflicts_unreached`` has the other vehicles'
    conflicts.  A crash counts as a conflict of every kind.
    """
    crashed = [row["ending"] == Ending.CRASHED for row in passages]
    reached = [
        row["edge_s"] is not None or crash for row, crash in zip(passages, crashed, strict=True)
    ]
    stops = [float(row["approach_stops"] + row["stops"]) for row in passages]
    counts = {
        "stops_per_vehicle": _mean(stops),
        "reached": sum(reached),
        "crashes": sum(crashed),
    }
    others = set[int]()
    for conflict in CONFLICTS:
        threshold: float = getattr(limits, conflict.threshold)
        values = [row[conflict.column] for row in passages]
        marked = {
            number
            for number, value in enumerate(values)
            if crashed[number]
            or (value is not None and (value > threshold if conflict.above else value < threshold))
        }
        counts[f"conflicts_{conflict.name}"] = sum(reached[number] for number in marked)
        others |= {number for number in marked if not reached[number]}
    return counts | {"conflicts_unreached": len(others)}


def _passage_row(passage: Passage, begin_s: float, types: Sequence[str]) -> Row:
    vehicle, record = passage.vehicle, passage.record
    row = record_row(record)
    first = vehicle.first_step
    return row | {
        "vehicle": vehicle.plan.number,
        "direction": vehicle.plan.lane.direction.value,
        "lane": vehicle.plan.lane.index,
        "type": types[vehicle.plan.kind] if types else None,
        "strategy": vehicle.strategy_name,
        "scheduled_s": _since(passage.scheduled_s, begin_s),
        "inserted_s": _since(passage.inserted_s, begin_s),
        "trigger_s": None if first is None else first * passage.trace.step_s - begin_s,
        "edge_s": _since(passage.edge_s, begin_s),
        "passed_s": _since(passage.passed_s, begin_s),
        "delay_s": passage.delay_s,
        "control_delay_s": passage.control_delay_s,
        "trace_offset_s": vehicle.trace_offset_s,
        "approach_stops": vehicle.stops,
    }


def record_row(record: EpisodeRecord) -> Row:
    """The columns of ``passages`` that come from the record."""
    return {name: getattr(record, name) for name in _RECORD}


def walk_row(outcome: HourOutcome, walk: Walk, begin_s: float) -> Row:
    """A pedestrian's row without the keys; the hour's counted time begins at ``begin_s``."""
    arrival = walk.arrival._replace(arrival_s=walk.arrival.arrival_s - begin_s)
    start_s = _since(walk.start_s, begin_s)
    legs = walk.legs and tuple(leg._replace(time_s=leg.time_s - begin_s) for leg in walk.legs)
    moved = Walk(arrival, start_s, walk.speed_mps, walk.range_m, walk.vehicle_speed_mps, legs)
    row = pedestrian_row(moved, cleared_s(moved, outcome.scenario.crosswalk()), math.inf)
    return row | {"let_go": outcome.log.let_go.get(arrival.index)}


def _queue_rows(outcome: HourOutcome) -> Iterator[Row]:
    """One row for each minute and lane."""
    scenario, log, traffic = outcome.scenario, outcome.log, outcome.scenario.known_traffic
    begin_s = traffic.warm_up_s
    minutes = math.ceil(len(log.queues) / MINUTE_S)
    through = Counter(
        (passage.vehicle.plan.lane, math.floor((passage.passed_s - begin_s) / MINUTE_S))
        for passage in outcome.passages
        if passage.passed_s is not None and passage.passed_s < begin_s + traffic.duration_s
    )
    samples = np.array(log.queues)
    for number, lane in enumerate(lanes_of(scenario)):
        for minute in range(minutes):
            part = samples[round(minute * MINUTE_S) : round((minute + 1) * MINUTE_S), number]
            yield {
                "minute": minute,
                "direction": lane.direction.value,
                "lane": lane.index,
                "mean": float(part.mean()),
                "longest": int(part.max()),
                "let_through": through[lane, minute],
            }


def _since(time_s: float | None, begin_s: float) -> float | None:
    return None if time_s is None else time_s - begin_s


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
