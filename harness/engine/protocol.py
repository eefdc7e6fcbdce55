"""What moves everybody: the interface that an episode needs, and that an arm of a simulation needs.

The functions of a simulation have SUMO's names beside them, by which ``session`` finds them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple, Protocol

from harness.core.vocabulary import Arrival


class Engine(Protocol):
    """An engine moves one ego and sets pedestrians to given positions.

    One engine serves any number of episodes, one after another: ``begin``, ``step`` until the
    episode is over, ``end``.  It is bound to one crosswalk, one vehicle and one step length.
    ``closed`` says whether ``close`` was called.
    """

    closed: bool

    def begin(self, arrivals: Sequence[Arrival]) -> tuple[float, float]:
        """Insert the ego at the trigger.

        Args:
            arrivals: all pedestrians who may arrive during the episode, by arrival time.

        Returns:
            The ego's state (x of the front bumper in m, speed in m/s) at t = 0.
        """

    def step(self, speed_mps: float, pedestrians: Sequence[tuple[int, float]]) -> float:
        """Advance one step under constant acceleration.

        Args:
            speed_mps: the ego's speed at the end of the step.
            pedestrians: (index, y in m at the end of the step) of all pedestrians who have arrived
                and not left; waiting pedestrians are included.

        Returns:
            The ego's x at the end of the step.
        """

    def remove(self, index: int) -> None:
        """Remove a pedestrian who has reached the other kerb."""

    def end(self) -> bool | None:
        """Clear the road.

        Returns:
            Whether the engine itself detected that the ego hit a pedestrian; None if it detects no
            collisions.
        """

    def close(self) -> None:
        """Release the simulation; the engine cannot be used afterwards."""


class VehicleType(NamedTuple):
    """What the vehicles of a type are and can do."""

    length_m: float
    width_m: float
    acceleration_mps2: float
    deceleration_mps2: float
    max_speed_mps: float


CAR = VehicleType(5.0, 1.8, 2.6, 4.5, 200 / 3.6)
"""SUMO's default car."""

ENDS_M = 0.05
"""People are put on a crosswalk's axis this far from its ends, or farther."""


class Collision(Protocol):
    """A collision that SUMO reports: who drove, whom they hit, and on which lane."""

    collider: str
    victim: str
    lane: str


_Ids = Callable[[], Sequence[str]]


@dataclass(frozen=True, slots=True)
class Vehicles:
    """Functions for vehicles; most take a vehicle's id."""

    ids: Annotated[_Ids, "vehicle.getIDList"]
    lane: Annotated[Callable[[str], str], "vehicle.getLaneID"]
    lane_position_m: Annotated[Callable[[str], float], "vehicle.getLanePosition"]
    odometer_m: Annotated[Callable[[str], float], "vehicle.getDistance"]
    speed_mps: Annotated[Callable[[str], float], "vehicle.getSpeed"]
    acceleration_mps2: Annotated[Callable[[str], float], "vehicle.getAcceleration"]
    speed_factor: Annotated[Callable[[str], float], "vehicle.getSpeedFactor"]
    type: Annotated[Callable[[str], str], "vehicle.getTypeID"]
    set_speed: Annotated[Callable[[str, float], object], "vehicle.setSpeed"]
    remove: Annotated[Callable[[str], object], "vehicle.remove"]


@dataclass(frozen=True, slots=True)
class People:
    """Functions for people; most take a person's id."""

    next_edge: Annotated[Callable[[str], str], "person.getNextEdge"]
    position: Annotated[Callable[[str], tuple[float, float]], "person.getPosition"]
    speed_mps: Annotated[Callable[[str], float], "person.getSpeed"]
    walk: Annotated[Callable[[str, Sequence[str], float], object], "person.appendWalkingStage"]
    remove: Annotated[Callable[[str], object], "person.remove"]


@dataclass(frozen=True, slots=True)
class LastStep:
    """Functions for what happened in the last step.

    Attributes:
        departed, arrived, teleported, emergency_stops: ids of the vehicles that entered, arrived,
            began to teleport, or had to stop as in an emergency.
        collisions: those that were seen; one hit may last several steps, and people who touch each
            other are among them.
        vehicles_on, people_on: ids of those on an edge at its end.
    """

    departed: Annotated[_Ids, "simulation.getDepartedIDList"]
    arrived: Annotated[_Ids, "simulation.getArrivedIDList"]
    teleported: Annotated[_Ids, "simulation.getStartingTeleportIDList"]
    emergency_stops: Annotated[_Ids, "simulation.getEmergencyStoppingVehiclesIDList"]
    collisions: Annotated[Callable[[], Sequence[Collision]], "simulation.getCollisions"]
    vehicles_on: Annotated[Callable[[str], Sequence[str]], "edge.getLastStepVehicleIDs"]
    people_on: Annotated[Callable[[str], Sequence[str]], "edge.getLastStepPersonIDs"]


class Running(Protocol):
    """A running simulation, as an arm of a pair asks and commands it.

    Attributes:
        vehicles, people, last: its functions.
        step_s: the length of a step.
        time_s: the time at the end of the last step.
    """

    vehicles: Vehicles
    people: People
    last: LastStep
    step_s: float
    time_s: float

    def step(self) -> float:
        """Simulate one step; return the time at its end in s.

        Raises:
            EngineError: the simulation is lost.
        """

    def goes_on(self, end_s: float | None, /) -> bool:
        """Whether there is a further step; None: as long as anybody is on the way."""

    def built(self, vehicle: str, /) -> VehicleType:
        """What a vehicle is and can do, which may differ from its type's."""

    def vehicle_classes(self) -> Mapping[str, str]:
        """The class of every type of vehicles that has been read so far, by the type's id."""

    def lanes_ahead(self, vehicle: str, lane: str, /) -> Sequence[str]:
        """The lanes that a vehicle will follow on its route.

        The first is that on which it is, or to which it has to change before the next junction.
        """

    def follows(self, vehicle: str, speed_mps: float, deceleration_mps2: float, /) -> bool:
        """Whether the vehicle ahead is so near that the simulation keeps the distance to it.

        Args:
            vehicle: the follower.
            speed_mps: the follower's speed before the last step.
            deceleration_mps2: the follower's greatest deceleration.
        """

    def let_yield(self, vehicle: str, yields: bool, /) -> None:
        """Let a commanded vehicle keep its duty to yield; in any case it keeps leaders."""

    def ignore(self, vehicle: str, people: Sequence[str], /) -> None:
        """Let a vehicle not mind these people, by their ids."""

    def release(self, vehicle: str, /) -> None:
        """Give a commanded vehicle back to the simulation's driver, who minds everybody."""

    def add_person(self, name: str, edge: str, position_m: float, /) -> None:
        """Add a person, who has to get a way (``people.walk``) before the next step.

        They exist, and may be moved, after the next step.
        """

    def move_person(self, name: str, x_m: float, y_m: float, /) -> object:
        """Put a person who exists on a point of a crosswalk's axis; see ``ENDS_M``.

        SUMO ends the process if the person does not exist.
        """
