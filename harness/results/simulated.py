"""A cell's simulations as aligned columns: one entry for each pair, of both arms."""

from collections import Counter
from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.encounter import Arm, FloatArray
from harness.core.errors import unknown_name
from harness.measures.queues import growth, standing
from harness.results.columns import AV, REFERENCE, BothArms
from harness.results.estimators import Sampling
from harness.results.tables import LIMITED_BY, TABLES_OF, Tables
from harness.scenario import ConflictsSection, Scenario

_TABLES = TABLES_OF["simulations"]
_EVERY_PAIR = ("every", "failed")
_AT_CROSSWALKS = ("crosswalks", "passages", "people")

_OF = pc.field
_TOUCHED = _OF("contact_person").is_valid()
_REACHED = _OF("front_s").is_valid() | _TOUCHED
_DRIVEN = _OF("automated") & _OF("driven")
_MET = _OF("pedestrians") > 0
_FAILED = _OF("reason").is_valid()

# fmt: off
WHICH: Mapping[str, pc.Expression | Callable[[ConflictsSection], pc.Expression]] = {
    "pet": lambda limits: _REACHED & ((_OF("pet_s") < limits.pet_s) | _TOUCHED),
    "ttc": lambda limits: _REACHED & ((_OF("min_ttc_s") < limits.ttc_s) | _TOUCHED),
    "drac": lambda limits: _REACHED & ((_OF("max_drac_mps2") > limits.drac_mps2) | _TOUCHED),
    "all": pc.scalar(True),
    "failed": _FAILED,
    "av": _OF("automated"), "other": ~_OF("automated"),
    "av_driven": _DRIVEN, "av_left": _OF("automated") & ~_OF("driven"),
    "reached": _REACHED, "cut_off": _OF("rear_s").is_null(),
    "touched": _TOUCHED,
    "met": _MET, "av_met": _DRIVEN & _MET, "fell_back": _DRIVEN & _MET & _OF("fallback"),
    "waited": _OF("let_go").is_valid(), "let_go": _OF("let_go"),
    "never_went": _OF("start_s").is_null(), "unfinished": _OF("arrival_s").is_null(),
    "prioritized": _OF("prioritized"), "unprioritized": ~_OF("prioritized"),
}
# fmt: on
"""The rows of a table that a column counts; a contact is a conflict of every kind."""


