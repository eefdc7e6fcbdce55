"""One arm of a pair: one configuration in; rows of arms, vehicles, people and crosswalks out."""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.errors import EngineError, StrategyError
from harness.core.freezing import Frozen
from harness.core.vocabulary import Arm, FailedIn, StepMotion, ignore
from harness.engine.arm_files import Trip, trips_in, write_config
from harness.engine.session import Runs, Session
from harness.engine.sources import CROSSWALK
from harness.measures.efficiency import beyond
from harness.simulation.arm import SimulatedArm
from harness.simulation.passages import SimulatedRow, passages
from harness.simulation.setup import Setup
from harness.simulation.walk import Walked
from harness.site.town import Crosswalk

TableColumns = Mapping[str, Sequence[Any]]
"""A table: its columns by name."""

_EVENTS = ["vehicle_collisions", "person_collisions", "overlaps", "teleports", "emergency_stops"]


@dataclass(frozen=True, slots=True)
class ArmTables(Frozen):
    """One arm of a pair: its tables, or the reason why it failed.

    Attributes:
        pair, arm: which arm.
        tables: the columns of its tables, by the table's name.
        reason, failed_in, traceback: why it failed, and what.
    """

    pair: int
    arm: Arm
    tables: Mapping[str, TableColumns] = field(default_factory=dict)
    reason: str | None = None
    failed_in: FailedIn | None = None
    traceback: str | None = None


def run_arm(
    setup: Setup,
    pair: int,
    arm: Arm,
    folder: Path,
    *,
    keeps: bool = False,
    window: Mapping[str, str] | None = None,
    begins: Callable[[Sized | None], None] = ignore,
) -> ArmTables:
    """Simulate one arm of a pair; if a strategy fails in one vehicle, the whole arm fails.

    Args:
        setup: what all arms of the cell share.
        pair: index of the pair.
        arm: which arm.
        folder: the arm's folder, where its configuration and outputs lie.
        keeps: whether the configuration's own outputs are written there.
        window: options of sumo-gui, in whose window it runs; None: without one.
        begins: receives what grows with every step when the first step is about to begin, and None
            after the last one.
    """
    try:
        config = write_config(setup.config, folder, setup.seed(pair), window or {}, keeps=keeps)
        runs: Runs = "here" if window is None else "window"
        with closing(Session(config, runs=runs)) as session, session.watched("failed"):
            running = SimulatedArm(setup, session, pair, arm)
            begins(running.times_s)
            running.run()
            begins(None)
        return ArmTables(pair, arm, tables_of(setup, running, trips_in(folder)))
    except StrategyError as error:
        return ArmTables(pair, arm, {}, str(error), "strategy", error.traceback)
    except EngineError as error:
        return ArmTables(pair, arm, {}, f"{setup.config.path.name}: {error}", "engine")


def tables_of(setup: Setup, arm: SimulatedArm, trips: Iterable[Trip]) -> dict[str, TableColumns]:
    """The tables of an arm whose simulation has ended, with the trips that SUMO wrote.

    Raises:
        EngineError: the simulation ended before the counted time.
    """
    end_s, traffic = arm.session.time_s, arm.traffic
    if end_s <= setup.begin_s:
        raise EngineError(f"it ended at {end_s:g} s; counted is from {setup.begin_s:g} s on")
    people = {name: each.walked() for name, each in arm.people.items()}
    counted = [each for each in arm.passages if setup.counts(each.begin_s - each.trace_offset_s)]
    motion: StepMotion = "ballistic" if setup.config.ballistic else "euler"
    passed = passages(counted, people, setup.town, arm.session.step_s, motion)
    fronts_s = {name: list[float]() for name in people}
    for row in passed:
        fronts_s[row["crosswalk"]] += [] if row["front_s"] is None else [row["front_s"]]
    walked = [
        row
        for name, of in people.items()
        for row in _people(of, setup.crosswalks[name], sorted(fronts_s[name]), end_s)
        if setup.counts(row["arrival_s"])
    ]
    arms = {
        "begin_s": setup.begin_s,
        "counted_s": min(setup.end_s, end_s) - setup.begin_s,
        "harness_people": sum(row["own"] for row in walked),
        "sumo_people": sum(not row["own"] for row in walked),
        "people_left_out": sum(each.left_out for each in arm.people.values()),
        **{name: traffic.events[name] for name in _EVENTS},
        "conditionings": sum(each.uses for each in arm.uses),
        "clamped": sum(each.clamped for each in arm.uses),
    }
    vehicles = _vehicles(trips, traffic.is_automated, end_s)
    tables: dict[str, list[SimulatedRow]] = {
        "arms": [arms],
        "passages": passed,
        "vehicles": [row for row in vehicles if setup.counts(row["due_s"])],
        "people": walked,
        "crosswalks": [_crosswalk(at, traffic.queues[at.id]) for at in setup.crosswalks.values()],
    }
    # Without rows there are no columns.
    return {
        name: {column: [row[column] for row in rows] for column in (rows[0] if rows else ())}
        for name, rows in tables.items()
    }


