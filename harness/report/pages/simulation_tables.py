"""The tables of groups and of crosswalks on the page of a user's own simulation."""

from collections.abc import Mapping, Sequence

import pyarrow as pa

from harness.core.encounter import Arm
from harness.report.screens.tables import ARM_NAMES, Table, TableCell
from harness.scenario import as_written
from harness.store.tables import CROSSWALK_FIELDS, GROUP_FIELDS, Row
from harness.studies.runs.run_data import RunData

_MOST_ROWS = 400
"""Maximum number of rows; the Parquet table has all rows."""

_GROUPS = {
    "trips": "trips",
    "departed": "departed",
    "arrived": "arrived",
    "duration_s": "duration (s)",
    "time_loss_s": "time loss (s)",
    "waiting_s": "waiting (s)",
    "stops": "stops",
    "co2_g": "CO₂ (g)",
    "nox_mg": "NOₓ (mg)",
    "pmx_mg": "particles (mg)",
    "fuel_g": "fuel (g)",
    "electricity_wh": "electricity (Wh)",
}
_TRAFFIC = {
    "passages": "passages",
    "automated": "of AVs",
    "not_driven": "SUMO's",
    "turning": "turning",
    "bending": "bending",
    "people": "people",
}
_DELAYS = {
    "vehicle_delay_s": "delay of vehicles (s)",
    "pedestrian_wait_s": "wait of people (s)",
    "queue_mean_m": "mean queue (m)",
    "queue_p95_m": "queue, 95 % (m)",
}
_CONFLICTS = {
    "reached": "reached it",
    "crashes": "contacts",
    "conflicts_pet": "by PET",
    "conflicts_ttc": "by TTC",
    "conflicts_drac": "by DRAC",
    "conflicts_time_advantage": "by T_adv",
    "conflicts_unreached": "before it",
    "sumo_collisions": "by SUMO",
}


def group_and_crosswalk_tables(run: RunData) -> list[Table]:
    """Return the tables of trips by group, and of traffic and conflicts by crosswalk."""
    return [
        _table(
            run,
            "groups",
            "Trips by group: sums over pairs of trips, means over pairs of the others",
            _GROUPS,
        ),
        _table(
            run,
            "crosswalks",
            "Crosswalks: passages straight on, those of AVs, and those that no strategy may drive "
            "(SUMO's); vehicles that turn or whose way bends are not measured. Sums over pairs",
            _TRAFFIC,
            "crosswalk-traffic",
        ),
        _table(
            run,
            "crosswalks",
            "Delays and queues at the crosswalks: means over pairs",
            _DELAYS,
            "crosswalk-delays",
        ),
        _table(
            run,
            "crosswalks",
            "Conflicts at the crosswalks: vehicles that reached it, those with a conflict of each "
            "kind, with one before they reached it, and collisions by SUMO. Sums over pairs",
            _CONFLICTS,
            "crosswalk-conflicts",
        ),
    ]


def _table(
    run: RunData, source: str, caption: str, headings: Mapping[str, str], name: str = ""
) -> Table:
    """Return a table with a row for each cell, value of the key, and arm."""
    key = source.removesuffix("s")
    table = run.derived(source)
    groups: dict[tuple[int, str, str], list[Row]] = {}
    for row in table.to_pylist():
        groups.setdefault((row["cell"], row[key], row["arm"]), []).append(row)
    # The rows of a crosswalk's two arms are adjacent.
    order = {where: place for place, where in enumerate(dict.fromkeys(w[:2] for w in groups))}
    wheres = sorted(groups, key=lambda where: (order[where[:2]], [*Arm].index(Arm(where[2]))))
    kept = [column for column in headings if _any(table, column)]
    counts = {
        column
        for column, kind in (GROUP_FIELDS | CROSSWALK_FIELDS).items()
        if pa.types.is_integer(kind)
    }
    rows = []
    for cell, value, arm in wheres[:_MOST_ROWS]:
        members = groups[cell, value, arm]
        varied = run.study.cells[cell].varied
        rows.append(
            (
                *(TableCell(as_written(varied[each])) for each in run.varied_keys),
                TableCell(value),
                TableCell(ARM_NAMES[Arm(arm)]),
                *(_cell([row[column] for row in members], column in counts) for column in kept),
            )
        )
    if len(wheres) > _MOST_ROWS:
        caption += f"; {source}.parquet has {len(wheres) - _MOST_ROWS:,} more rows"
    titles = (*run.varied_keys, key, "arm", *(headings[column] for column in kept))
    return Table(name or source, caption, titles, tuple(rows), sortable=True, folded=True)


def _any(table: pa.Table, column: str) -> bool:
    return bool(table[column].null_count < table.num_rows)


def _cell(values: Sequence[float | None], count: bool) -> TableCell:
    """Return the sum of counts, or the mean of the defined values."""
    defined = [value for value in values if value is not None]
    if not defined:
        return TableCell("–", sort="")
    total = sum(defined)
    if count:
        return TableCell(f"{total:,}", sort=f"{total}")
    mean = total / len(defined)
    return TableCell(f"{mean:,.1f}", sort=f"{mean:.6g}")
