"""The keys of ``[pedestrians]``: who comes, when they step off, and how fast they walk."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from itertools import accumulate
from statistics import NormalDist
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PlainSerializer

from harness.core.documents import NonNegative, Positive, Share, as_plain
from harness.core.freezing import frozen
from harness.core.seeding import Purpose
from harness.core.vocabulary import Behaviour
from harness.scenario.sections import ENCOUNTERS, Flow, Only, Section

SLOWEST_MPS = 0.3
"""Least walking speed that is drawn from ``[pedestrians.walking_speed]``."""


_GAPS = Only("with behaviour gap_acceptance", lambda s: s.pedestrians.behaviour == "gap_acceptance")
_KERB = Only("with another behaviour than gap_acceptance", lambda s: not _GAPS.holds(s))
_THRESHOLDS = Only("with behaviour threshold", lambda s: s.pedestrians.behaviour == "threshold")
_COME = Only(
    "with flow_per_hour or first_at_trigger, beside timed people or SUMO's",
    lambda s: s.pedestrians.anyone_comes or not (s.pedestrians.timed or s.simulation),
)
_MORE = Only("if max_count lets more come than the first", lambda s: s.pedestrians.more_come)


class TimedSection(Section):
    """``[[pedestrians.timed]]``: a pedestrian timed so that a car that never brakes hits them."""

    name: str = ""
    """Name of this case, for ``timed_case``."""
    side: Literal["near", "far"]
    """The kerb they come from."""
    start_lateral_m: Positive
    """Distance from the car's centre line to their starting point, which is clear of the car and at
    most ``MAX_BEFORE_KERB_M`` before the kerb."""
    acceleration_distance_m: NonNegative = 0.0
    """Distance over which they accelerate to their speed."""
    speed_mps: Annotated[float, Field(gt=0, le=10)]
    """Their walking speed after that."""
    impact_share: Share
    """Point of impact on the front of a car that never brakes, as a share of its width: 0 at the
    edge that they reach first, 1 at the other."""


class GapAcceptanceSection(Section):
    """``[pedestrians.gap_acceptance]``: the distribution of critical gaps."""

    distribution: Annotated[Literal["lognormal", "logistic"], _GAPS] = "lognormal"
    """Family of the distribution of critical gaps."""
    mean_s: Annotated[Positive, _GAPS] = 4.0
    """Mean of the critical gaps."""
    std_s: Annotated[NonNegative, _GAPS] = 2.5
    """Standard deviation of the critical gaps."""


LogMean = Annotated[float, Field(ge=-10, le=10)]
"""The mean of a logarithm."""
LogSpread = Annotated[float, Field(ge=0, le=5)]
"""The standard deviation of a logarithm."""
Shares = Annotated[tuple[Share, ...], Field(strict=False, min_length=1)]
"""The shares of the groups of 1, 2, 3 … pedestrians."""
WalkingMean = Annotated[float, Field(ge=0.5, le=3)]
"""The mean of walking speeds, in m/s."""
WalkingSpread = Annotated[float, Field(gt=0, le=1)]
"""The standard deviation of walking speeds, in m/s."""


class ThresholdSection(Section):
    """``[pedestrians.threshold]``: when people decide to cross, with behaviour ``threshold``.

    The defaults are those of the threshold-distribution model in Pekkanen et al. 2022
    (Computational Brain & Behavior 5).
    """

    log_mean: Annotated[LogMean, _THRESHOLDS] = 1.430
    """Mean of ln θ, with the threshold θ in s; the median of θ is 4.18 s."""
    log_sd: Annotated[LogSpread, _THRESHOLDS] = 0.405
    """Standard deviation of ln θ."""
    factor: Annotated[float, Field(gt=0, le=10), _THRESHOLDS] = 1.0
    """Factor on every threshold: 1 as measured at a road without a marked crosswalk; below 1 people
    are bolder."""
    latency_log_mean: Annotated[LogMean, _THRESHOLDS] = 0.0166
    """Mean of ln l, with the latency l in s from decision to first step; the median of l is 1.02
    s."""
    latency_log_sd: Annotated[LogSpread, _THRESHOLDS] = 0.604
    """Standard deviation of ln l."""
    distance_weight: Annotated[NonNegative, _THRESHOLDS] = 0.252
    """c_d: weight of the distance, expressed as the time at 50 km/h, against the time to
    arrival."""
    slowing_weight_s: Annotated[NonNegative, _THRESHOLDS] = 1.40
    """c_b: how much a vehicle that slows down is preferred."""
    passed_s: Annotated[NonNegative, _THRESHOLDS] = 0.373
    """c_p: a vehicle whose time to arrival is shorter counts as past."""


def _kerb_wait_s(keys: dict[str, Any]) -> float:
    """The default of ``kerb_wait_s``, which depends on the behaviour."""
    return 0.0 if keys.get("behaviour") == "threshold" else 2.0


_First = Annotated[tuple[Annotated[float, Field(gt=0, lt=1)], ...], Field(strict=False)]
_Uniforms = Annotated[Mapping[Purpose, _First], AfterValidator(frozen), PlainSerializer(as_plain)]


class DrawnSection(Section):
    """``[[pedestrians.drawn]]``: the pedestrians of one pair; ``harness risk`` writes them.

    They replace the first draws of the random streams.  Later draws come from the streams of
    ``episode``.
    """

    episode: Annotated[int, Field(ge=0)]
    """Number of the episode whose random streams supply all other draws."""
    uniforms: _Uniforms = Field(default_factory=lambda: frozen({}))
    """First uniforms of each stream: of ``perception_error`` two for each pedestrian (position,
    speed), of ``strategy`` and ``av_strategy`` those of the arms (of both ``strategy`` if they have
    the same one), of all others one for each pedestrian."""


class WalkingClassSection(Section):
    """``[[pedestrians.walking_speed.classes]]``: people who walk slower or faster than the others.

    Their distribution is truncated as in ``[pedestrians.walking_speed]``.
    """

    share: Share
    """Share of the pedestrians; the shares of all classes sum to at most 1."""
    mean_mps: WalkingMean
    """Mean before truncation at ``SLOWEST_MPS``."""
    std_mps: WalkingSpread = 0.25
    """Standard deviation before truncation."""


class WalkingSpeedSection(Section):
    """``[pedestrians.walking_speed]``: a normal distribution instead of the interaction model.

    It is truncated at ``SLOWEST_MPS``; mean and standard deviation are those before truncation.
    """

    mean_mps: Annotated[WalkingMean, _COME]
    """Mean before truncation at ``SLOWEST_MPS``."""
    std_mps: WalkingSpread = 0.25
    """Standard deviation before truncation."""
    classes: Annotated[tuple[WalkingClassSection, ...], Field(strict=False)] = ()
    """Classes of pedestrians, e.g. children and older people; all others have the values above."""

    def at(self, quantile: float, walking_class: int | None = None) -> float:
        """The walking speed at a quantile in [0, 1), in m/s, of a class or of all others."""
        people = self if walking_class is None else self.classes[walking_class]
        normal = NormalDist(people.mean_mps, people.std_mps)
        below = normal.cdf(SLOWEST_MPS)
        share = below + quantile * (1 - below)
        return max(SLOWEST_MPS, normal.inv_cdf(share)) if share > 0 else SLOWEST_MPS


_MARKS: Mapping[Behaviour, tuple[Purpose, ...]] = {
    "gap_acceptance": ("critical_gap",),
    "threshold": ("threshold", "latency"),
}
"""What a behaviour draws for each pedestrian or group."""


class PedestriansSection(Section):
    """``[pedestrians]``: the flow of pedestrians, their kerbs, decisions and walking speeds."""

    flow_per_hour: Annotated[Flow, _MORE] = 250.0
    """λ, pedestrians per hour from both kerbs together; with ``[simulation]``, if not given, 0."""
    group_size: Annotated[Shares, _COME, _MORE] = (1.0,)
    """Shares of the groups that have 1, 2, 3 … pedestrians; they sum to 1."""
    max_count: Annotated[Annotated[int, Field(ge=0)] | None, _COME] = None
    """Greatest number of pedestrians; if not given, there is no limit."""
    first_at_trigger: Annotated[bool, ENCOUNTERS] = False
    """Whether the first pedestrian or group arrives at the kerb at t = 0."""
    near_side_share: Annotated[Share, _COME] = 0.5
    """Share of pedestrians or groups that come from the near kerb (in `[simulation]`: from the
    begin of the crosswalk's axis)."""
    behaviour: Annotated[Behaviour, _COME] = "constant"
    """Rule by which pedestrians decide and walk (docs/method.md)."""
    kerb_wait_s: Annotated[NonNegative, _COME, _KERB] = Field(default_factory=_kerb_wait_s)
    """Nobody steps off if a vehicle that does not stop would reach the crosswalk within this time;
    if not given, 0 with behaviour ``threshold``."""
    warm_up_s: Annotated[float, Field(ge=0, le=3600), ENCOUNTERS, _COME] = 0.0
    """The flow begins this long before the trigger."""
    gap_acceptance: GapAcceptanceSection = GapAcceptanceSection()
    """Critical gaps, with behaviour ``gap_acceptance``."""
    threshold: ThresholdSection = ThresholdSection()
    """Thresholds and latencies, with behaviour ``threshold``."""
    walking_speed: WalkingSpeedSection | None = None
    """Normal distribution of walking speeds; if not given, the interaction model gives them."""
    timed: Annotated[tuple[TimedSection, ...], Field(strict=False), ENCOUNTERS] = ()
    """Pedestrians timed so that a car that never brakes hits them."""
    timed_case: str | None = None
    """``name`` of the timed pedestrians to simulate; if not given, all of ``timed``."""
    drawn: Annotated[tuple[DrawnSection, ...], Field(strict=False), ENCOUNTERS] = ()
    """Pedestrians of each pair by their uniforms; ``harness risk`` writes them."""

    @property
    def anyone_comes(self) -> bool:
        """Whether anybody comes apart from timed and drawn pedestrians."""
        return (self.flow_per_hour > 0 or self.first_at_trigger) and self.max_count != 0

    @property
    def more_come(self) -> bool:
        """Whether ``max_count`` lets more come than the first at the trigger."""
        most = self.max_count
        return most is None or most > self.first_at_trigger or self.warm_up_s > 0

    @property
    def marks(self) -> tuple[Purpose, ...]:
        """What is drawn for each pedestrian or group, besides their arrival and detection."""
        classes: tuple[Purpose, ...] = ("walking_class",) if self.walking_classes else ()
        return ("side", "quantile", *classes, *_MARKS.get(self.behaviour, ()))

    @property
    def walking_classes(self) -> tuple[WalkingClassSection, ...]:
        """The classes of walking speeds."""
        return () if self.walking_speed is None else self.walking_speed.classes

    def walking_class_at(self, uniform: float) -> int | None:
        """The number of a pedestrian's class from a uniform in [0, 1); None for all others."""
        number = _place([kind.share for kind in self.walking_classes], uniform)
        return number if number < len(self.walking_classes) else None

    @property
    def mean_group_size(self) -> float:
        """The mean number of pedestrians in a group."""
        return sum(size * share for size, share in enumerate(self.group_size, 1))

    def group_size_at(self, uniform: float) -> int:
        """The number of pedestrians in a group from a uniform in [0, 1)."""
        return 1 + _place(self.group_size[:-1], uniform)


def _place(shares: Sequence[float], uniform: float) -> int:
    """The place of a uniform in [0, 1) among shares; their number if it is above their sum."""
    return bisect_right([*accumulate(shares)], uniform)