def _vehicles(
    trips: Iterable[Trip], is_automated: Callable[[str, str], bool], end_s: float
) -> Iterator[SimulatedRow]:
    """The rows of the table ``vehicles``, from SUMO's trips: those that never began too.

    A trip that has not ended counts with the time until the end.  Delays before the departure are
    part of ``time_loss_s``.
    """
    for trip in trips:
        begun_s = end_s if trip.depart_s is None else trip.depart_s
        yield {
            **trip._asdict(),
            "automated": is_automated(trip.vehicle, trip.type),
            "due_s": begun_s - trip.depart_delay_s,
            "time_loss_s": trip.depart_delay_s + trip.time_loss_s,
        }


def _people(
    people: Iterable[Walked], crosswalk: Crosswalk, fronts_s: Sequence[float], end_s: float
) -> Iterator[SimulatedRow]:
    """The rows of the table ``people`` at one crosswalk: one for each way over it.

    Who crosses two crosswalks has two rows with one ``person``.  ``side`` is the end of the
    crosswalk's axis from which they come, ``near`` its begin; on the harness's own road, where the
    axis begins at the far kerb, it is the kerb.  ``let_go`` says of those who waited whether they
    went before the first vehicle: before the first that kept them waiting, if they are the
    harness's; before any, if they are SUMO's.  ``delay_s`` is below 0 of those who walk on faster
    than they set off.

    Args:
        people: everybody there.
        crosswalk: the crosswalk.
        fronts_s: the times at which vehicles' fronts reached it, sorted.
        end_s: when the simulation ended.
    """
    for person in people:
        walk, arrival_s = person.walk, person.walk.arrival.arrival_s
        until_s = end_s if walk.start_s is None else walk.start_s
        wait_s = until_s - arrival_s
        delay_s, let_go = None, person.let_go  # they are still crossing at the end
        if not person.own or walk.speed_mps is None:  # SUMO's, or they wait until the end
            delay_s = wait_s
        elif (cleared_s := person.cleared_s) is not None:
            delay_s = float(beyond(cleared_s - arrival_s, crosswalk.length_m / walk.speed_mps))
        if not person.own and wait_s > 0.0 and walk.start_s is not None:
            let_go = bisect_right(fronts_s, arrival_s) == bisect_right(fronts_s, until_s)
        yield {
            "crosswalk": crosswalk.id,
            "person": person.id,
            "own": person.own,
            "side": walk.arrival.side.other if crosswalk.id == CROSSWALK else walk.arrival.side,
            "arrival_s": arrival_s,
            "start_s": walk.start_s,
            "cleared_s": person.cleared_s,
            "wait_s": wait_s,
            "delay_s": delay_s,
            "let_go": let_go,
            "speed_mps": walk.speed_mps,
        }


def _crosswalk(crosswalk: Crosswalk, queue: Sequence[int]) -> SimulatedRow:
    """The row of the table ``crosswalks``, with the queue before it."""
    centre = crosswalk.axis.interpolate(0.5, normalized=True)
    return {
        "crosswalk": crosswalk.id,
        "prioritized": crosswalk.prioritized,
        "length_m": crosswalk.length_m,
        "width_m": crosswalk.width_m,
        "x_m": centre.x,
        "y_m": centre.y,
        "queue_p95": float(np.quantile(queue, 0.95)) if queue else None,
    }
