"""Every measure, in one table.

A new measure is a function of a chunk in one of this package's files and an entry here; tables,
statistics, docs/measures.md's check and the conformance tests follow.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from harness.encounter import FloatArray
from harness.measures import avoidable, braking, collision, efficiency, encroachment, proximity
from harness.measures.chunk import Chunk


@dataclass(frozen=True, slots=True)
class Measure:
    """One number of an episode, for either arm.

    ``compute`` gives one value for each trace of a chunk, NaN where undefined; each depends on
    that trace alone, to the last bit.  ``kind`` is the type it is kept as.  ``on_step`` says what
    the length of a step does to it: nothing (``exact``); it is an extreme over states, of which a
    shorter step has more (``states``); or it is counted in steps (``steps``).  ``worse`` says which
    values are the bad ones, None where neither end is; by a measure of conflicts a crash is worse
    than every value.
    """

    column: str
    unit: str
    kind: type[float] | type[int] | type[bool]
    formula: str
    undefined_when: str
    source: str
    on_step: Literal["exact", "states", "steps"]
    about: Literal["conflict", "time", "comfort", "other"]
    worse: Literal["small", "large"] | None
    compute: Callable[[Chunk], FloatArray]


MEASURES = (
    Measure(
        "pass_time_s",
        "s",
        float,
        "time at which the rear bumper reaches x = width/2, solved inside the step",
        "the ego did not cross",
        'the paper\'s "time used"',
        "exact",
        "time",
        "large",
        efficiency.pass_time_s,
    ),
    Measure(
        "contact_speed_mps",
        "m/s",
        float,
        "the ego's speed at the contact",
        "no contact",
        "",
        "exact",
        "conflict",
        "large",
        collision.contact_speed_mps,
    ),
    Measure(
        "min_gap_m",
        "m",
        float,
        "smallest distance of the ego's rectangle and the pedestrian's disc over the states; "
        "0 after a contact",
        "nobody stepped off",
        "",
        "states",
        "conflict",
        "small",
        proximity.min_gap_m,
    ),
    Measure(
        "min_ttc_s",
        "s",
        float,
        "smallest TTC over the states: time until the rectangle meets the disc (radius 0.25 m) "
        "if both keep their velocities; 0 after a contact",
        "never on a collision course",
        "Hayward 1972, for a rectangle and a disc",
        "states",
        "conflict",
        "small",
        proximity.min_ttc_s,
    ),
    Measure(
        "min_time_advantage_s",
        "s",
        float,
        "smallest abs(R/v − L/v_p) while R > 0, L > 0 and v > 0",
        "no such state",
        "the paper's (tadv); Laureshyn 2010",
        "states",
        "conflict",
        "small",
        proximity.min_time_advantage_s,
    ),
    Measure(
        "pet_s",
        "s",
        float,
        "from one road user leaving the contact zone to the other entering it, smallest over "
        "pedestrians; zone: ego's width × disc, wherever they walk along the road. They go on "
        "after the record's end; 0 where both are in it at once without touching (a corner)",
        "crash, or one of the two never enters",
        "Allen, Shin, Cooper 1978",
        "exact",
        "conflict",
        "small",
        encroachment.pet_s,
    ),
    Measure(
        "max_deceleration_mps2",
        "m/s²",
        float,
        "largest −Δv/Δt over the steps; 0 if it never braked",
        "never",
        "",
        "exact",
        "comfort",
        "large",
        braking.max_deceleration_mps2,
    ),
    Measure(
        "stops",
        "",
        int,
        "number of times the speed at a step's end falls below 0.1 m/s",
        "never",
        "SUMO's waiting-time threshold",
        "steps",
        "comfort",
        "large",
        efficiency.stops,
    ),
    Measure(
        "stopped_s",
        "s",
        float,
        "number of steps that end below 0.1 m/s × step",
        "never",
        "SUMO's waiting-time threshold",
        "steps",
        "comfort",
        "large",
        efficiency.stopped_s,
    ),
    Measure(
        "delay_s",
        "s",
        float,
        "pass time − (R0 + length + width/2)/v0",
        "the ego did not cross",
        "HCM: delay against the free pass time",
        "exact",
        "time",
        "large",
        efficiency.delay_s,
    ),
    Measure(
        "max_drac_mps2",
        "m/s²",
        float,
        "largest DRAC over the states on a collision course with the front: the least constant "
        "deceleration with which the bumper reaches the disc, d ahead, no sooner than it has left "
        "the ego's path, T from now: 2 (v − d/T)/T if v T ≤ 2 d, else v²/(2 d)",
        "crash (it grows without bound), or never on such a course",
        "Cooper, Ferguson 1976; Archer 2005; for crossing paths as SUMO's SSM device",
        "states",
        "conflict",
        "large",
        braking.max_drac_mps2,
    ),
    Measure(
        "required_deceleration_mps2",
        "m/s²",
        float,
        "v²/(2 d) at first sight: the first state with the pedestrian stepped off and the ego "
        "within its detection range; largest over pedestrians",
        "nobody on a collision course with the front at first sight",
        "constant deceleration to a stop at distance d",
        "states",
        "conflict",
        "large",
        braking.required_deceleration_mps2,
    ),
    Measure(
        "max_jerk_mps3",
        "m/s³",
        float,
        "largest abs(Δa)/Δt from one step to the next, a = 0 before the trigger",
        "never",
        "finite difference: a value for that length of step",
        "steps",
        "comfort",
        "large",
        braking.max_jerk_mps3,
    ),
    Measure(
        "avoidable",
        "",
        bool,
        "whether full braking (`max_deceleration_mps2`) from the moment the pedestrian stepped off "
        "would have prevented the contact, who walks as in the run; solved exactly",
        "no contact",
        "after UN Regulation 157: was the collision preventable?",
        "exact",
        "conflict",
        None,
        avoidable.avoidable,
    ),
    Measure(
        "pedestrian_delay_s",
        "s",
        float,
        "mean over those who arrived within the record, timed ones apart, of the wait at the kerb, "
        "until stepping off or the record's end",
        "nobody arrived",
        "HCM: pedestrian delay",
        "exact",
        "comfort",
        "large",
        efficiency.pedestrian_delay_s,
    ),
    Measure(
        "arrivals",
        "",
        int,
        "number of people who arrived within the record, timed ones apart",
        "never",
        "",
        "exact",
        "other",
        None,
        efficiency.arrivals,
    ),
    Measure(
        "pass_time_ignoring_contact_s",
        "s",
        float,
        "the pass time had nobody been touched: the simulation goes on past a contact",
        "the rear bumper never left the far edge",
        "",
        "exact",
        "time",
        None,
        efficiency.pass_time_ignoring_contact_s,
    ),
    Measure(
        "max_speed_mps",
        "m/s",
        float,
        "largest speed within the record",
        "failed before its first step",
        "",
        "exact",
        "other",
        None,
        efficiency.max_speed_mps,
    ),
)

COLUMNS = tuple(measure.column for measure in MEASURES)
