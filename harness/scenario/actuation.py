"""How vehicles obey: the section ``[actuation]``, and a vehicle's limits on a road."""

import math
from dataclasses import replace
from typing import Annotated

from pydantic import Field

from harness.core.actuation import GRAVITY_MPS2
from harness.core.encounter import Arm, Vehicle
from harness.scenario.sections import CrossingSection, Section


class ActuationSection(Section):
    """``[actuation]``: how late the AV's vehicle obeys commands; by default it obeys at once.

    With ``human = true`` the vehicle of the human's arm obeys as late.
    """

    dead_time_s: Annotated[float, Field(ge=0, le=5)] = 0.0
    """Time from a command until it begins to act; it need not be whole steps."""
    lag_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Time constant with which the acceleration then follows the command (first order)."""
    max_jerk_mps3: Annotated[float, Field(gt=0, le=10_000)] | None = None
    """Greatest rate at which the acceleration changes; if not given, only the lag limits it."""
    human: bool = False
    """Whether the vehicle of the human's arm obeys as late."""

    @property
    def is_off(self) -> bool:
        """Whether vehicles obey at once."""
        return self.model_copy(update={"human": False}) == ActuationSection()

    def applies_to(self, driver: Arm) -> bool:
        """Whether the vehicles of a driver obey late."""
        return not self.is_off and (driver is Arm.AV or self.human)


def on_road(vehicle: Vehicle, crossing: CrossingSection, *, oncoming: bool = False) -> Vehicle:
    """A vehicle with its limits on this road.

    With the angle α of the road and its friction μ it brakes with at most
    min(b, μ g cos α) + g sin α and accelerates with at most min(a, μ g cos α) − g sin α.
    """
    friction = crossing.friction
    if not crossing.grade and friction is None:
        return vehicle
    angle = math.atan(-crossing.grade if oncoming else crossing.grade)
    grip = math.inf if friction is None else friction * GRAVITY_MPS2 * math.cos(angle)
    slope = GRAVITY_MPS2 * math.sin(angle)
    most = min(vehicle.max_acceleration_mps2, grip) - slope
    return replace(
        vehicle,
        max_acceleration_mps2=most,
        max_deceleration_mps2=min(vehicle.max_deceleration_mps2, grip) + slope,
        resume_acceleration_mps2=min(vehicle.resume_acceleration_mps2, most),
    )
