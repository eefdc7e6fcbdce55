"""One arm of a pair: one configuration, run with the pair's seed; the tables of the arm out."""

import xml.etree.ElementTree as ET
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from harness.core.encounter import Arm, StepMotion
from harness.core.errors import EngineError, StrategyError
from harness.engine.session import Module, Session
from harness.model.interaction import InteractionModel
from harness.simulation.arm import ArmOfPair, Log
from harness.simulation.files import TRIPS_FILE, write_config
from harness.simulation.passages import Columns, columns_of, passages
from harness.simulation.setup import Setup

_COUNTS = (
    *("vehicle_collisions", "person_collisions", "overlaps"),
    *("teleports", "emergency_stops", "conditionings", "clamped"),
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """One arm of a pair: its tables, or the reason why it failed.

    Attributes:
        pair, arm: which arm.
        tables: the columns of its tables, by the table's name.
        reason, traceback: why it failed.
    """

    pair: int
    arm: Arm
    tables: Mapping[str, Columns] = field(default_factory=dict)
    reason: str | None = None
    traceback: str | None = None


def run_arm(
    setup: Setup,
    model: InteractionModel,
    pair: int,
    arm: Arm,
    folder: Path,
    keeps: bool = False,
    module: Module = "libsumo",
    more: Mapping[str, str] = MappingProxyType({}),
    begins: Callable[[Sized | None], None] = lambda _steps: None,
) -> Outcome:
    """Simulate one arm of a pair; if a strategy fails in one vehicle, the whole arm fails.

    Args:
        setup: what all arms of the cell share.
        model: the interaction model.
        pair: index of the pair.
        arm: which arm.
        folder: the arm's folder, where its configuration and outputs lie.
        keeps: whether the configuration's own outputs are written there.
        module: where SUMO runs.
        more: further options of SUMO.
        begins: receives what grows with every step when the first step is about to begin, and None
            after the last one.
    """
    session: Session | None = None
    try:
        config = write_config(setup.config, folder, setup.seed(pair), more, keeps=keeps)
        session = Session(config, module=module)
        running = ArmOfPair(setup, session, pair, arm, model)
        begins(running)
        log = running.run()
        begins(None)
        session.close()
        step_s, session = session.step_s, None
        return Outcome(pair, arm, _tables(setup, log, folder / TRIPS_FILE, step_s))
    except StrategyError as error:
        return Outcome(pair, arm, reason=str(error), traceback=error.traceback)
    except EngineError as error:
        return Outcome(pair, arm, reason=f"{setup.config.path.name}: {error}")
    finally:
        if session is not None:
            session.close()


def _tables(setup: Setup, log: Log, trips: Path, step_s: float) -> dict[str, Columns]:
    """The tables of an arm whose simulation has ended."""
    counted = [each for each in log.passages if setup.counts(each.begin_s - each.trace_offset_s)]
    motion: StepMotion = "ballistic" if setup.config.ballistic else "euler"
    passed = passages(counted, log.people, setup.zones, step_s, motion)
    fronts_s: defaultdict[str, list[float]] = defaultdict(list)
    for name, front_s in zip(passed.get("crosswalk", ()), passed.get("front_s", ()), strict=True):
        fronts_s[name] += [] if front_s is None else [front_s]
    walked = [
        row
        for name in setup.crosswalks
        for row in _people(log, setup, name, sorted(fronts_s[name]))
        if setup.counts(row["arrival_s"])
    ]
    driven = (row for row in _vehicles(trips, log) if setup.counts(row["due_s"]))
    own = sum(row["own"] for row in walked)
    arms = {
        "begin_s": setup.begin_s,
        "counted_s": min(setup.end_s, log.end_s) - setup.begin_s,
        "harness_people": own,
        "sumo_people": len(walked) - own,
        **{name: log.counts[name] for name in _COUNTS},
    }
    return {
        "arms": columns_of([arms]),
        "passages": passed,
        "vehicles": columns_of([*driven]),
        "people": columns_of(walked),
        "crosswalks": columns_of([_crosswalk(log, setup, name) for name in setup.crosswalks]),
    }


def _vehicles(trips: Path, log: Log) -> Iterator[Mapping[str, Any]]:
    """The rows of the table ``vehicles``, from SUMO's tripinfo: trips that never began too.

    A trip that has not ended counts with the time until the end.  Delays before the departure are
    part of ``time_loss_s``.

    Raises:
        EngineError: the file is cut off.
    """
    try:
        for _, trip in ET.iterparse(trips):
            if trip.tag != "tripinfo":
                continue
            depart_s, arrival_s = float(trip.attrib["depart"]), float(trip.attrib["arrival"])
            delay_s, departed = float(trip.attrib["departDelay"]), depart_s >= 0
            yield {
                "vehicle": trip.attrib["id"],
                "type": trip.get("vType", ""),
                "automated": departed and log.automated[trip.attrib["id"]],
                "due_s": (depart_s if departed else log.end_s) - delay_s,
                "depart_s": depart_s if departed else None,
                "arrival_s": arrival_s if arrival_s >= 0 else None,
                "depart_delay_s": delay_s,
                "time_loss_s": delay_s + float(trip.attrib["timeLoss"]),
            }
            trip.clear()
    except (ET.ParseError, OSError, ValueError) as error:
        raise EngineError(f"SUMO's tripinfo cannot be read: {error}") from None


def _people(
    log: Log, setup: Setup, crosswalk: str, fronts_s: Sequence[float]
) -> Iterator[Mapping[str, Any]]:
    """The rows of the table ``people`` at one crosswalk: one for each way over it.

    Who crosses two crosswalks has two rows with one ``person``.  ``side`` is the end of the
    crosswalk's axis from which they come.  ``let_go`` says of those who waited whether they went
    before the first vehicle: before the first that kept them waiting, if they are the harness's;
    before any, if they are SUMO's.

    Args:
        log: the arm's log.
        setup: has the network.
        crosswalk: the crosswalk.
        fronts_s: the times at which vehicles' fronts reached it, sorted.
    """
    length_m = setup.town.crosswalks[crosswalk].length_m
    for person in log.people[crosswalk]:
        walk, arrival_s = person.walk, person.walk.arrival.arrival_s
        until_s = log.end_s if walk.start_s is None else walk.start_s
        wait_s = until_s - arrival_s
        delay_s, let_go = wait_s, person.let_go
        if person.own and person.cleared_s is not None and walk.speed_mps:
            delay_s = person.cleared_s - arrival_s - length_m / walk.speed_mps
        if not person.own and wait_s > 0.0 and walk.start_s is not None:
            let_go = bisect_right(fronts_s, arrival_s) == bisect_right(fronts_s, until_s)
        yield {
            "crosswalk": crosswalk,
            "person": person.id,
            "own": person.own,
            "side": walk.arrival.side,
            "arrival_s": arrival_s,
            "start_s": walk.start_s,
            "cleared_s": person.cleared_s,
            "wait_s": wait_s,
            "delay_s": max(delay_s, 0.0),
            "let_go": let_go,
            "speed_mps": walk.speed_mps,
        }


def _crosswalk(log: Log, setup: Setup, name: str) -> Mapping[str, Any]:
    """The row of the table ``crosswalks``, with the queue before it."""
    each, queue = setup.town.crosswalks[name], log.queues[name]
    centre = each.axis.interpolate(0.5, normalized=True)
    return {
        "crosswalk": name,
        "prioritized": each.prioritized,
        "length_m": each.length_m,
        "width_m": each.width_m,
        "x_m": centre.x,
        "y_m": centre.y,
        "queue_p95": float(np.quantile(queue, 0.95)) if queue else None,
    }
