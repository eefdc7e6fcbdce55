"""A cell's simulations as aligned columns: one entry for each pair, of both arms."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.vocabulary import LIMITED_BY, SECONDS_PER_HOUR, Arm, FloatArray
from harness.measures.queues import growth
from harness.results.columns import AV
from harness.results.estimators import Sampling
from harness.results.tables import TABLES, Tables
from harness.scenario import Scenario
from harness.scenario.sections import ConflictsSection

_OF = pc.field
_TOUCHED = _OF("contact_person").is_valid()
_REACHED = _OF("front_s").is_valid() | _OF("rear_s").is_valid() | _TOUCHED


# fmt: off
ROWS: Mapping[str, Callable[[ConflictsSection], pc.Expression]] = MappingProxyType({
    "failed": lambda _: _OF("reason").is_valid(), "fell_back": lambda _: _OF("fallback"),
    "failed_strategy": lambda _: _OF("failed_in") == "strategy",
    "av": lambda _: _OF("automated"), "other": lambda _: ~_OF("automated"),
    "driven": lambda _: _OF("driven"), "left": lambda _: ~_OF("driven"),
    "reached": lambda _: _REACHED, "touched": lambda _: _TOUCHED,
    "sumo_alone": lambda _: _OF("sumo_contact") & ~_TOUCHED,
    "passed": lambda _: _OF("rear_s").is_valid(), "cut_off": lambda _: _OF("rear_s").is_null(),
    "pet": lambda limits: _REACHED & ((_OF("pet_s") < limits.pet_s) | _TOUCHED),
    "ttc": lambda limits: _REACHED & ((_OF("min_ttc_s") < limits.ttc_s) | _TOUCHED),
    "drac": lambda limits: _REACHED & ((_OF("max_drac_mps2") > limits.drac_mps2) | _TOUCHED),
    "met": lambda _: _OF("pedestrians") > 0, "never_went": lambda _: _OF("start_s").is_null(),
    "waited": lambda _: _OF("let_go").is_valid(), "let_go": lambda _: _OF("let_go"),
    "unfinished": lambda _: _OF("arrival_s").is_null(),
    "no_delay": lambda _: _OF("delay_s").is_null(),
})
"""Which rows of a table a column counts; a contact is a conflict of every kind."""
# fmt: on


@dataclass(frozen=True)
class Of:
    """A column of simulations: what is found of the rows of a table in each pair and arm.

    Attributes:
        how: a mean or maximum is NaN where no row counts.
        table: name of the table.
        column: its column.
        rows: names of ``ROWS``, all of which hold of the rows that count.
    """

    how: Literal["mean", "max", "sum", "count", "count_distinct"]
    table: str
    column: str
    rows: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a column or name of rows that does not exist."""
        columns = {*TABLES[self.table].schema.names, *LIMITED_BY}
        if self.column not in columns or not {*self.rows} <= ROWS.keys():
            raise ValueError(f"{self} is no column of simulations")

    def __str__(self) -> str:
        """How the reference in the documentation names it."""
        place = self.table if self.how == "count" else f"{self.table}.{self.column}"
        return " ".join((self.how, place, *self.rows))


def counted(table: str, *rows: str) -> Of:
    """The number of rows."""
    return Of("count", table, "pair", rows)


def summed(table: str, column: str, *rows: str) -> Of:
    """The sum of a column."""
    return Of("sum", table, column, rows)


def averaged(table: str, column: str, *rows: str) -> Of:
    """The mean of a column."""
    return Of("mean", table, column, rows)


