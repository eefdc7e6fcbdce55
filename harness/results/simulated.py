"""A cell's simulations as aligned columns: one entry for each pair, of both arms."""

from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from harness.core.encounter import LIMITED_BY, SECONDS_PER_HOUR, Arm, FloatArray
from harness.measures.queues import growth
from harness.results.columns import AV
from harness.results.estimators import Sampling
from harness.results.tables import Tables
from harness.scenario import Scenario
from harness.scenario.sections import ConflictsSection

_OF = pc.field
_TOUCHED = _OF("contact_person").is_valid()
_REACHED = _OF("front_s").is_valid() | _TOUCHED


def which(name: str, limits: ConflictsSection) -> pc.Expression:
    """The rows of a table that a column counts; a contact is a conflict of every kind."""
    # fmt: off
    return {
        "failed": _OF("reason").is_valid(), "av": _OF("automated"), "other": ~_OF("automated"),
        "driven": _OF("driven"), "left": ~_OF("driven"), "fell_back": _OF("fallback"),
        "reached": _REACHED, "passed": _OF("rear_s").is_valid(),
        "cut_off": _OF("rear_s").is_null(), "touched": _TOUCHED,
        "pet": _REACHED & ((_OF("pet_s") < limits.pet_s) | _TOUCHED),
        "ttc": _REACHED & ((_OF("min_ttc_s") < limits.ttc_s) | _TOUCHED),
        "drac": _REACHED & ((_OF("max_drac_mps2") > limits.drac_mps2) | _TOUCHED),
        "met": _OF("pedestrians") > 0, "waited": _OF("let_go").is_valid(), "let_go": _OF("let_go"),
        "never_went": _OF("start_s").is_null(), "unfinished": _OF("arrival_s").is_null(),
    }[name]
    # fmt: on


class SimulationSample(dict[str, np.ndarray]):
    """The simulations of one cell, over all chosen crosswalks or over one of them.

    A column is of both arms, shape (2, n) with the AV's first, or of the pairs, shape (n,); it is
    made when it is asked for.  Its name is a key of ``COLUMNS``, or says how it is found: ``mean``,
    ``max``, ``sum``, ``count`` or ``count_distinct``, then ``TABLE.COLUMN``, or the table alone if
    rows are counted, and names of ``which`` that all hold, as in ``count passages av touched``.
    Means and maxima are NaN where no row counts, and all but ``failed`` where an arm failed.

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
        self.samplings = (Sampling(None, confidence), Sampling(None, confidence))
        failed = tables["arms"].filter(_OF("reason").is_valid())["pair"]
        counts = ~_OF("pair").isin(failed.combine_chunks())
        here = counts if crosswalk is None else counts & (_OF("crosswalk") == crosswalk)
        self.tables = {
            name: of.filter(here if "crosswalk" in of.column_names else counts)
            for name, of in tables.items()
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

    def __missing__(self, name: str) -> np.ndarray:
        own = COLUMNS.get(name, name)
        values = self._found(own) if isinstance(own, str) else own(self)
        if name not in ("every", "failed"):
            values = np.where(self["failed"].any(axis=0), np.nan, values)
        return self.setdefault(name, values)

    def _found(self, name: str) -> FloatArray:
        how, place, *rows = name.split()
        kept, column, *_ = [*place.split("."), "pair"]
        for each in rows:
            whole, kept = self.tables[kept], f"{kept} {each}"
            if kept not in self.tables:  # many columns are of the same rows
                self.tables[kept] = whole.filter(which(each, self.scenario.conflicts))
        found = self.tables[kept].group_by(["pair", "arm"]).aggregate([(column, how)])
        values = np.full((2, self.n), np.nan if how in ("mean", "max") else 0.0)
        arm = pc.equal(found["arm"], Arm.HUMAN.value).to_numpy().astype(int)
        values[arm, found["pair"].to_numpy()] = found[f"{column}_{how}"].cast(pa.float64())
        return values

    def growth(self) -> FloatArray:
        """By what share of the vehicles due in a third the network fills; see ``queues.growth``."""
        found = np.full((2, self.n), np.nan)
        for number, arm in enumerate(self.tables["arms"].to_pylist()):
            own = (_OF("pair") == arm["pair"]) & (_OF("arm") == arm["arm"])
            rows, begin_s = self.tables["vehicles"].filter(own), arm["begin_s"]
            if begin_s is not None:
                due_s, left_s = (rows[name].to_numpy() for name in ("due_s", "arrival_s"))
                filled = growth(due_s, left_s, begin_s, begin_s + arm["counted_s"])
                found[number % 2, number // 2] = filled
        return found

    def why_not_driven(self) -> str | None:
        """Why no strategy drove AVs in the AV's arm, with the numbers of passages, in words."""
        left = _OF("automated") & ~_OF("driven") & (_OF("arm") == Arm.AV.value)
        whys = self.tables["passages"].filter(left)["not_driven_because"].to_pylist()
        found = Counter(why or "for no known reason" for why in whys)
        return "; ".join(f"{count:,} {why}" for why, count in found.most_common()) or None


COLUMNS: Mapping[str, str | Callable[[SimulationSample], np.ndarray]] = {
    "every": lambda sample: np.ones(sample.n),
    "failed": "count arms failed",
    "met": "count passages av driven met",
    "fell_back": "count passages av driven met fell_back",
    "conditionings": "sum arms.conditionings",
    "clamped": "sum arms.clamped",
    "growth": SimulationSample.growth,
    "long_trips": lambda sample: np.isnan(sample["growth"]) & (sample["count vehicles"] > 0),
    "throughput_per_hour": lambda s: (
        SECONDS_PER_HOUR * s["count passages passed"] / s["sum arms.counted_s"]
    ),
}
"""Columns with a name of their own."""
