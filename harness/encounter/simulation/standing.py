"""Queues before the chosen crosswalks, and vehicles that stand there for long."""

from collections.abc import Iterable, Mapping
from typing import Any

from harness.core.errors import EngineError
from harness.encounter.simulation.driving import PassageLog
from harness.encounter.simulation.log import SimulationLog
from harness.encounter.simulation.passages import STANDING_MPS
from harness.encounter.simulation.people import PeopleAtCrosswalk
from harness.site import WayOver
from harness.site.simulation import Setting

QUEUED_MPS = 5 / 3.6
"""A vehicle below this speed is queued (5 km/h, as in SUMO's queue output)."""

SAMPLE_S = 1.0
"""Time between two samples."""

PATIENCE_S = 60.0
"""A vehicle that stands longer than this at a crosswalk is stuck."""

NEAR_M = 5.0
"""A vehicle whose front is at most this far before a crosswalk stands at it."""

HOPELESS_S = 3600.0
"""In a scenario without an end, a pair fails if a vehicle stands longer than this."""


class Standing:
    """Samples the crosswalks of an arm once per second.

    Args:
        api: the running simulation.
        setting: its crosswalks.
        log: the arm's log, to which queues and stuck vehicles are added.
    """

    def __init__(self, api: Any, setting: Setting, log: SimulationLog) -> None:
        self._vehicle, self._on_lane = api.vehicle, api.lane.getLastStepVehicleIDs
        self._endless = setting.config.end_s is None
        self._log = log
        log.queues_m = {crosswalk.id: [] for crosswalk in setting.crosswalks}
        self._approaches = {
            crosswalk.id: sorted(
                {place for way in crosswalk.straight_ways for place in _before(way)}
            )
            for crosswalk in setting.crosswalks
        }

    def sample(
        self, passages: Iterable[PassageLog], people: Mapping[str, PeopleAtCrosswalk]
    ) -> None:
        """Record each crosswalk's queue, and who is stuck there."""
        for crosswalk, lanes in self._approaches.items():
            self._log.queues_m[crosswalk].append(self._queue_m(lanes))
        for passage in passages:
            crosswalk = passage.driven_way.way.crosswalk
            self._note(passage, people_stand=people[crosswalk].anybody_stands)

    def _queue_m(self, lanes: Iterable[tuple[str, float]]) -> float:
        """The distance from a crosswalk to the rear of its last queued vehicle; 0 without any."""
        vehicle, longest_m = self._vehicle, 0.0
        for lane, start_m in lanes:
            for name in self._on_lane(lane):
                # A vehicle at its scheduled stop, such as a bus, is not held up.
                if vehicle.getSpeed(name) < QUEUED_MPS and not vehicle.isStopped(name):
                    front_m = start_m + vehicle.getLanePosition(name)
                    # A vehicle that has passed the centre line does not queue before it.
                    if front_m <= 0.0:
                        longest_m = max(longest_m, vehicle.getLength(name) - front_m)
        return longest_m

    def _note(self, passage: PassageLog, *, people_stand: bool) -> None:
        """Note how long a vehicle has stood at its crosswalk."""
        near = passage.x_m[-1] >= -passage.driven_way.way.crossing.width_m / 2 - NEAR_M
        stands = near and passage.speed_mps[-1] < STANDING_MPS
        passage.stood_s = passage.stood_s + SAMPLE_S if stands else 0.0
        with_people = stands and people_stand
        passage.with_people_s = passage.with_people_s + SAMPLE_S if with_people else 0.0
        log, name = self._log, passage.name
        if passage.stood_s > PATIENCE_S:
            log.stuck_s[name] = max(passage.stood_s, log.stuck_s.get(name, 0.0))
        if passage.with_people_s > PATIENCE_S:
            log.deadlocked.add(name)

    def check(self, time_s: float) -> None:
        """Once per hour, end a simulation that has no end and in which a vehicle stands for ever.

        Raises:
            EngineError: a vehicle has stood for an hour in a scenario without an end.
        """
        if not self._endless or time_s % HOPELESS_S >= SAMPLE_S:
            return
        vehicle = self._vehicle
        for name in vehicle.getIDList():
            # SUMO counts no time at scheduled stops.
            if vehicle.getWaitingTime(name) >= HOPELESS_S:
                raise EngineError(
                    f"vehicle {name} has stood on lane {vehicle.getLaneID(name)} for an hour at "
                    f"{time_s:g} s, and the scenario has no end: give it one, or let SUMO teleport"
                )


def _before(way: WayOver) -> list[tuple[str, float]]:
    """The lanes from a way's approach to its crosswalk, each with x at which it begins."""
    names = [lane.lane for lane in way.lanes]
    lanes = way.lanes[names.index(way.approach) :]
    return [(lane.lane, lane.start_m) for lane in lanes if lane.start_m < 0.0]
