"""Every measure of an encounter, one attribute each, which is a column.

To add a measure, write a function of a chunk in one of this package's files and an attribute of
``Measured`` here.  Tables, statistics, the check of docs/measures.md and the conformance tests use
it.
"""

from collections.abc import Callable
from dataclasses import Field, dataclass, field, fields, replace
from operator import attrgetter
from typing import Any, Literal, ParamSpec, get_args

from harness.core.vocabulary import FloatArray
from harness.measures import avoidable as prevention, braking, conflicts, efficiency
from harness.measures.chunk import Chunk

_Given = ParamSpec("_Given")


@dataclass(frozen=True, slots=True)
class Measure:
    """A measure of an episode, for either arm.

    Attributes:
        compute: returns a value for each trace of a chunk, NaN if it is undefined.  Each value
            depends only on that trace, to the last bit.
        on_step: how the value depends on the length of a step.  ``exact``: it does not.
            ``states``: it is an extreme over the states, and shorter steps have more states.
            ``steps``: it is a number of steps.
        worse: whether small or large values are bad; None if neither.  In a measure of conflicts a
            crash is worse than every value.
        column, kind: name and type of its attribute in ``Measured``.
    """

    compute: Callable[[Chunk], FloatArray]
    unit: str
    formula: str
    about: Literal["conflict", "time", "comfort", "other"]
    undefined_when: str
    on_step: Literal["exact", "states", "steps"] = "exact"
    worse: Literal["small", "large"] | None = None
    source: str = ""
    column: str = ""
    kind: type[float] | type[int] | type[bool] = float


def _attribute_with(make: Callable[_Given, Measure]) -> Callable[_Given, Any]:
    """Makes attributes with a measure as their metadata, from the arguments of ``make``."""

    def attribute(*args: _Given.args, **kwargs: _Given.kwargs) -> Any:
        return field(metadata={"measure": make(*args, **kwargs)})

    return attribute


