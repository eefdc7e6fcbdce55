"""Simulations whose rows are made by hand: every number of them can be counted."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from harness.core.vocabulary import Arm
from harness.results.cell_findings import CellFindings, cell_findings
from harness.results.rows import simulation_rows
from harness.results.tables import TABLES_OF, Tables
from harness.scenario import Cell, load_scenario

BEGIN_S, COUNTED_S = 100.0, 600.0
PLACES = {":a_c0": False, ":b_c0": True}
"""The crosswalks, with whether they are prioritized."""

Rows = Sequence[Mapping[str, Any]]


def passage(vehicle: str, **more: Any) -> dict[str, Any]:
    """A passage of an AV that was driven and met nobody."""
    known = {"crosswalk": ":a_c0", "vehicle": vehicle, "type": "car", "automated": True}
    known |= {"connection": "a_0>b_0", "manoeuvre": "straight", "driver": "gap_yield"}
    known |= {"driven": True, "trigger_s": 200.0, "front_s": 204.0, "rear_s": 206.0}
    known |= {"ended": "passed", "steps": 100, "share_strategy": 1.0, "pedestrians": 1}
    known |= {f"share_{name}": 0.0 for name in ("actuator", "lane", "leader", "right_of_way")}
    return known | {"fallback": False, "delay_s": 2.0, "pet_s": 3.0} | more


def trip(vehicle: str, **more: Any) -> dict[str, Any]:
    """A trip of an AV."""
    known = {"vehicle": vehicle, "type": "car", "automated": True, "due_s": 150.0}
    known |= {"depart_s": 150.0, "arrival_s": 200.0, "depart_delay_s": 0.0, "time_loss_s": 5.0}
    return known | more


def person(name: str, **more: Any) -> dict[str, Any]:
    """One of the harness's people."""
    known = {"crosswalk": ":a_c0", "person": name, "own": True, "side": "near"}
    known |= {"arrival_s": 200.0, "start_s": 203.0, "cleared_s": 209.0}
    return known | {"wait_s": 3.0, "delay_s": 3.0, "let_go": True} | more


def arm(
    passages: Rows = (),
    vehicles: Rows = (),
    people: Rows = (),
    queues: tuple[float, float] = (1.0, 1.0),
    **more: Any,
) -> dict[str, Rows]:
    """The rows of one simulation; ``queues`` are those of its two crosswalks."""
    places = [
        {"crosswalk": name, "prioritized": PLACES[name], "length_m": 7.0}
        | {"x_m": 90.0 * n, "y_m": 40.0 * n, "queue_p95": queue}
        for n, (name, queue) in enumerate(zip(PLACES, queues, strict=True))
    ]
    counts = ("vehicle_collisions", "person_collisions", "teleports", "emergency_stops")
    counts = (*counts, "overlaps", "harness_people", "sumo_people")
    own = dict.fromkeys(counts, 0) | {"begin_s": BEGIN_S, "counted_s": COUNTED_S} | more
    tables = {"passages": passages, "vehicles": vehicles, "people": people}
    return {"arms": [own], **tables, "crosswalks": places}


def failed(reason: str = "the strategy raised") -> dict[str, Rows]:
    """The rows of a simulation that failed."""
    return {"arms": [{"reason": reason, "failed_in": "strategy"}]}


def tables_of(
    pairs: Sequence[tuple[dict[str, Rows], dict[str, Rows]]], cell: int = 0, first: int = 0
) -> Tables:
    """The tables of a cell, from both arms of each pair, beginning with pair ``first``."""
    parts = []
    for number, both in enumerate(pairs, first):
        for which, rows in zip(Arm, both, strict=True):
            columns = {}
            for name, of in rows.items():
                keys = dict.fromkeys(key for row in of for key in row)
                columns[name] = {key: [row.get(key) for row in of] for key in keys}
            parts.append(simulation_rows(cell, number, which, columns))
    return {
        of.name: pa.concat_tables([each[of.name] for each in parts])
        for of in TABLES_OF["simulations"]
    }


def findings_of(*pairs: tuple[dict[str, Rows], dict[str, Rows]], **changes: object) -> CellFindings:
    """The findings of a cell of ``traffic``; a double underscore in a change is the dot."""
    named = {key.replace("__", "."): value for key, value in changes.items()}
    scenario = load_scenario("traffic", named)
    return cell_findings(Cell(0, {}, scenario), tables_of(pairs), 0.95)


def ordinary(pair: int, av: bool = True, slower_s: float = 0.0) -> dict[str, Rows]:
    """One simulation of many vehicles and people, like an ordinary one."""
    rng = np.random.default_rng((pair, av))
    due_s = np.sort(rng.uniform(BEGIN_S, BEGIN_S + COUNTED_S, 120))
    delay_s = rng.gamma(2.0, 1.5, 120) + slower_s
    automated = np.random.default_rng(pair).uniform(size=120) < 0.5
    passages = [
        passage(
            f"v{n}", crosswalk=[*PLACES][n % 2],
            automated=bool(automated[n]), driven=bool(automated[n]),
            driver="gap_yield" if automated[n] else "sumo", trigger_s=due_s[n] + 20,
            front_s=due_s[n] + 24 + delay_s[n], rear_s=due_s[n] + 26 + delay_s[n],
            delay_s=delay_s[n],
            not_driven_because=None if automated[n] else "it is no AV",
            share_strategy=0.7, share_leader=0.2, share_lane=0.1, pet_s=float(rng.uniform(0.5, 8)),
            min_ttc_s=float(rng.uniform(0.5, 8)), max_drac_mps2=float(rng.uniform(0, 4)),
        )
        for n in range(120)
    ]  # fmt: skip
    vehicles = [
        trip(f"v{n}", automated=bool(automated[n]), due_s=due_s[n], depart_s=due_s[n],
             arrival_s=due_s[n] + 60 + delay_s[n], time_loss_s=delay_s[n] + 4)
        for n in range(120)
    ]  # fmt: skip
    wait_s = rng.exponential(3.0, 80)
    people = [
        person(f"p{n}", crosswalk=[*PLACES][n % 2], wait_s=wait_s[n], delay_s=wait_s[n] + 0.2,
               let_go=bool(n % 3) if n % 2 else None)
        for n in range(80)
    ]  # fmt: skip
    queues = rng.uniform(0.0, 3.0), rng.uniform(0.0, 3.0)
    return arm(passages, vehicles, people, queues, sumo_people=0, harness_people=80)
