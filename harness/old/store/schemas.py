"""The schemas of a run's tables, and which tables a kind of run has.

The columns are described in docs/files.md.  Schemas are fixed; a missing value is null, never 0, -1
or infinity.
"""

import pyarrow as pa

from harness.core.encounter import Leg
from harness.measures import MEASURES

SCHEMA = 4
"""Version of the run folder's format."""

_KEYS = [("cell", pa.int32()), ("pair", pa.int64()), ("arm", pa.string())]

_TYPES = {float: pa.float64(), int: pa.int32(), bool: pa.bool_()}
_MEASURES = {measure.column: _TYPES[measure.kind] for measure in MEASURES}
_FACTS = {
    "strategy": pa.string(),
    "ending": pa.string(),
    "reason": pa.string(),
    "pass_time_s": _MEASURES["pass_time_s"],
    "contact": pa.string(),
    "contact_index": pa.int32(),
    "contact_time_s": pa.float64(),
    "contact_speed_mps": _MEASURES["contact_speed_mps"],
    "sumo_collision": pa.bool_(),
    "fallback": pa.bool_(),
    "steps": pa.int32(),
    "pedestrians": pa.int32(),
}

_PASSAGE_COLUMNS = ("strategy", "delay_s")
"""Columns of a passage that do not come from its record; its delay is relative to its schedule."""

_LEG = pa.struct([(name, pa.float64()) for name in Leg._fields])

PEDESTRIANS = pa.schema(
    [
        *_KEYS,
        ("index", pa.int32()),
        ("arrival_s", pa.float64()),
        ("start_s", pa.float64()),
        ("side", pa.string()),
        ("quantile", pa.float64()),
        ("critical_gap_s", pa.float64()),
        ("threshold_s", pa.float64()),
        ("latency_s", pa.float64()),
        ("speed_mps", pa.float64()),
        ("range_m", pa.float64()),
        ("vehicle_speed_mps", pa.float64()),
        ("cleared_s", pa.float64()),
        ("legs", pa.list_(_LEG)),
        ("delay_s", pa.float64()),
        ("let_go", pa.bool_()),
    ]
)

TRACES = pa.schema(
    [
        *_KEYS,
        ("time_s", pa.float64()),
        ("object", pa.string()),
        ("x_m", pa.float64()),
        ("y_m", pa.float64()),
        ("speed_mps", pa.float64()),
        ("acceleration_mps2", pa.float64()),
    ]
)

_WHERE = [("direction", pa.string()), ("lane", pa.int32())]

_PASSED = ("scheduled_s", "inserted_s", "trigger_s", "edge_s", "passed_s")

PASSAGES = pa.schema(
    [
        *_KEYS,
        ("vehicle", pa.int64()),
        *_WHERE,
        ("type", pa.string()),
        ("strategy", pa.string()),
        *((name, pa.float64()) for name in _PASSED),
        ("delay_s", pa.float64()),
        ("control_delay_s", pa.float64()),
        ("trace_offset_s", pa.float64()),
        ("approach_stops", pa.int32()),
        *(
            (name, kind)
            for name, kind in (_FACTS | _MEASURES).items()
            if name not in _PASSAGE_COLUMNS
        ),
    ]
)

QUEUES = pa.schema(
    [
        *_KEYS,
        ("minute", pa.int32()),
        *_WHERE,
        ("mean", pa.float64()),
        ("longest", pa.int32()),
        ("let_through", pa.int32()),
    ]
)

_HOUR_COUNTS = [
    *("vehicles", "automated", "met", "fallbacks", "not_through", "reached"),
    *("late_first_half", "late_second_half", "due_through", "queue_longest"),
    *("pedestrians", "never_went", "had_to_wait", "let_go", "crashes"),
    *("conflicts_ttc", "conflicts_time_advantage", "conflicts_pet", "conflicts_drac"),
    "conflicts_unreached",
]
_HOUR_NUMBERS = [
    *("vehicle_delay_s", "automated_delay_s", "other_delay_s"),
    *("first_third_delay_s", "last_third_delay_s", "control_delay_s", "travel_time_s"),
    *("throughput_per_hour", "stops_per_vehicle", "queue_mean", "queue_p95", "queue_p95_m"),
    *("pedestrian_delay_s", "walking_mps", "person_delay_h"),
]
HOURS = pa.schema(
    [
        *_KEYS,
        ("reason", pa.string()),
        *((name, pa.int64()) for name in _HOUR_COUNTS),
        *((name, pa.float64()) for name in _HOUR_NUMBERS),
    ]
)