class SimulationSample(dict[str | Of, np.ndarray]):
    """The simulations of one cell, over all chosen crosswalks or over one of them.

    A column is of both arms, shape (2, n) with the AV's first, or of the pairs, shape (n,); it is
    made when it is asked for, by a name of ``NAMED`` or by how it is found.  All but counts of
    pairs and failures are NaN where an arm failed.

    Args:
        tables: the tables of the cell by pair, from pair 0 on, the AV's first.
        scenario: the cell's scenario.
        confidence: two-sided confidence of intervals; 0: there are none.
        crosswalk: the only crosswalk; None: all.
    """

    def __init__(
        self, tables: Tables, scenario: Scenario, confidence: float, crosswalk: str | None = None
    ) -> None:
        super().__init__()
        self.scenario, self.n, self._all = scenario, len(tables["arms"]) // 2, tables
        self._kept: dict[tuple[str, tuple[str, ...]], pa.Table] = {}
        self.samplings = (Sampling(None, confidence), Sampling(None, confidence))
        failed = tables["arms"].filter(_OF("reason").is_valid())["pair"]
        counts = ~_OF("pair").isin(failed.combine_chunks())
        here = counts if crosswalk is None else counts & (_OF("crosswalk") == crosswalk)
        self.tables = {
            name: table.filter(here if "crosswalk" in table.column_names else counts)
            for name, table in tables.items()
        } | {"arms": tables["arms"]}
        for name in LIMITED_BY:
            rows = self.tables["passages"]
            decided = pc.multiply(rows["steps"], rows[f"share_{name}"])
            self.tables["passages"] = rows.append_column(name, decided)

    def at(self, crosswalk: str) -> "SimulationSample":
        """The same simulations at one crosswalk."""
        return SimulationSample(self._all, self.scenario, self.samplings[AV].confidence, crosswalk)

    @property
    def crosswalks(self) -> tuple[str, ...]:
        """The sample's crosswalks, in the table's order."""
        return tuple(self.tables["crosswalks"]["crosswalk"].unique().to_pylist())

    def __missing__(self, name: str | Of) -> np.ndarray:
        own = NAMED[name] if isinstance(name, str) else name
        values = self._found(own) if isinstance(own, Of) else own(self)
        if name not in ("every", "failed", "failed_strategy"):
            values = np.where(self["failed"].any(axis=0), np.nan, values)
        values.setflags(write=False)
        return self.setdefault(name, values)

    def _found(self, of: Of) -> FloatArray:
        rows = self._rows(of.table, of.rows)
        found = rows.group_by(["pair", "arm"]).aggregate([(of.column, of.how)])
        values = np.full((2, self.n), np.nan if of.how in ("mean", "max") else 0.0)
        arm = pc.equal(found["arm"], Arm.HUMAN.value).to_numpy().astype(int)
        values[arm, found["pair"].to_numpy()] = found[f"{of.column}_{of.how}"].cast(pa.float64())
        return values

    def _rows(self, table: str, names: tuple[str, ...]) -> pa.Table:
        """The rows of a table of which these ``ROWS`` hold; many columns are of the same rows."""
        if names and (table, names) not in self._kept:
            holds = ROWS[names[-1]](self.scenario.conflicts)
            self._kept[table, names] = self._rows(table, names[:-1]).filter(holds)
        return self._kept[table, names] if names else self.tables[table]

    def growth(self) -> FloatArray:
        """By what share of the vehicles due in a third the network fills; see ``queues.growth``."""
        found = np.full((2, self.n), np.nan)
        for n, arm in enumerate(self.tables["arms"].to_pylist()):
            own = (_OF("pair") == arm["pair"]) & (_OF("arm") == arm["arm"])
            rows, begin_s = self.tables["vehicles"].filter(own), arm["begin_s"]
            if begin_s is not None:
                due_s, left_s = (rows[name].to_numpy() for name in ("due_s", "arrival_s"))
                found[n % 2, n // 2] = growth(due_s, left_s, begin_s, begin_s + arm["counted_s"])
        return found

    def why_not_driven(self) -> str | None:
        """Why no strategy drove AVs in the AV's arm, with the numbers of passages, in words."""
        left = _OF("automated") & ~_OF("driven") & (_OF("arm") == Arm.AV.value)
        whys = self.tables["passages"].filter(left)["not_driven_because"].to_pylist()
        found = Counter(why or "for no known reason" for why in whys)
        return "; ".join(f"{count:,} {why}" for why, count in found.most_common()) or None


NAMED: Mapping[str, Of | Callable[[SimulationSample], np.ndarray]] = MappingProxyType({
    "every": lambda sample: np.ones(sample.n),
    "failed": counted("arms", "failed"),
    "failed_strategy": counted("arms", "failed_strategy"),
    "met": counted("passages", "av", "driven", "met"),
    "fell_back": counted("passages", "av", "driven", "fell_back"),
    "fell_back_met": counted("passages", "av", "driven", "met", "fell_back"),
    "sumo_alone": counted("passages", "sumo_alone"),
    "conditionings": summed("arms", "conditionings"),
    "clamped": summed("arms", "clamped"),
    "growth": SimulationSample.growth,
    "long_trips": lambda s: np.isnan(s["growth"]) & (s[counted("vehicles")] > 0),
    "throughput_per_hour": lambda s: (SECONDS_PER_HOUR * s[counted("passages", "passed")]
                                      / s[summed("arms", "counted_s")]),
})  # fmt: skip
"""Columns with a name of their own."""
