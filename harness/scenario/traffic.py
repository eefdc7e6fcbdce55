"""The keys of ``[traffic]``, with their meaning and default."""

from typing import Annotated, Literal

from pydantic import Field

from harness.core.documents import NonNegative, Positive, Share
from harness.scenario.sections import Flow, Only, Section

_UNSATURATED = Only("without traffic.saturated", lambda s: not s.traffic.saturated)


class TrafficSection(Section):
    """``[traffic]``: streams of vehicles like ``[ego]`` in a simulation.

    ``following``, ``tau_s`` and ``min_gap_m`` are SUMO's car-following model and its parameters.
    """

    flow_per_hour: Annotated[Flow, _UNSATURATED] = 600.0
    """Vehicles per hour in the ego's direction."""
    oncoming_per_hour: Annotated[Flow, _UNSATURATED] = 600.0
    """Vehicles per hour in the oncoming direction."""
    av_share: Share = 1.0
    """Share of the vehicles that ``arms.av`` drives in the AV's arm."""
    duration_s: Annotated[float, Field(gt=0, le=7 * 86_400)] = 3600.0
    """Duration over which vehicles and pedestrians are counted; whole steps."""
    warm_up_s: Annotated[float, Field(ge=0, le=86_400)] = 300.0
    """Duration that is simulated before ``duration_s`` and not counted; whole steps."""
    following: Literal["Krauss", "IDM"] = "Krauss"
    """SUMO's car-following model."""
    tau_s: Positive = 1.0
    """Headway of the car-following model; at least one step."""
    min_gap_m: NonNegative = 2.0
    """Gap of the car-following model to a stopped leader."""
    saturated: bool = False
    """Keep a vehicle waiting in every lane at all times, which measures the capacity."""