_CONFLICT_COUNTS = ("conflicts_ttc", "conflicts_time_advantage", "conflicts_pet", "conflicts_drac")
CROSSWALK_FIELDS = {
    "crosswalk": pa.string(),
    **dict.fromkeys(
        (
            *("passages", "automated", "not_driven", "turning", "bending", "people", "reached"),
            *("crashes", *_CONFLICT_COUNTS, "conflicts_unreached", "sumo_collisions"),
        ),
        pa.int64(),
    ),
    **dict.fromkeys(
        ("vehicle_delay_s", "pedestrian_wait_s", "queue_mean_m", "queue_p95_m"), pa.float64()
    ),
}
"""Columns of ``crosswalks`` beside the keys."""

_SIMULATION_COUNTS = [
    *("vehicles", "automated", "people", "unfinished", "not_departed"),
    *(
        "passages",
        "met",
        "met_driven",
        "fallbacks",
        "driven",
        "not_driven",
        "av_passages",
        *("avs_bend", "avs_turn", "avs_inside", "avs_stop", "avs_arrive", "avs_light"),
        "avs_uncommanded",
        "not_measured",
        "commands",
        "cut",
    ),
    *("reached", "crashes", *_CONFLICT_COUNTS, "conflicts_unreached"),
    *("sumo_collisions", "sumo_person_collisions", "teleports", "stuck", "deadlocked"),
]
_SIMULATION_NUMBERS = [
    *("av_time_loss_s", "other_time_loss_s", "vehicle_time_loss_s", "people_time_loss_s"),
    *("people_duration_s", "crosswalk_delay_s", "crosswalk_wait_s", "queue_p95_m"),
    *("stops_per_vehicle", "stood_longest_s"),
]
SIMULATIONS = pa.schema(
    [
        *_KEYS,
        ("reason", pa.string()),
        *((name, pa.int64()) for name in _SIMULATION_COUNTS),
        *((name, pa.float64()) for name in _SIMULATION_NUMBERS),
        ("crosswalks", pa.list_(pa.struct([*CROSSWALK_FIELDS.items()]))),
    ]
)

PASSAGES_OVER = pa.schema(
    [
        *_KEYS,
        ("crosswalk", pa.string()),
        ("vehicle", pa.string()),
        ("type", pa.string()),
        ("automated", pa.bool_()),
        ("strategy", pa.string()),
        ("not_driven", pa.string()),
        ("trigger_s", pa.float64()),
        ("edge_s", pa.float64()),
        ("passed_s", pa.float64()),
        ("free_speed_mps", pa.float64()),
        ("delay_s", pa.float64()),
        ("trace_offset_s", pa.float64()),
        ("commands", pa.int32()),
        ("cut", pa.int32()),
        ("ended", pa.string()),
        *(
            (name, kind)
            for name, kind in (_FACTS | _MEASURES).items()
            if name not in _PASSAGE_COLUMNS
        ),
    ]
)

SCENES_OVER = pa.schema(
    [
        *_KEYS,
        ("passage", pa.int32()),
        ("crosswalk", pa.string()),
        ("vehicle", pa.string()),
        ("approach", pa.string()),
        ("begin_s", pa.float64()),
        ("step_s", pa.float64()),
        ("motion", pa.string()),
        ("free_speed_mps", pa.float64()),
        ("range_m", pa.float64()),
        ("vehicle_length_m", pa.float64()),
        ("vehicle_width_m", pa.float64()),
        ("crossing_length_m", pa.float64()),
        ("crossing_width_m", pa.float64()),
        ("lane_centre_m", pa.float64()),
        ("lane_width_m", pa.float64()),
        ("walks", pa.list_(pa.struct([*PEDESTRIANS][len(_KEYS) :]))),
    ]
)

TABLES = {
    "hours": HOURS,
    "passages": PASSAGES,
    "queues": QUEUES,
    "pedestrians": PEDESTRIANS,
    "traces": TRACES,
    "walks": PEDESTRIANS,
    "simulations": SIMULATIONS,
    "passages_over": PASSAGES_OVER,
    "scenes_over": SCENES_OVER,
    "crosswalks": pa.schema([*_KEYS, *CROSSWALK_FIELDS.items()]),
}
"""Every table with a fixed schema, by name; ``cells`` depends on what a study varies."""


ROWS_BY_PAIR = ("hours", "simulations")
"""The tables with one row for each arm of a pair; a run has one of them."""

SIMULATION_TABLES = ("simulations", "passages_over")
"""The tables that the tasks of a user's own simulation return."""

SIMULATION_TRACES = ("traces", "scenes_over")
"""The further tables of such a run with ``--traces``."""

HOUR_TABLES = ("hours", "passages", "pedestrians", "queues")
"""The tables of a run of traffic."""

HOUR_TRACES = ("traces", "walks")
"""The further tables of a run of traffic with ``--traces``."""


def hour_tables(*, traces: bool) -> list[str]:
    """The tables that the tasks of a run of traffic return."""
    return [*HOUR_TABLES, *(HOUR_TRACES if traces else ())]
