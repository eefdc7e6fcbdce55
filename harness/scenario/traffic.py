"""The keys of ``[traffic]`` and of its vehicle mix, with their meaning and default."""

from typing import Annotated, Literal

from pydantic import Field

from harness.scenario.sections import EgoSection, NonNegative, Positive, Section, Share

Flow = Annotated[float, Field(ge=0, le=100_000)]


class VehicleTypeSection(Section):
    """``[[traffic.types]]``: a type of the vehicle mix.

    A key that is not given has the value of ``[ego]``.  v0, R0 and the detection range have the
    values of ``[ego]`` for every type.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=40)]
    """Name of the type in tables, e.g. `truck`: a letter, then letters, digits, `_` or `-`."""
    share: Share
    """Share of the vehicles; the shares of all types sum to 1."""
    length_m: Annotated[float, Field(ge=1, le=25)] | None = None
    """Length of its vehicles."""
    width_m: Annotated[float, Field(ge=0.5, le=5)] | None = None
    """Width of its vehicles."""
    max_acceleration_mps2: Annotated[float, Field(gt=0, le=20)] | None = None
    """Greatest acceleration that a strategy can command."""
    max_deceleration_mps2: Annotated[float, Field(gt=0, le=20)] | None = None
    """Greatest deceleration that a strategy can command; SUMO's car following has the same."""
    resume_acceleration_mps2: Annotated[float, Field(gt=0, le=20)] | None = None
    """a0: acceleration back to v0, also in SUMO's car following."""
    automated: bool = True
    """Whether its vehicles may be AVs; if not, `arms.human` drives them in both arms."""

    def vehicle_of(self, ego: EgoSection) -> EgoSection:
        """``[ego]`` with the values of this type."""
        given = self.model_dump(exclude={"name", "share", "automated"}, exclude_none=True)
        return ego.model_copy(update=given)


class TrafficSection(Section):
    """``[traffic]``: streams of vehicles over hours instead of one ego.

    ``following``, ``tau_s`` and ``min_gap_m`` are SUMO's car-following model and its parameters.
    """

    flow_per_hour: Flow = 600.0
    """Vehicles per hour in the ego's direction."""
    oncoming_per_hour: Flow = 600.0
    """Vehicles per hour in the oncoming direction."""
    av_share: Share = 1.0
    """Share of the vehicles that ``arms.av`` drives in the AV's arm; with ``types``, the share of
    the vehicles that may be AVs."""
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
    types: Annotated[tuple[VehicleTypeSection, ...], Field(strict=False)] = ()
    """The vehicle mix; if not given, every vehicle is the vehicle of ``[ego]``."""

    def has_vehicles(self, *, oncoming: bool) -> bool:
        """Whether any vehicles arrive in a direction."""
        flow = self.oncoming_per_hour if oncoming else self.flow_per_hour
        return self.saturated or flow > 0

    @property
    def shares(self) -> tuple[float, ...]:
        """The share of each type; 1 for the vehicle of ``[ego]`` if there is no mix."""
        return tuple(kind.share for kind in self.types) or (1.0,)
