"""Every key of ``[pedestrians]`` with its meaning and default: who comes, and how they decide."""

from statistics import NormalDist
from typing import Annotated, Literal, cast

from pydantic import Field

from harness.core.encounter import Behaviour
from harness.core.seeding import GIVEN_DRAWS, Given
from harness.scenario.sections import NonNegative, Positive, Section, Share

SLOWEST_MPS = 0.3
"""Nobody who is drawn from ``[pedestrians.walking_speed]`` walks slower."""


class TimedSection(Section):
    """``[[pedestrians.timed]]``: someone whom a car that never brakes would hit."""

    name: str = ""
    """Name by which ``timed_case`` picks it."""
    side: Literal["near", "far"]
    """The kerb they come from."""
    start_lateral_m: Positive
    """Distance from the car's centre line to where they stand: clear of the car, at most 8 m before
    the kerb."""
    acceleration_distance_m: NonNegative = 0.0
    """Distance over which they reach their speed."""
    speed_mps: Annotated[float, Field(gt=0, le=10)]
    """Speed at which they walk."""
    impact_share: Share
    """Where a car that never brakes hits them: 0 at the edge they reach first, 1 at the other."""


class GapAcceptanceSection(Section):
    """``[pedestrians.gap_acceptance]``: the distribution of critical gaps."""

    distribution: Literal["lognormal", "logistic"] = "lognormal"
    """Kind of the distribution of critical gaps."""
    mean_s: Positive = 4.0
    """Mean of the critical gaps."""
    std_s: NonNegative = 2.5
    """Standard deviation of the critical gaps."""


Uniforms = Annotated[tuple[Annotated[float, Field(gt=0, lt=1)], ...], Field(strict=False)]


class DrawnSection(Section):
    """``[[pedestrians.drawn]]``: the people of one pair, as ``harness risk`` found them.

    ``episode`` keys the streams of everything that is not given; the lists hold the uniforms of the
    first pedestrians, and those that a strategy draws first, in the place of those streams' first
    draws.
    """

    episode: Annotated[int, Field(ge=0)]
    """The number of the episode."""
    arrival: Uniforms = ()
    """Uniforms of the times between arrivals."""
    side: Uniforms = ()
    """Uniforms of the kerbs."""
    quantile: Uniforms = ()
    """Uniforms of the walking speeds."""
    critical_gap: Uniforms = ()
    """Uniforms of the critical gaps."""
    detection: Uniforms = ()
    """Uniforms of the looks until the first detection."""
    timed_detection: Uniforms = ()
    """Uniforms of the looks until the first detection of people with a timetable."""
    redetection: Uniforms = ()
    """Uniforms of the looks until each is found again after the first loss."""
    perception_error: Uniforms = ()
    """Uniforms of the first errors of each, two by two: of their place and of their speed."""
    strategy: Annotated[Uniforms, Field(max_length=GIVEN_DRAWS)] = ()
    """What the strategy of ``arms.human``, or of both arms where they are alike, draws first."""
    av_strategy: Annotated[Uniforms, Field(max_length=GIVEN_DRAWS)] = ()
    """What the strategy of ``arms.av`` draws first."""

    @property
    def uniforms(self) -> Given:
        """By purpose of the stream."""
        return cast(Given, self.model_dump(exclude={"episode"}))


class WalkingSpeedSection(Section):
    """``[pedestrians.walking_speed]``: a normal distribution in the interaction model's place.

    It is cut off at ``SLOWEST_MPS``; mean and standard deviation are those before the cut.
    """

    mean_mps: Annotated[float, Field(ge=0.5, le=3)]
    """Mean before the cut at 0.3 m/s."""
    std_mps: Annotated[float, Field(gt=0, le=1)] = 0.25
    """Standard deviation before the cut."""

    def at(self, quantile: float) -> float:
        """The walking speed at a quantile in [0, 1), in m/s."""
        normal = NormalDist(self.mean_mps, self.std_mps)
        below = normal.cdf(SLOWEST_MPS)
        share = below + quantile * (1 - below)
        return max(SLOWEST_MPS, normal.inv_cdf(share)) if share > 0 else SLOWEST_MPS


class PedestriansSection(Section):
    """``[pedestrians]``: the people who come, from where, how they decide and walk."""

    flow_per_hour: Annotated[float, Field(ge=0, le=100_000)] = 250.0
    """λ, both kerbs together."""
    max_count: Annotated[int, Field(ge=0)] | None = None
    """At most so many come; without it, no limit."""
    first_at_trigger: bool = False
    """The first is at the kerb at t = 0."""
    near_side_share: Share = 0.5
    """Share of people who come from the near kerb."""
    kerb_wait_s: NonNegative = 2.0
    """Nobody steps off when a vehicle would reach the crosswalk within this time, and does not stop
    before it."""
    warm_up_s: Annotated[float, Field(ge=0, le=3600)] = 0.0
    """The flow begins so long before the trigger; 0 beside ``[traffic]``."""
    behaviour: Behaviour = "constant"
    """How they decide and walk."""
    gap_acceptance: GapAcceptanceSection = GapAcceptanceSection()
    """Gaps for which people wait, with behaviour ``gap_acceptance``."""
    walking_speed: WalkingSpeedSection | None = None
    """A normal distribution in the interaction model's place; without it, the model."""
    timed: Annotated[tuple[TimedSection, ...], Field(strict=False)] = ()
    """People whom a car that never brakes would hit."""
    timed_case: str | None = None
    """A ``name`` of ``timed``: only those come; without it, all."""
    drawn: Annotated[tuple[DrawnSection, ...], Field(strict=False)] = ()
    """The people of each pair by their uniforms; ``harness risk`` writes them."""
