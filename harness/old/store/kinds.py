"""The kinds of run: hours of traffic, and users' own simulations.

A kind says which tables a run has, and how its findings are computed from them.  The rooms that
write, read and show runs use this Protocol, so they need not know which kind a run is.  Functions
that need an engine or a page are listed under the kind's name in ``studies.kinds.table``,
``studies.runs.views`` and ``report.pages.kinds``.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import pyarrow as pa
import pyarrow.compute as pc

from harness.core.encounter import Arm
from harness.core.errors import InputError
from harness.old.statistics import (
    CONFIDENCE,
    Catalogue,
    Finding,
    Findings,
    Plain,
    findings_of,
)
from harness.old.store.arm_columns import arm_columns
from harness.old.store.hour_catalogue import HOURS
from harness.old.store.hour_columns import hour_columns
from harness.old.store.schemas import (
    HOUR_TABLES,
    HOUR_TRACES,
    SIMULATION_TABLES,
    SIMULATION_TRACES,
    hour_tables,
)
from harness.old.store.simulations.simulation_catalogue import SIMULATIONS
from harness.old.store.simulations.simulation_statistics import crosswalk_rows
from harness.old.store.simulations.simulation_tables import crosswalks_of_cell
from harness.scenario import Cell, Scenario, Study

Rows = list[dict[str, Plain]]

Derive = Callable[[int, pa.Table], pa.Table]
"""Makes a table from a cell's number and rows."""


class Kind(Protocol):
    """A kind of run.

    Attributes:
        name: the key of the kind in the literal tables.
        section: the table of a scenario that selects this kind, for messages.
        ranked: the table whose rows ``harness worst`` ranks, and the columns that identify a row
            within its arm.  The table has the columns of the table ``episodes``.
        records: the tables with the results of a pair.
        shown: the tables with which a pair is shown: all states, and the people.
        catalogue: every number that such a run reports.
        rows: the table from which findings are computed; each pair has two rows, the AV's first.
        derived: further tables, each with the function that computes a cell's part from ``rows``.
    """

    @property
    def name(self) -> str: ...

    @property
    def section(self) -> str: ...

    @property
    def ranked(self) -> tuple[str, tuple[str, ...]]: ...

    @property
    def records(self) -> tuple[str, ...]: ...

    @property
    def shown(self) -> tuple[str, str]: ...

    @property
    def catalogue(self) -> Catalogue: ...

    @property
    def rows(self) -> str: ...

    def tables(self, *, traces: bool) -> list[str]:
        """The tables that the tasks of such a run return, and its shards hold."""
        ...

    @property
    def derived(self) -> Mapping[str, Derive]: ...

    def findings(
        self,
        rows: pa.Table,
        cell: Cell,
        confidence: float,
        names: Collection[str] | None = None,
    ) -> dict[str, Finding]:
        """The findings of a cell, from its rows by pair; with ``confidence`` 0 without intervals.

        With ``names`` they are those of the entries of these numbers alone.

        Raises:
            InputError: the rows do not have both arms of each pair.
        """
        ...

    def statistics(self, rows: pa.Table, cell: Cell, findings: Findings) -> Mapping[str, Rows]:
        """The rows of further CSV files about a cell, by file name, without the cell's keys."""
        ...

    def counts(self, rows: pa.Table) -> dict[str, int]:
        """The counts of some rows for the manifest."""
        ...

    def failed(self, rows: pa.Table) -> pa.Table:
        """The rows of arms that failed."""
        ...

    def given_up(self, reason: str) -> Rows:
        """The two rows of a pair that no worker survived, without ``cell`` and ``pair``."""
        ...


@dataclass(frozen=True)
class HourKind:
    """Hours of traffic."""

    name: str = "hours of traffic"
    section: str = "[traffic]"
    ranked: tuple[str, tuple[str, ...]] = ("episodes", ())
    records: tuple[str, ...] = HOUR_TABLES
    shown: tuple[str, str] = HOUR_TRACES
    catalogue: Catalogue = HOURS
    rows: str = "hours"
    derived: Mapping[str, Derive] = field(default_factory=dict)

    def tables(self, *, traces: bool) -> list[str]:
        """See ``Kind``."""
        return hour_tables(traces=traces)

    def findings(
        self,
        rows: pa.Table,
        cell: Cell,
        confidence: float,
        names: Collection[str] | None = None,
    ) -> dict[str, Finding]:
        """See ``Kind``."""
        return findings_of(self.catalogue, hour_columns(rows, cell.scenario, confidence), names)

    def statistics(self, rows: pa.Table, cell: Cell, findings: Findings) -> Mapping[str, Rows]:  # noqa: ARG002
        """See ``Kind``."""
        return {}

    def counts(self, rows: pa.Table) -> dict[str, int]:
        """See ``Kind``."""
        failed = rows.num_rows - rows["reason"].null_count
        return {"pairs": rows.num_rows // 2, "hours": rows.num_rows, "engine_failed": failed}

    def failed(self, rows: pa.Table) -> pa.Table:
        """See ``Kind``."""
        return rows.filter(pc.is_valid(rows["reason"]))

    def given_up(self, reason: str) -> Rows:
        """See ``Kind``."""
        return [{"arm": arm.value, "reason": reason} for arm in Arm]


@dataclass(frozen=True)
class SimulationKind(HourKind):
    """A user's own SUMO scenario, from its begin to its end."""

    name: str = "own simulations"
    section: str = "[simulation]"
    ranked: tuple[str, tuple[str, ...]] = ("passages_over", ("crosswalk", "vehicle", "trigger_s"))
    records: tuple[str, ...] = SIMULATION_TABLES
    shown: tuple[str, str] = SIMULATION_TRACES
    catalogue: Catalogue = SIMULATIONS
    rows: str = "simulations"
    derived: Mapping[str, Derive] = field(
        default_factory=lambda: {"crosswalks": crosswalks_of_cell}
    )

    def tables(self, *, traces: bool) -> list[str]:
        """See ``Kind``."""
        return [*SIMULATION_TABLES, *(SIMULATION_TRACES if traces else ())]

    def findings(
        self,
        rows: pa.Table,
        cell: Cell,  # noqa: ARG002
        confidence: float,
        names: Collection[str] | None = None,
    ) -> dict[str, Finding]:
        """See ``Kind``."""
        return findings_of(self.catalogue, arm_columns(rows, self.rows, confidence), names)

    def statistics(
        self,
        rows: pa.Table,
        cell: Cell,  # noqa: ARG002
        findings: Findings,
    ) -> Mapping[str, Rows]:
        """See ``Kind``."""
        confidence = float(findings["confidence"].number or CONFIDENCE)
        return {"crosswalk_means": crosswalk_rows(rows, confidence)}

    def counts(self, rows: pa.Table) -> dict[str, int]:
        """See ``Kind``."""
        failed = rows.num_rows - rows["reason"].null_count
        return {"pairs": rows.num_rows // 2, "arms": rows.num_rows, "engine_failed": failed}


KINDS: Mapping[str, Kind] = {kind.name: kind for kind in (HourKind(), SimulationKind())}
"""Every kind by name."""


def kind_of(scenario: Scenario) -> Kind:
    """The kind of a run of this scenario.

    Raises:
        InputError: the run is one of encounters, in the format of an earlier version.
    """
    if scenario.kind not in KINDS:
        raise InputError("scenario", f"is one of {scenario.kind}", " or ".join(KINDS))
    return KINDS[scenario.kind]


def kind_of_study(study: Study) -> Kind:
    """The kind of a run of this study; all its cells are of one kind."""
    return kind_of(study.cells[0].scenario)
