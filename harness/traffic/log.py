"""The record of an hour while it is simulated."""

from dataclasses import dataclass, field

from harness.encounter import Walk
from harness.scenario import TrafficSection
from harness.traffic.vehicles import HourVehicle

LEAST_CLEARING_S = 900.0


@dataclass(slots=True)
class HourLog:
    """The events of an hour; times are steps from the beginning of the warm-up.

    ``queues`` has, for each second of the counted time, the queued vehicles of each lane.
    ``let_go``: of each who had to wait, whether the first vehicle that kept them waiting let them
    go.
    """

    vehicles: list[HourVehicle] = field(default_factory=list)
    walks: list[Walk] = field(default_factory=list)
    queues: list[list[int]] = field(default_factory=list)
    let_go: dict[int, bool] = field(default_factory=dict)
    last_step: int = 0


def clearing_s(traffic: TrafficSection) -> float:
    """How long after the counted time the road may take to empty; a permanent queue never does."""
    return 0.0 if traffic.saturated else max(traffic.duration_s, LEAST_CLEARING_S)
