"""The rows of the tables of users' own simulations.  The columns are described in docs/files.md."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import pyarrow as pa

from harness.core.encounter import Arm
from harness.encounter.simulation.driving import PassageLog
from harness.encounter.simulation.log import uniform_of
from harness.encounter.simulation.pairing import (
    MeasuredPassage,
    SimulationOutcome,
    counted_s,
)
from harness.encounter.simulation.people import waited_s
from harness.encounter.simulation.trips import Trip
from harness.encounter.simulation.visits import BENDS, TURNS
from harness.measures.ego import crossing_time
from harness.old.store.hour_tables import passage_counts, record_row
from harness.old.store.schemas import CROSSWALK_FIELDS, SIMULATION_TABLES, TABLES
from harness.old.store.simulations.simulation_catalogue import AVS_NOT_DRIVEN
from harness.old.store.tables import Row, Tables, table_of
from harness.scenario.own_simulation import setting_of, sumo_seed


def simulation_rows(cell: int, outcomes: Iterable[SimulationOutcome]) -> Tables:
    """The tables ``simulations`` and ``passages_over``.

    A failed arm has a row only in ``simulations``.
    """
    rows: dict[str, list[Row]] = {name: [] for name in SIMULATION_TABLES}
    for outcome in outcomes:
        keys = {"cell": cell, "pair": outcome.pair, "arm": outcome.arm.value}
        if outcome.reason is not None:
            rows["simulations"].append(keys | {"reason": outcome.reason})
            continue
        counted = counted_s(outcome.scenario, setting_of(outcome.scenario))
        passages = [_passage_row(each) for each in counted_passages(outcome)]
        rows["simulations"].append(keys | _numbers(outcome, passages, counted))
        rows["passages_over"] += [keys | row for row in passages]
    return {name: table_of(name, content) for name, content in rows.items()}


def counted_passages(outcome: SimulationOutcome) -> list[MeasuredPassage]:
    """The passages that begin in the counted time: the rows of ``passages_over``."""
    begin_s, end_s = counted_s(outcome.scenario, setting_of(outcome.scenario))
    return [each for each in outcome.passages if begin_s <= each.log.time_s[0] < end_s]


def crosswalks_of_cell(cell: int, rows: pa.Table) -> pa.Table:
    """The table ``crosswalks`` of a cell: a row for each chosen crosswalk."""
    flat = [
        {"cell": cell, "pair": row["pair"], "arm": row["arm"]} | each
        for row in rows.select(["pair", "arm", "crosswalks"]).to_pylist()
        for each in row["crosswalks"] or ()
    ]
    return pa.Table.from_pylist(flat, schema=TABLES["crosswalks"])


def _numbers(
    outcome: SimulationOutcome,
    passages: Sequence[Row],
    counted: tuple[float, float],
) -> Row:
    """The row of an arm in ``simulations``."""
    log, scenario = outcome.log, outcome.scenario
    trips = [trip for trip in outcome.trips if counted[0] <= trip.due_s < counted[1]]
    vehicles, people = ([trip for trip in trips if trip.person is on] for on in (False, True))
    automated = _automated(outcome)
    avs, others = ([trip for trip in vehicles if automated(trip) is av] for av in (True, False))
    crosswalks = _crosswalks(outcome, passages, counted)
    waits = [wait for each in crosswalks for wait in each.pop("waits")]
    queues = np.array([q for each in log.queues_m.values() for q in each])
    driver = Arm.AV if outcome.arm is Arm.AV else Arm.HUMAN
    name = scenario.arms.driver(driver)
    driven = [row for row in passages if row["strategy"] == name and row["commands"]]
    of_avs = [row for row in passages if row["automated"]]
    delays = [row["least_delay_s"] for row in passages]
    return passage_counts(passages, scenario.conflicts) | {
        "vehicles": len(vehicles),
        "automated": len(avs),
        "people": len(people),
        "unfinished": sum(not trip.arrived for trip in trips),
        "not_departed": sum(not trip.departed for trip in trips),
        "av_time_loss_s": _mean([trip.time_loss_s for trip in avs]),
        "other_time_loss_s": _mean([trip.time_loss_s for trip in others]),
        "vehicle_time_loss_s": _mean([trip.time_loss_s for trip in vehicles]),
        "people_time_loss_s": _mean([trip.time_loss_s for trip in people]),
        "people_duration_s": _mean([trip.duration_s for trip in people]),
        "passages": len(passages),
        "met": sum(row["pedestrians"] > 0 for row in passages),
        "fallbacks": sum(row["fallback"] for row in driven if row["pedestrians"]),
        "met_driven": sum(row["pedestrians"] > 0 for row in driven),
        "driven": len(driven),
        "not_driven": sum(row["not_driven"] is not None for row in passages),
        "av_passages": len(of_avs),
        **{
            column: sum(row["not_driven"] == why for row in of_avs)
            for column, (why, _) in AVS_NOT_DRIVEN.items()
        },
        "avs_uncommanded": sum(row["not_driven"] is None and not row["commands"] for row in of_avs),
        "not_measured": sum(
            number for (_, why), number in log.not_measured.items() if why in (TURNS, BENDS)
        ),
        "commands": sum(row["commands"] for row in passages),
        "cut": sum(row["cut"] for row in passages),
        "crosswalk_delay_s": _mean(delays),
        "crosswalk_wait_s": _mean(waits),
        "queue_p95_m": float(np.quantile(queues, 0.95)) if queues.size else None,
        "sumo_collisions": log.collisions,
        "sumo_person_collisions": sum(log.person_collisions.values()),
        "teleports": log.teleports,
        "stuck": len(log.stuck_s),
        "deadlocked": len(log.deadlocked),
        "stood_longest_s": max(log.stuck_s.values(), default=0.0),
        "crosswalks": crosswalks,
    }


def _automated(outcome: SimulationOutcome) -> Callable[[Trip], bool]:
    """Whether a trip is an AV's; both arms have the same AVs, including AVs that never departed."""
    simulation = outcome.scenario.known_simulation
    seed = sumo_seed(outcome.scenario, setting_of(outcome.scenario).config, outcome.pair)
    kinds = outcome.log.vehicles.values()
    classes = {kind.type_id: kind.vehicle_class for kind in kinds}
    names = set(simulation.av_types)

    def automated(trip: Trip) -> bool:
        alike = trip.type_id in names or classes.get(trip.type_id) in names
        return alike and uniform_of(seed, trip.name) < simulation.av_share

    return automated


