"""The columns of the tables, declared once; a change needs a higher ``SCHEMA`` (folder.py)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import pyarrow as pa

from harness.core.encounter import LIMITED_BY, Arm, Contact, Ending, Leg, Side
from harness.measures.measured import MEASURES
from harness.scenario import Scenario

Tables = dict[str, pa.Table]
"""Tables by name."""

Row = dict[str, Any]
"""A row of a table: a value for each column."""

_LEGS = pa.list_(pa.struct([(name, pa.float64()) for name in Leg._fields]))
_TYPES: Mapping[Any, pa.DataType] = {
    **{float: pa.float64(), int: pa.int64(), bool: pa.bool_()},
    **{Leg: _LEGS, list: pa.list_(pa.float64())},
}


@dataclass(frozen=True)
class Column:
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
class Table:
    """The declaration of a table."""

    name: str
    columns: tuple[Column, ...]

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
            named = ", ".join(sorted(wrong))
            raise ValueError(f"{self.name}: no columns, or nulls in required ones: {named}")
        return table


_KEYS = (
    Column("cell", int, "", "number of the cell", required=True),
    Column("pair", int, "", "number of the pair, which keys its random streams", required=True),
    Column("arm", Arm, "", "who drives: the AV or the reference", required=True),
)

# fmt: off
EPISODES = Table("episodes", (
    *_KEYS,
    Column("strategy", str, "", "the strategy that drove", required=True),
    Column("ending", Ending, "", "how the episode ended", required=True),
    Column("reason", str, "", "why it failed"),
    Column("failed_in", str, "", "what failed: `strategy` or `engine`"),
    Column("contact", Contact, "", "the part of the ego that touched the pedestrian"),
    Column("contact_index", int, "", "index of the pedestrian who was touched"),
    Column("contact_time_s", float, "s", "time of the contact since the trigger"),
    Column("sumo_collision", bool, "", "whether SUMO itself reported a collision"),
    Column("fallback", bool, "", "whether the strategy's fallback drove", required=True),
    Column("steps", int, "", "steps of the record", required=True),
    Column("pedestrians", int, "", "people who stepped off within the record", required=True),
    *(Column(each.column, each.kind, each.unit, each.formula) for each in MEASURES),
    Column("conditionings", int, "", "uses of the interaction model"),
    Column("clamped", int, "", "of these, with an ego faster or farther than in its data"),
    Column("near_clamped", int, "", "of these, with an ego slower or nearer than in its data"),
    Column("clamped_speed_excess_mps", float, "m/s", "largest excess of the ego's speed"),
    Column("clamped_range_excess_m", float, "m", "largest excess of the ego's range"),
))
"""One row for each episode: the AV's and the reference's of each pair."""

PEDESTRIANS = Table("pedestrians", (
    *_KEYS,
    Column("index", int, "", "number of the pedestrian within the pair", required=True),
    Column("arrival_s", float, "s", "time of arrival at the kerb", required=True),
    Column("start_s", float, "s", "time of stepping off"),
    Column("side", Side, "", "the kerb from which they come", required=True),
    Column("quantile", float, "", "quantile of the walking speed"),
    Column("critical_gap_s", float, "s", "the shortest gap that they accept"),
    Column("threshold_s", float, "s", "the least margin of time with which they go"),
    Column("latency_s", float, "s", "time from the decision until they set off"),
    Column("speed_mps", float, "m/s", "walking speed"),
    Column("range_m", float, "m", "the ego's range when they stepped off"),
    Column("vehicle_speed_mps", float, "m/s", "the ego's speed when they stepped off"),
    Column("cleared_s", float, "s", "time at which they reached the other kerb"),
    Column("legs", Leg, "", "the parts of a walk that is not straight from kerb to kerb"),
    Column("delay_s", float, "s", "wait at the kerb"),
))
"""One row for each pedestrian who arrived within the record of an episode."""

TRACES = Table("traces", (
    *_KEYS,
    Column("time_s", float, "s", "time since the trigger", required=True),
    Column("object", str, "", "`ego`, `pedestrian-INDEX` or `shown-INDEX`", required=True),
    Column("x_m", float, "m", "along the road, 0 at the crosswalk's centre", required=True),
    Column("y_m", float, "m", "across the road, 0 at the near kerb", required=True),
    Column("speed_mps", float, "m/s", "speed", required=True),
    Column("acceleration_mps2", float, "m/s²", "acceleration of the step that begins here"),
))
"""One row for each step and object, of a run that keeps traces."""

ARMS = Table("arms", (
    *_KEYS,
    Column("reason", str, "", "why it failed"),
    Column("begin_s", float, "s", "begin of the counted time, a time of the simulation"),
    Column("counted_s", float, "s", "duration of the counted time"),
    Column("vehicle_collisions", int, "", "collisions of vehicles that SUMO reports"),
    Column("person_collisions", int, "", "collisions of vehicles and people that it reports"),
    Column("teleports", int, "", "vehicles that SUMO teleported"),
    Column("emergency_stops", int, "", "emergency stops that SUMO reports"),
    Column("overlaps", int, "", "overlaps behind a vehicle that waits inside a junction"),
    Column("harness_people", int, "", "the harness's people who arrived"),
    Column("sumo_people", int, "", "SUMO's people who came to a chosen crosswalk"),
    Column("people_left_out", int, "", "more of them, seen too briefly on it for a row"),
    Column("conditionings", int, "", "uses of the interaction model"),
    Column("clamped", int, "", "of these, with a vehicle faster or farther than in its data"),
))
"""One row for each simulation: the AV's arm and the reference's of each pair."""

PASSAGES = Table("passages", (
    *_KEYS,
    Column("crosswalk", str, "", "id of the crosswalk", required=True),
    Column("vehicle", str, "", "SUMO's id of the vehicle", required=True),
    Column("type", str, "", "its vType", required=True),
    Column("automated", bool, "", "whether it is an AV, in the AV's arm", required=True),
    Column("connection", str, "", "its first and last lane", required=True),
    Column("manoeuvre", str, "", "`straight`, `left`, `right` or `turn`", required=True),
    Column("driver", str, "", "the strategy, or `sumo`", required=True),
    Column("driven", bool, "", "whether a strategy drove", required=True),
    Column("not_driven_because", str, "", "why no strategy drove"),
    Column("fallback", bool, "", "whether the strategy's fallback drove"),
    Column("trigger_s", float, "s", "time at which it passed R0", required=True),
    Column("front_s", float, "s", "time at which its front reached the crosswalk"),
    Column("rear_s", float, "s", "time at which its rear left the crosswalk"),
    Column("ended", str, "", "`passed`, or why the passage ended before", required=True),
    Column("steps", int, "", "steps of the passage"),
    *(Column(f"share_{each}", float, "", f"share of the driven steps limited by {each}")
      for each in LIMITED_BY),
    Column("pedestrians", int, "", "people who stepped off during the passage"),
    Column("contact", Contact, "", "the part of the vehicle that touched a person"),
    Column("contact_person", str, "", "whom the vehicle's oriented outline touched first"),
    Column("sumo_contact", bool, "", "whether SUMO itself reported a collision"),
    Column("min_speed_mps", float, "m/s", "least speed"),
    *(Column(each.column, each.kind, each.unit, each.formula) for each in MEASURES),
))
"""One row for each vehicle over a chosen crosswalk in the counted time."""

VEHICLES = Table("vehicles", (
    *_KEYS,
    Column("vehicle", str, "", "SUMO's id", required=True),
    Column("type", str, "", "its vType", required=True),
    Column("automated", bool, "", "whether it is an AV, in the AV's arm", required=True),
    Column("due_s", float, "s", "time at which it was to depart"),
    Column("depart_s", float, "s", "time of its departure"),
    Column("arrival_s", float, "s", "time of its arrival"),
    Column("depart_delay_s", float, "s", "wait for its departure", required=True),
    Column("time_loss_s", float, "s", "time lost, with that wait", required=True),
))
"""One row for each vehicle that was to depart in the counted time."""

PEOPLE = Table("people", (
    *_KEYS,
    Column("crosswalk", str, "", "id of the crosswalk", required=True),
    Column("person", str, "", "SUMO's id, or the harness's", required=True),
    Column("own", bool, "", "whether it is the harness's", required=True),
    Column("side", str, "", "the end of the crosswalk from which they come", required=True),
    Column("arrival_s", float, "s", "time of arrival at the kerb", required=True),
    Column("start_s", float, "s", "time of stepping off"),
    Column("cleared_s", float, "s", "time at which they left the crosswalk"),
    Column("wait_s", float, "s", "wait at the kerb, until stepping off or the end"),
    Column("delay_s", float, "s", "delay against an undisturbed walk"),
    Column("speed_mps", float, "m/s", "walking speed: drawn, or the mean over the crosswalk"),
    Column("let_go", bool, "", "whether they went before the vehicle that made them wait"),
))
"""One row for each person and crosswalk."""

CROSSWALKS = Table("crosswalks", (
    *_KEYS,
    Column("crosswalk", str, "", "id of the crosswalk", required=True),
    Column("prioritized", bool, "", "whether vehicles have to give way", required=True),
    Column("length_m", float, "m", "from kerb to kerb", required=True),
    Column("width_m", float, "m", "extent along the road"),
    Column("x_m", float, "m", "place of its centre in the network"),
    Column("y_m", float, "m", "place of its centre in the network"),
    Column("queue_p95", float, "", "vehicles below 5 km/h before it, 95 % quantile over seconds"),
))
"""One row for each chosen crosswalk."""

DRAWS = Table("draws", (
    Column("cell", int, "", "number of the round; the last one is the estimate", required=True),
    Column("pair", int, "", "number of the draw within its round", required=True),
    Column("placed", bool, "", "whether a person was placed into the draw's first episode", True),
    Column("nominal", bool, "", "whether it is the first episode of a nominal draw", True),
    Column("event", bool, "", "whether it counts as an event", required=True),
    Column("due", bool, "", "whether that is due to whom the density draws", required=True),
    Column("weight", float, "", "its weight, if it is an event or failed", required=True),
    Column("likely", float, "", "nominal density over that of the draw", required=True),
    Column("scores", list, "", "distances from the event, of whom the density draws alone"),
    Column("point", list, "", "what was drawn: fixed normal numbers, speed, arrival, others"),
    Column("passed_mps", float, "m/s", "speed at which the ego passes"),
    Column("episodes", int, "", "episodes that it took", required=True),
    Column("reason", str, "", "why it failed"),
    Column("timed_out", bool, "", "whether it timed out", required=True),
    Column("uniforms", str, "", "of an event: its entry of `pedestrians.drawn`, as JSON"),
))
"""One row for each episode of a risk; those that only find an event's weight are counted."""
# fmt: on

RunKind = Literal["encounters", "simulations", "risk"]

ENCOUNTERS: tuple[RunKind, ...] = ("encounters",)
SIMULATIONS: tuple[RunKind, ...] = ("simulations",)

TABLES_OF: Mapping[RunKind, tuple[Table, ...]] = {
    "encounters": (EPISODES, PEDESTRIANS, TRACES),
    "simulations": (ARMS, PASSAGES, VEHICLES, PEOPLE, CROSSWALKS),
    "risk": (DRAWS,),
}
"""The tables of each kind of run, that which is written last first; `traces` may be left out."""

COUNTED: Mapping[RunKind, tuple[str, ...]] = {
    "encounters": ("episodes",),
    "simulations": tuple(table.name for table in TABLES_OF["simulations"]),
}
"""The tables from which the findings of a run are computed."""

TABLES: Mapping[str, Table] = {each.name: each for of in TABLES_OF.values() for each in of}


def kind_of(scenario: Scenario) -> RunKind:
    """The kind of a run of this scenario."""
    return "encounters" if scenario.kind == "encounters" else "simulations"
