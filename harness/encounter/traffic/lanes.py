"""The lanes of a road with traffic, each with its own road frame."""

from dataclasses import dataclass
from enum import StrEnum

from harness.core.encounter import Crossing, Side
from harness.scenario import Scenario


class Direction(StrEnum):
    """The direction of travel: the ego's in an encounter, or the opposite."""

    FORWARD = "forward"
    ONCOMING = "oncoming"

    @property
    def sign(self) -> float:
        """1 for vehicles that drive in the direction of x in the ego's frame, else −1."""
        return 1.0 if self is Direction.FORWARD else -1.0


@dataclass(frozen=True, slots=True)
class Lane:
    """A lane; ``index`` counts from the near kerb of its own direction.

    ``crossing`` is the crosswalk in the frame of the lane's own direction.  For oncoming lanes that
    is the ego's frame turned by 180°, so their near kerb is the ego's far kerb.
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
        """The side of a kerb as seen in this lane's direction, from the side that the ego sees."""
        return side if self.direction is Direction.FORWARD else side.other


def lanes_of(scenario: Scenario) -> tuple[Lane, ...]:
    """All lanes of the road, from the near kerb of each direction; oncoming lanes come last."""
    return tuple(
        Lane(direction, index, crossing)
        for direction in Direction
        for index, crossing in enumerate(
            scenario.crosswalk_from_lanes(oncoming=direction is Direction.ONCOMING)
        )
    )
