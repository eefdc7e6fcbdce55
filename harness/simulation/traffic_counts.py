"""What is counted in an arm besides passages: SUMO's events, queued vehicles, AVs."""

from collections import Counter
from collections.abc import Mapping, Sequence

from harness.core.seeding import NUMBERS, number_of, stream
from harness.engine.ids import is_inside_junction
from harness.engine.protocol import Collision, Running
from harness.simulation.cars import Car
from harness.simulation.people_at import PeopleAt
from harness.simulation.setup import Setup

QUEUED_MPS = 5 / 3.6
"""A vehicle below this speed is queued (5 km/h, as in SUMO's queue output)."""

Cars = Mapping[str, Car]
"""The vehicles on their ways over chosen crosswalks, by their ids."""


class TrafficCounts:
    """SUMO's events, the queues before the chosen crosswalks, and which vehicles are AVs.

    Args:
        setup: what all arms share.
        session: SUMO.
        pair: index of the pair.
        cars: the vehicles on their ways over the crosswalks.
        people: everybody at each crosswalk.

    Attributes:
        automated: whether it is an AV, of every vehicle that departed.
        events: the number of SUMO's events of each kind in the counted time.
        queues: by crosswalk, the number of queued vehicles at every counted second.
    """

    def __init__(
        self, setup: Setup, session: Running, pair: int, cars: Cars, people: Mapping[str, PeopleAt]
    ) -> None:
        self._setup, self._session, self._vehicles = setup, session, session.vehicles
        self._last, self._cars, self._people = session.last, cars, people
        self._key = stream(setup.scenario.experiment.seed, "automated", pair).bytes(32)
        self._classes: Mapping[str, str] = {}
        self._hits: set[tuple[str, str]] = set()
        self.automated: dict[str, bool] = {}
        self.events: Counter[str] = Counter()
        self.queues: dict[str, list[int]] = {name: [] for name in setup.crosswalks}

    def read_classes(self) -> None:
        """Read the class of every type, also of those whose vehicles have not departed."""
        self._classes = self._session.vehicle_classes()

    def is_automated(self, name: str, type_id: str) -> bool:
        """Whether a vehicle of a type is an AV, in either arm, or would be if it departed.

        A greater share only adds AVs, since a vehicle's number does not depend on the share.
        """
        kinds, simulation = {type_id, self._classes.get(type_id, "")}, self._setup.simulation
        share = number_of(name, self._key) / NUMBERS
        return share < simulation.av_share and not kinds.isdisjoint(simulation.av_types)

    def note(self, time_s: float, departed: Sequence[str]) -> None:
        """Note who departed in a step; count its collisions, teleports and emergency stops."""
        for name in departed:
            type_id = self._vehicles.type(name)
            if type_id not in self._classes:
                self.read_classes()
            self.automated[name] = self.is_automated(name, type_id)
        events = ["teleports"] * len(self._last.teleported())
        events += ["emergency_stops"] * len(self._last.emergency_stops())
        for hit in self._last.collisions():
            # SUMO reports a collision at several steps; it counts at the first.  It reports those
            # of people with each other, too.
            if hit.collider in self.automated and (hit.collider, hit.victim) not in self._hits:
                self._hits.add((hit.collider, hit.victim))
                events += self._kinds_of(hit)
        if events and self._setup.counts(time_s):
            self.events.update(events)

    def _kinds_of(self, hit: Collision) -> list[str]:
        """What a collision counts as; a passage notes that SUMO saw one with a person."""
        # Vehicles and people may have the same ids: whoever is on a crosswalk walks.
        places = {name for name, people in self._people.items() if hit.victim in people.names()}
        if hit.collider in self._cars:
            for passage in self._cars[hit.collider].passages:
                passage.collided |= passage.at.crosswalk.id in places
        if places or hit.victim not in self.automated:
            return ["person_collisions"]
        inside = is_inside_junction(hit.lane)
        return ["vehicle_collisions", "overlaps"] if inside else ["vehicle_collisions"]

    def sample_queues(self, before: Mapping[str, Sequence[str]]) -> None:
        """Count the queued vehicles before each crosswalk, of which ``before`` has the edges."""
        waiting = {name: set[str]() for name in before}
        for car in self._cars.values():
            for each in car.passages:
                # The first one may wait inside the junction.
                if each.begun and car.odometer_m < each.at.first_m:
                    waiting[each.at.crosswalk.id].add(car.name)
        for crosswalk, edges in before.items():
            names = waiting[crosswalk].union(*map(self._last.vehicles_on, edges))
            queued = sum(self._vehicles.speed_mps(name) < QUEUED_MPS for name in names)
            self.queues[crosswalk].append(queued)
