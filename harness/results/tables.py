"""The tables of a run: every column with its type, unit and meaning.

A run whose tables have other columns is refused (``folder.schema_digest``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import pyarrow as pa

from harness.core.vocabulary import LIMITED_BY, Arm, Contact, Ending, Leg, Side
from harness.measures.measured import MEASURES

Tables = dict[str, pa.Table]
"""Tables by name."""

Row = dict[str, Any]
"""A row of a table: a value for each column."""

_LEGS = pa.list_(pa.struct([(name, pa.float64()) for name in Leg._fields]))
_TYPES: Mapping[Any, pa.DataType] = {float: pa.float64(), int: pa.int64(), bool: pa.bool_(),
                                     Leg: _LEGS, list: pa.list_(pa.float64())}  # fmt: skip


@dataclass(frozen=True)
class Field:
    """A column.  A value that is missing is null, never 0; a ``required`` column has no null.

    ``kind`` is the type of its values: a ``StrEnum`` stands for its words, ``Leg`` for a list of
    legs, ``list`` for one of numbers.
    """

    name: str
    kind: type
    unit: str
    meaning: str
    required: bool = False

    @property
    def type(self) -> pa.DataType:
        """Its type in Arrow."""
        return _TYPES.get(self.kind, pa.string())


@dataclass(frozen=True)
class TableSchema:
    """The declaration of a table."""

    name: str
    columns: tuple[Field, ...]

    @property
    def schema(self) -> pa.Schema:
        """Its schema in Arrow."""
        return pa.schema(pa.field(c.name, c.type, nullable=not c.required) for c in self.columns)

    def of(self, rows: Sequence[Row]) -> pa.Table:
        """Rows as a table; columns that a row lacks are null.

        Raises:
            ValueError: a row has a key that is no column, or a required column has a null.
        """
        table = pa.Table.from_pylist([*rows], self.schema)
        wrong = set[str]().union(*rows) - {*table.column_names}
        wrong |= {c.name for c in self.columns if c.required and table[c.name].null_count}
        if wrong:
            raise ValueError(f"{self.name}: no columns, or nulls in required: {sorted(wrong)}")
        return table


_KEYS = (
    Field("cell", int, "", "number of the cell", required=True),
    Field("pair", int, "", "number of the pair, which keys its random streams", required=True),
    Field("arm", Arm, "", "who drives: the AV or the reference", required=True),
)

# fmt: off
EPISODES = TableSchema("episodes", (
    *_KEYS,
    Field("strategy", str, "", "the strategy that drove", required=True),
    Field("ending", Ending, "", "how the episode ended", required=True),
    Field("reason", str, "", "why it failed"),
    Field("failed_in", str, "", "what failed: `strategy` or `engine`"),
    Field("contact", Contact, "", "the part of the ego that touched the pedestrian"),
    Field("contact_index", int, "", "index of the pedestrian who was touched"),
    Field("contact_time_s", float, "s", "time of the contact since the trigger"),
    Field("sumo_collision", bool, "", "whether SUMO itself reported a collision"),
    Field("fallback", bool, "", "whether the strategy's fallback drove", required=True),
    Field("steps", int, "", "steps of the record"),
    Field("pedestrians", int, "", "people who stepped off within the record"),
    *(Field(each.column, each.kind, each.unit, each.formula) for each in MEASURES),
    Field("conditionings", int, "", "uses of the interaction model"),
    Field("clamped", int, "", "of these, with an ego faster or farther than in its data"),
    Field("near_clamped", int, "", "of these, with an ego slower or nearer than in its data"),
    Field("clamped_speed_excess_mps", float, "m/s", "largest excess of the ego's speed"),
    Field("clamped_range_excess_m", float, "m", "largest excess of the ego's range"),
))
"""One row for each episode: the AV's and the reference's of each pair."""

PEDESTRIANS = TableSchema("pedestrians", (
    *_KEYS,
    Field("index", int, "", "number of the pedestrian within the pair", required=True),
    Field("arrival_s", float, "s", "time of arrival at the kerb", required=True),
    Field("start_s", float, "s", "time of stepping off"),
    Field("side", Side, "", "the kerb from which they come", required=True),
    Field("quantile", float, "", "quantile of the walking speed"),
    Field("critical_gap_s", float, "s", "the shortest gap that they accept"),
    Field("threshold_s", float, "s", "the least margin of time with which they go"),
    Field("latency_s", float, "s", "time from the decision until they set off"),
    Field("speed_mps", float, "m/s", "walking speed"),
    Field("range_m", float, "m", "the ego's range when they stepped off"),
    Field("vehicle_speed_mps", float, "m/s", "the ego's speed when they stepped off"),
    Field("cleared_s", float, "s", "time at which they reached the other kerb"),
    Field("legs", Leg, "", "the parts of a walk that is not straight from kerb to kerb"),
    Field("delay_s", float, "s", "wait at the kerb"),
))
"""One row for each pedestrian who arrived within the record of an episode."""

TRACES = TableSchema("traces", (
    *_KEYS,
    Field("time_s", float, "s", "time since the trigger", required=True),
    Field("object", str, "", "`ego`, `pedestrian-INDEX` or `shown-INDEX`", required=True),
    Field("x_m", float, "m", "along the road, 0 at the crosswalk's centre", required=True),
    Field("y_m", float, "m", "across the road, 0 at the near kerb", required=True),
    Field("speed_mps", float, "m/s", "speed", required=True),
    Field("acceleration_mps2", float, "m/s²", "acceleration of the step that begins here"),
))
"""One row for each step and object, of a run that keeps traces."""

ARMS = TableSchema("arms", (
    *_KEYS,
    Field("reason", str, "", "why it failed"),
    Field("failed_in", str, "", "what failed: `strategy` or `engine`"),
    Field("begin_s", float, "s", "begin of the counted time, a time of the simulation"),
    Field("counted_s", float, "s", "duration of the counted time"),
    Field("vehicle_collisions", int, "", "collisions of vehicles that SUMO reports"),
    Field("person_collisions", int, "", "collisions of vehicles and people that it reports"),
    Field("teleports", int, "", "vehicles that SUMO teleported in the counted time"),
    Field("emergency_stops", int, "", "emergency stops that SUMO reports"),
    Field("overlaps", int, "", "overlaps behind a vehicle that waits inside a junction"),
    Field("harness_people", int, "", "the harness's people who arrived"),
    Field("sumo_people", int, "", "SUMO's people who came to a chosen crosswalk"),
    Field("people_left_out", int, "", "more of them, seen too briefly on it for a row"),
    Field("conditionings", int, "", "uses of the interaction model"),
    Field("clamped", int, "", "of these, with a vehicle faster or farther than in its data"),
))
"""One row for each simulation: the AV's arm and the reference's of each pair."""

PASSAGES = TableSchema("passages", (
    *_KEYS,
    Field("crosswalk", str, "", "id of the crosswalk", required=True),
    Field("vehicle", str, "", "SUMO's id of the vehicle", required=True),
    Field("type", str, "", "its vType", required=True),
    Field("automated", bool, "", "whether it is an AV, in the AV's arm", required=True),
    Field("connection", str, "", "its first and last lane", required=True),
    Field("manoeuvre", str, "", "`straight`, `left`, `right` or `turn`", required=True),
    Field("driver", str, "", "the strategy, or `sumo`", required=True),
    Field("driven", bool, "", "whether a strategy drove", required=True),
    Field("not_driven_because", str, "", "why no strategy drove"),
    Field("fallback", bool, "", "whether the strategy's fallback drove; null without a strategy"),
    Field("trigger_s", float, "s", "time at which it passed R0", required=True),
    Field("front_s", float, "s", "time at which its front reached the crosswalk"),
    Field("rear_s", float, "s", "time at which its rear left the crosswalk"),
    Field("ended", str, "", "`passed`, or why the passage ended before", required=True),
    Field("steps", int, "", "steps of the passage"),
    *(Field(f"share_{each}", float, "", f"share of the driven steps limited by {each}")
      for each in LIMITED_BY),
    Field("pedestrians", int, "", "people who stepped off during the passage"),
    Field("contact", Contact, "", "the part of the vehicle that touched a person"),
    Field("contact_person", str, "", "whom the vehicle's oriented outline touched first"),
    Field("sumo_contact", bool, "", "whether SUMO itself reported a collision"),
    Field("min_speed_mps", float, "m/s", "least speed"),
    *(Field(each.column, each.kind, each.unit, each.formula) for each in MEASURES),
))
"""One row for each vehicle over a chosen crosswalk in the counted time."""

VEHICLES = TableSchema("vehicles", (
    *_KEYS,
    Field("vehicle", str, "", "SUMO's id", required=True),
    Field("type", str, "", "its vType", required=True),
    Field("automated", bool, "", "whether it is an AV, in the AV's arm", required=True),
    Field("due_s", float, "s", "time at which it was to depart"),
    Field("depart_s", float, "s", "time of its departure"),
    Field("arrival_s", float, "s", "time of its arrival"),
    Field("depart_delay_s", float, "s", "wait for its departure", required=True),
    Field("time_loss_s", float, "s", "time lost, with that wait", required=True),
))
"""One row for each vehicle that was to depart in the counted time."""

PEOPLE = TableSchema("people", (
    *_KEYS,
    Field("crosswalk", str, "", "id of the crosswalk", required=True),
    Field("person", str, "", "SUMO's id, or the harness's", required=True),
    Field("own", bool, "", "whether it is the harness's", required=True),
    Field("side", Side, "", "the end of the crosswalk from which they come", required=True),
    Field("arrival_s", float, "s", "time of arrival at the kerb", required=True),
    Field("start_s", float, "s", "time of stepping off"),
    Field("cleared_s", float, "s", "time at which they left the crosswalk"),
    Field("wait_s", float, "s", "wait at the kerb, until stepping off or the end"),
    Field("delay_s", float, "s", "delay against an undisturbed walk; null of who still crosses"),
    Field("speed_mps", float, "m/s", "drawn, or the mean over the crosswalk; null if not above 0"),
    Field("let_go", bool, "", "whether they went before the vehicle that made them wait"),
))
"""One row for each person and crosswalk."""

CROSSWALKS = TableSchema("crosswalks", (
    *_KEYS,
    Field("crosswalk", str, "", "id of the crosswalk", required=True),
    Field("prioritized", bool, "", "whether vehicles have to give way", required=True),
    Field("length_m", float, "m", "from kerb to kerb", required=True),
    Field("width_m", float, "m", "extent along the road"),
    Field("x_m", float, "m", "place of its centre in the network"),
    Field("y_m", float, "m", "place of its centre in the network"),
    Field("queue_p95", float, "", "vehicles below 5 km/h before it, 95 % quantile over seconds"),
))
"""One row for each chosen crosswalk."""

DRAWS = TableSchema("draws", (
    Field("cell", int, "", "number of the round; the last one is the estimate", required=True),
    Field("pair", int, "", "number of the draw within its round", required=True),
    Field("placed", bool, "", "whether a person was placed into the draw's first episode", True),
    Field("nominal", bool, "", "whether it is the first episode of a nominal draw", True),
    Field("event", bool, "", "whether it counts as an event", required=True),
    Field("due", bool, "", "whether that is due to whom the density draws", required=True),
    Field("weight", float, "", "its weight, if it is an event or failed", required=True),
    Field("likely", float, "", "nominal density over that of the draw", required=True),
    Field("scores", list, "", "distances from the event, of whom the density draws alone"),
    Field("point", list, "", "what was drawn: fixed normal numbers, speed, arrival, others"),
    Field("passed_mps", float, "m/s", "speed at which the ego passes"),
    Field("episodes", int, "", "episodes that it took", required=True),
    Field("reason", str, "", "why it failed"),
    Field("timed_out", bool, "", "whether it timed out", required=True),
    Field("uniforms", str, "", "of an event: its entry of `pedestrians.drawn`, as JSON"),
))
"""One row for each episode of a risk; those that only find an event's weight are counted."""
# fmt: on

RunKind = Literal["encounters", "simulations", "risk"]

ENCOUNTERS: tuple[RunKind, ...] = ("encounters",)
SIMULATIONS: tuple[RunKind, ...] = ("simulations",)

TABLES_OF: Mapping[RunKind, tuple[TableSchema, ...]] = MappingProxyType({
    "encounters": (EPISODES, PEDESTRIANS, TRACES),
    "simulations": (ARMS, PASSAGES, VEHICLES, PEOPLE, CROSSWALKS),
    "risk": (DRAWS,),
})  # fmt: skip
"""The tables of each kind of run, that which is written last first; `traces` may be left out."""

COUNTED: Mapping[RunKind, tuple[str, ...]] = MappingProxyType({
    "encounters": ("episodes",),
    "simulations": tuple(table.name for table in TABLES_OF["simulations"]),
})  # fmt: skip
"""The tables from which the findings of a run are computed."""

TABLES = MappingProxyType({each.name: each for kind in TABLES_OF.values() for each in kind})