def _crosswalks(
    outcome: SimulationOutcome,
    passages: Sequence[Row],
    counted: tuple[float, float],
) -> list[Row]:
    """The rows of ``crosswalks``, each with the individual ``waits`` of its people."""
    log, setting = outcome.log, setting_of(outcome.scenario)
    rows = []
    for crosswalk in setting.crosswalks:
        over = [row for row in passages if row["crosswalk"] == crosswalk.id]
        delays = [row["least_delay_s"] for row in over]
        way = crosswalk.ways[0]
        people = [
            track
            for track in log.people.get(crosswalk.id, ())
            if counted[0] <= track.time_s[0] < counted[1]
        ]
        waits = [
            wait_s
            for track in people
            # Whoever is still on the way to the kerb at the end has not waited yet.
            if (wait_s := waited_s(track, setting.step_s, way)) or track.on_crossing.any()
        ]
        queue = np.array(log.queues_m.get(crosswalk.id, ()))
        rows.append(
            passage_counts(over, outcome.scenario.conflicts)
            | {
                "crosswalk": crosswalk.id,
                "passages": len(over),
                "automated": sum(row["automated"] for row in over),
                "not_driven": sum(row["not_driven"] is not None for row in over),
                "turning": log.not_measured[crosswalk.id, TURNS],
                "bending": log.not_measured[crosswalk.id, BENDS],
                "people": sum(bool(track.on_crossing.any()) for track in people),
                "vehicle_delay_s": _mean(delays),
                "pedestrian_wait_s": _mean(waits),
                "queue_mean_m": float(queue.mean()) if queue.size else None,
                "queue_p95_m": float(np.quantile(queue, 0.95)) if queue.size else None,
                "sumo_collisions": log.person_collisions[crosswalk.id],
                "waits": waits,
            }
        )
    return [
        {name: row.get(name) for name in ("crosswalk", *CROSSWALK_FIELDS, "waits")} for row in rows
    ]


def _passage_row(measured: MeasuredPassage) -> Row:
    log, record, trace = measured.log, measured.record, measured.trace
    begin_s = log.time_s[0]
    edge_s = crossing_time(trace, -trace.crossing.width_m / 2)
    passed_s = None if record.pass_time_s is None else begin_s + record.pass_time_s
    return record_row(record) | {
        "crosswalk": log.driven_way.way.crosswalk,
        "vehicle": log.name,
        "type": log.type_id,
        "automated": log.automated,
        "strategy": log.strategy_name,
        "not_driven": log.not_driven,
        "trigger_s": begin_s,
        "edge_s": None if edge_s is None else begin_s + edge_s,
        "passed_s": passed_s,
        "free_speed_mps": log.vehicle.initial_speed_mps,
        "delay_s": record.delay_s,
        "least_delay_s": least_delay_s(log) if record.delay_s is None else record.delay_s,
        "trace_offset_s": trace.trace_offset_s,
        "commands": log.commands,
        "cut": log.cut,
        "ended": log.ended,
        "approach_stops": 0,
    }


def least_delay_s(log: PassageLog) -> float:
    """The delay of a passage up to its last state, in s: the least that it can become."""
    driven_s = (log.x_m[-1] - log.x_m[0]) / log.vehicle.initial_speed_mps
    return max(0.0, log.time_s[-1] - log.time_s[0] - driven_s)


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
