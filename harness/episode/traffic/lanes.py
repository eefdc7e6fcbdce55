"""The lanes of a road with traffic, each with its own road frame."""

from dataclasses import dataclass
from enum import StrEnum

from harness.core.encounter import Crossing, Side
from harness.scenario import Scenario


class Direction(StrEnum):
    """Which way a vehicle drives: as the ego of an encounter, or towards it."""

    FORWARD = "forward"
    ONCOMING = "oncoming"

    @property
    def sign(self) -> float:
        """1 where its vehicles drive towards greater x of the ego's frame, −1 where not."""
        return 1.0 if self is Direction.FORWARD else -1.0


@dataclass(frozen=True, slots=True)
class Lane:
    """One lane, counted from the near kerb of its own direction.

    ``crossing`` is the crosswalk in the frame of the lane's own direction, which for oncoming
    vehicles is the ego's turned by 180°: their near kerb is the ego's far one.
    """

    direction: Direction
    index: int
    crossing: Crossing

    @property
    def name(self) -> str:
        """``forward-0`` and so on."""
        return f"{self.direction}-{self.index}"

    @property
    def centre_m(self) -> float:
        """y of the lane's centre in the ego's frame."""
        centre_m = self.crossing.lane_centre_m
        forward = self.direction is Direction.FORWARD
        return centre_m if forward else self.crossing.length_m - centre_m

    def own_side(self, side: Side) -> Side:
        """A kerb, named from the ego's direction, as vehicles of this lane name it."""
        return side if self.direction is Direction.FORWARD else side.other


def lanes_of(scenario: Scenario) -> tuple[Lane, ...]:
    """Every lane of the road, from the ego's near kerb of its direction on, oncoming ones last."""
    return tuple(
        Lane(direction, index, crossing)
        for direction in Direction
        for index, crossing in enumerate(
            scenario.crosswalk_from_lanes(oncoming=direction is Direction.ONCOMING)
        )
    )