_measured = _attribute_with(Measure)


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The measures of an episode, each with its definition; undefined values are None."""

    pass_time_s: float | None = _measured(
        attrgetter("pass_time_s"),
        "s",
        "time at which the rear bumper reaches x = width/2, solved inside the step",
        about="time",
        undefined_when="the ego did not cross",
        worse="large",
        source='the paper\'s "time used"',
    )
    contact_speed_mps: float | None = _measured(
        conflicts.contact_speed_mps,
        "m/s",
        "the ego's speed at the contact",
        about="conflict",
        undefined_when="no contact",
        worse="large",
    )
    min_gap_m: float | None = _measured(
        conflicts.min_gap_m,
        "m",
        "smallest distance between the ego's rectangle and the pedestrian's disc, over the "
        "states; 0 if they touch",
        about="conflict",
        undefined_when="nobody stepped off",
        on_step="states",
        worse="small",
    )
    min_ttc_s: float | None = _measured(
        conflicts.min_ttc_s,
        "s",
        "smallest TTC over the states: the time until the rectangle meets the disc if both keep "
        "their velocities; 0 if they touch",
        about="conflict",
        undefined_when="never on a collision course",
        on_step="states",
        worse="small",
        source="Hayward 1972, for a rectangle and a disc",
    )
    min_time_advantage_s: float | None = _measured(
        conflicts.min_time_advantage_s,
        "s",
        "smallest abs(R/v − L/v_p) while R > 0, L > 0 and both are at 0.1 m/s or faster",
        about="conflict",
        undefined_when="no such state",
        on_step="states",
        worse="small",
        source="the paper's (tadv); Laureshyn 2010",
    )
    pet_s: float | None = _measured(
        conflicts.pet_s,
        "s",
        "time from the first road user's exit from the conflict area to the second's entry; "
        "smallest over pedestrians",
        about="conflict",
        undefined_when="a crash, or one of the two never enters the area",
        worse="small",
        source="Allen, Shin, Cooper 1978",
    )
    max_deceleration_mps2: float | None = _measured(
        braking.max_deceleration_mps2,
        "m/s²",
        "largest −Δv/Δt over the steps; 0 if it never braked",
        about="comfort",
        undefined_when="the record has no step",
        worse="large",
    )
    stops: int | None = _measured(
        efficiency.stops,
        "",
        "number of times the speed at a step's end falls below 0.1 m/s",
        about="comfort",
        undefined_when="the record has no step",
        on_step="steps",
        worse="large",
        source="SUMO's waiting-time threshold",
    )
    stopped_s: float | None = _measured(
        efficiency.stopped_s,
        "s",
        "number of steps that end below 0.1 m/s, times the length of a step",
        about="comfort",
        undefined_when="the record has no step",
        on_step="steps",
        worse="large",
        source="SUMO's waiting-time threshold",
    )
    delay_s: float | None = _measured(
        efficiency.delay_s,
        "s",
        "pass time − (R0 + length + width/2)/v0",
        about="time",
        undefined_when="the ego did not cross",
        worse="large",
        source="HCM: delay against the free pass time",
    )
    max_drac_mps2: float | None = _measured(
        braking.max_drac_mps2,
        "m/s²",
        "largest DRAC over the states on a collision course with the front: 2 (v − d/T)/T if v T "
        "≤ 2 d, else v²/(2 d)",
        about="conflict",
        undefined_when="a crash, or never on such a collision course",
        on_step="states",
        worse="large",
        source="Cooper, Ferguson 1976; Archer 2005; for crossing paths as SUMO's SSM device",
    )
    required_deceleration_mps2: float | None = _measured(
        braking.required_deceleration_mps2,
        "m/s²",
        "v²/(2 d) at the first sight of a pedestrian; largest over pedestrians",
        about="conflict",
        undefined_when="nobody on a collision course with the front at first sight",
        on_step="states",
        worse="large",
        source="constant deceleration to a stop at distance d",
    )
    max_jerk_mps3: float | None = _measured(
        braking.max_jerk_mps3,
        "m/s³",
        "largest abs(Δa)/Δt between successive steps; a = 0 before the trigger",
        about="comfort",
        undefined_when="the record has no step",
        on_step="steps",
        worse="large",
        source="finite difference",
    )
    avoidable: bool | None = _measured(
        prevention.avoidable,
        "",
        "whether full braking from the pedestrian's step-off on would have prevented the contact",
        about="conflict",
        undefined_when="no contact",
        source="after UN Regulation 157: was the collision preventable?",
    )
    pedestrian_delay_s: float | None = _measured(
        efficiency.pedestrian_delay_s,
        "s",
        "mean wait at the kerb of the pedestrians who arrived within the record; timed "
        "pedestrians do not count",
        about="comfort",
        undefined_when="nobody arrived",
        worse="large",
        source="HCM: pedestrian delay",
    )
    arrivals: int | None = _measured(
        efficiency.arrivals,
        "",
        "number of pedestrians who arrived within the record; timed pedestrians do not count",
        about="other",
        undefined_when="the record has no state",
    )
    pass_time_ignoring_contact_s: float | None = _measured(
        attrgetter("pass_time_ignoring_contact_s"),
        "s",
        "the pass time if contacts are ignored: the simulation continues after a contact",
        about="time",
        undefined_when="the rear bumper never left the far edge",
    )
    max_speed_mps: float | None = _measured(
        efficiency.max_speed_mps,
        "m/s",
        "largest speed within the record",
        about="other",
        undefined_when="the record has no step",
    )
    avoidable_attentive: bool | None = _measured(
        prevention.avoidable_attentive,
        "",
        "whether an attentive human driver would have avoided the contact, taking over at the "
        "pedestrian's step-off",
        about="conflict",
        undefined_when="no contact",
        source="UN Regulation 157: the competent and careful human driver",
    )
    rms_acceleration_mps2: float | None = _measured(
        braking.rms_acceleration_mps2,
        "m/s²",
        "root mean square of Δv/Δt over the steps",
        about="comfort",
        undefined_when="the record has no step",
        on_step="steps",
        worse="large",
        source="ISO 2631-1 for the root mean square, here without its frequency weighting",
    )
    rms_jerk_mps3: float | None = _measured(
        braking.rms_jerk_mps3,
        "m/s³",
        "root mean square of Δa/Δt over the steps; a = 0 before the trigger",
        about="comfort",
        undefined_when="the record has no step",
        on_step="steps",
        worse="large",
        source="finite difference",
    )


def _entry(attribute: Field[Any]) -> Measure:
    kind: Any = next(iter(get_args(attribute.type)), attribute.type)
    measure: Measure = attribute.metadata["measure"]
    return replace(measure, column=attribute.name, kind=kind)


MEASURES = tuple(map(_entry, fields(Measured)))
"""Every measure, in the order of the columns."""

COLUMNS = tuple(measure.column for measure in MEASURES)
