"""An arm's log and SUMO's trips in; the rows of vehicles, people and crosswalks out."""

import xml.etree.ElementTree as ET
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.errors import EngineError
from harness.simulation.arm import Log
from harness.simulation.passages import Columns, columns_of
from harness.simulation.setup import Setup


def vehicles(file: Path, log: Log, setup: Setup) -> Columns:
    """The rows of the table ``vehicles``: every trip that was due in the counted time.

    Trips that never began are among them.
    A trip that has not ended counts with the time until the end.  Delays before the departure are
    part of ``time_loss_s``.

    Args:
        file: SUMO's ``tripinfo`` output, with unfinished and undeparted trips.
        log: the arm's log.
        setup: has the counted time.

    Raises:
        EngineError: the file is cut off.
    """
    rows = []
    try:
        for _, trip in ET.iterparse(file):
            if trip.tag == "tripinfo":
                rows.append(_trip(trip.attrib, log))
                trip.clear()
    except (ET.ParseError, OSError, ValueError) as error:
        raise EngineError(f"SUMO's tripinfo cannot be read: {error}") from None
    return columns_of([row for row in rows if setup.counts(row["due_s"])])


def _trip(trip: Mapping[str, str], log: Log) -> Mapping[str, Any]:
    depart_s, arrival_s = float(trip["depart"]), float(trip["arrival"])
    delay_s, departed = float(trip["departDelay"]), depart_s >= 0
    return {
        "vehicle": trip["id"],
        "type": trip.get("vType", ""),
        "automated": departed and log.kinds[trip["id"]][2],
        "due_s": (depart_s if departed else log.end_s) - delay_s,
        "depart_s": depart_s if departed else None,
        "arrival_s": arrival_s if arrival_s >= 0 else None,
        "depart_delay_s": delay_s,
        "time_loss_s": delay_s + float(trip["timeLoss"]),
    }


def people(log: Log, setup: Setup, fronts_s: Mapping[str, Sequence[float]]) -> Columns:
    """The rows of the table ``people``: one for each way over a chosen crosswalk.

    Who crosses two crosswalks has two rows with one ``person``.  ``side`` is the end of the
    crosswalk's axis from which they come.  ``let_go`` says of those who waited whether they went
    before the first vehicle: before the first that kept them waiting, if they are the harness's;
    before any, if they are SUMO's.

    Args:
        log: the arm's log.
        setup: has the counted time.
        fronts_s: by crosswalk, the times at which vehicles' fronts reached it, sorted.
    """
    rows: list[dict[str, Any]] = []
    for crosswalk, everybody in log.people.items():
        length_m, fronts = setup.town.crosswalks[crosswalk].length_m, fronts_s.get(crosswalk, ())
        for person in everybody:
            walk, arrival_s = person.walk, person.walk.arrival.arrival_s
            until_s = log.end_s if walk.start_s is None else walk.start_s
            wait_s = until_s - arrival_s
            delay_s, let_go = wait_s, person.let_go
            if person.own and person.cleared_s is not None and walk.speed_mps:
                delay_s = person.cleared_s - arrival_s - length_m / walk.speed_mps
            if not person.own and wait_s > 0.0 and walk.start_s is not None:
                let_go = bisect_right(fronts, arrival_s) == bisect_right(fronts, until_s)
            row = {
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
            rows.append(row)
    return columns_of([row for row in rows if setup.counts(row["arrival_s"])])


def crosswalks(log: Log, setup: Setup) -> Columns:
    """The rows of the table ``crosswalks``, with the queue before each."""
    chosen = [setup.town.crosswalks[name] for name in setup.crosswalks]
    centres = [each.axis.interpolate(0.5, normalized=True) for each in chosen]
    queues = [log.queues[name] for name in setup.crosswalks]
    return {
        "crosswalk": [each.id for each in chosen],
        "prioritized": [each.prioritized for each in chosen],
        "length_m": [each.length_m for each in chosen],
        "width_m": [each.width_m for each in chosen],
        "x_m": [at.x for at in centres],
        "y_m": [at.y for at in centres],
        "queue_p95": [float(np.quantile(each, 0.95)) if each else None for each in queues],
    }