class SimulationSample:
    """The simulations of one cell, over all chosen crosswalks or over one of them.

    A pair in which an arm failed counts in no column but ``every`` and ``failed``.

    Args:
        tables: the tables of the cell by pair, the AV's first.
        scenario: the cell's scenario.
        confidence: two-sided confidence of intervals; 0: there are none.
        crosswalk: the only crosswalk; None: all.
    """

    def __init__(
        self, tables: Tables, scenario: Scenario, confidence: float, crosswalk: str | None = None
    ) -> None:
        self.scenario, self.sampling, self._all = scenario, Sampling(None, confidence), tables
        arms = tables["arms"]
        self._pairs = arms["pair"].to_numpy()[::2]
        self.n = len(self._pairs)
        left_out = _OF("pair").isin(arms.filter(_FAILED)["pair"].combine_chunks())
        kept = {name: of if name == "arms" else of.filter(~left_out) for name, of in tables.items()}
        if crosswalk is not None:
            here = _OF("crosswalk") == crosswalk
            kept |= {name: kept[name].filter(here) for name in _AT_CROSSWALKS}
        for name in LIMITED_BY:
            rows = kept["passages"]
            steps = pc.multiply(rows["steps"], rows[f"share_{name}"])
            kept["passages"] = rows.append_column(name, steps)
        self.tables = kept
        self._arms: dict[str, BothArms] = {}

    def at(self, crosswalk: str) -> "SimulationSample":
        """The same simulations at one crosswalk."""
        return SimulationSample(self._all, self.scenario, self.sampling.confidence, crosswalk)

    @cached_property
    def crosswalks(self) -> tuple[str, ...]:
        """The sample's crosswalks, in the tables' order."""
        names = (self.tables[table]["crosswalk"].to_pylist() for table in _AT_CROSSWALKS)
        return tuple(dict.fromkeys(name for of_table in names for name in of_table))

    def arms(self, name: str) -> BothArms:
        """A column of both arms: a key of ``COLUMNS``, or what such a one stands for.

        That is ``mean``, ``sum``, ``count`` or ``count_distinct``, then ``TABLE.COLUMN``, or the
        table alone if rows are counted, and at most one key of ``WHICH``.  Means are NaN where no
        row counts.

        Raises:
            InputError: there is no such column.

        Example: ``sample.arms("mean passages.delay_s av")``.
        """
        if name not in self._arms:
            own = COLUMNS.get(name, name)
            values = self._found(own) if isinstance(own, str) else own(self)
            if name not in _EVERY_PAIR:
                failed = np.logical_or(*self.arms("failed"))
                values = np.where(failed[:, None], np.nan, values)
            self._arms[name] = values[:, AV], values[:, REFERENCE]
        return self._arms[name]

    def pairs(self, name: str) -> np.ndarray:
        """A column that is the same in both arms."""
        return self.arms(name)[AV]

    def _found(self, name: str) -> FloatArray:
        how, place, which, *_ = [*name.split(), "all", "all"]
        table, _, column = place.partition(".")
        column = column or "pair"
        if (rows := self.tables.get(table)) is None or column not in rows.column_names:
            known = [f"{of.name}.{each}" for of in _TABLES for each in of.schema.names]
            raise unknown_name("column", "column", place, known)
        kept = WHICH[which]
        kept = kept(self.scenario.conflicts) if callable(kept) else kept
        found = rows.filter(kept).group_by(["pair", "arm"]).aggregate([(column, how)])
        values = np.full((self.n, 2), np.nan if how == "mean" else 0.0)
        arm = pc.equal(found["arm"], Arm.HUMAN.value).to_numpy().astype(int)
        pair = np.searchsorted(self._pairs, found["pair"].to_numpy())
        values[pair, arm] = found[f"{column}_{how}"].cast(pa.float64()).to_numpy()
        return values

    def why_not_driven(self) -> str | None:
        """Why no strategy drove AVs in the AV's arm, with the numbers of passages, in words."""
        of_av = (_OF("arm") == Arm.AV.value) & _OF("automated") & ~_OF("driven")
        whys = self.tables["passages"].filter(of_av)["not_driven_because"].to_pylist()
        found = Counter(why or "for no known reason" for why in whys)
        return "; ".join(f"{count:,} {why}" for why, count in found.most_common()) or None


def _each(
    table: str, of: Callable[[SimulationSample, pa.Table, float, float], float | None]
) -> Callable[[SimulationSample], FloatArray]:
    """A number of each simulation, from its rows of a table and its counted time."""

    def numbers(sample: SimulationSample) -> FloatArray:
        found: list[float | None] = []
        for arm in sample.tables["arms"].to_pylist():
            own = (_OF("pair") == arm["pair"]) & (_OF("arm") == arm["arm"])
            ends = arm["begin_s"], arm["counted_s"]
            rows = sample.tables[table].filter(own)
            found.append(None if None in ends else of(sample, rows, ends[0], sum(ends)))
        return np.array(found, float).reshape(-1, 2)

    return numbers


def _queue(sample: SimulationSample, rows: pa.Table, from_s: float, until_s: float) -> float | None:
    queues = []
    for name in sample.crosswalks:
        here = rows.filter(_OF("crosswalk") == name)
        begin_s, end_s = (here[f"stop_{end}_s"].drop_null().to_numpy() for end in ("begin", "end"))
        queues.append(standing(begin_s, end_s, from_s, until_s))
    return float(np.quantile(queues, 0.95)) if queues else None


def _growth(_: SimulationSample, rows: pa.Table, from_s: float, until_s: float) -> float | None:
    due_s = pc.coalesce(rows["due_s"], pc.subtract(rows["depart_s"], rows["depart_delay_s"]))
    return growth(due_s.to_numpy(), rows["arrival_s"].to_numpy(), from_s, until_s)


def _per_hour(_: SimulationSample, rows: pa.Table, from_s: float, until_s: float) -> float:
    passed: int = len(rows) - rows["rear_s"].null_count
    return 3600 * passed / (until_s - from_s)


COLUMNS: Mapping[str, str | Callable[[SimulationSample], FloatArray]] = {
    "every": lambda sample: np.ones((sample.n, 2)),
    "failed": "count arms failed",
    "met": "count passages av_met",
    "fell_back": "count passages fell_back",
    "conditionings": "sum arms.conditionings",
    "clamped": "sum arms.clamped",
    "queue_p95": _each("passages", _queue),
    "growth": _each("vehicles", _growth),
    "throughput_per_hour": _each("passages", _per_hour),
}
"""Columns with a name of their own, shape (n, 2)."""
