"""The events of one arm of a user's simulation."""

import hashlib
from collections import Counter
from dataclasses import dataclass, field

from harness.encounter.simulation.driving import PassageLog
from harness.encounter.simulation.passages import PersonTrack


def uniform_of(seed: int, vehicle: str) -> float:
    """A number from 0 to 1 that belongs to a vehicle of a pair.

    A vehicle is an AV if its number is below the share of AVs, so a greater share only adds AVs.
    """
    digest = hashlib.blake2b(f"{seed}:{vehicle}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") / 2**64


@dataclass(slots=True)
class VehicleKind:
    """Values of a trip that SUMO does not write: the vehicle's class, and whether it is an AV."""

    type_id: str
    vehicle_class: str
    automated: bool


@dataclass(slots=True)
class SimulationLog:
    """The events of one arm.

    Attributes:
        vehicles: every vehicle that departed, by id.
        passages: over the chosen crosswalks, by the time of R0.
        people: everybody who was on a crosswalk, by crosswalk.
        numbers: the place in ``people`` of everybody who came, by crosswalk and index; places
            beyond its end are of people who left without a step onto the crosswalk.
        queues_m: by crosswalk, the queue in m at every second that counts.
        not_measured: by crosswalk and reason, vehicles that were not measured.
        collisions: number of vehicle–vehicle and vehicle–person collisions by SUMO's own count.
        person_collisions: number of collisions with people at the chosen crosswalks, by crosswalk.
        teleports: number of vehicles that SUMO teleported.
        stuck_s: the longest standing time in s of each vehicle that stood longer than 60 s at a
            chosen crosswalk.
        deadlocked: those who did so while somebody who wanted to cross stood there as well.
        end_s: the time at which the simulation ended.
    """

    vehicles: dict[str, VehicleKind] = field(default_factory=dict)
    passages: list[PassageLog] = field(default_factory=list)
    people: dict[str, list[PersonTrack]] = field(default_factory=dict)
    numbers: dict[str, dict[int, int]] = field(default_factory=dict)
    queues_m: dict[str, list[float]] = field(default_factory=dict)
    not_measured: Counter[tuple[str, str]] = field(default_factory=Counter)
    collisions: int = 0
    person_collisions: Counter[str] = field(default_factory=Counter)
    teleports: int = 0
    stuck_s: dict[str, float] = field(default_factory=dict)
    deadlocked: set[str] = field(default_factory=set)
    end_s: float = 0.0
