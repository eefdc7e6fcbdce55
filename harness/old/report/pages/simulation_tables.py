"""The tables of crosswalks on the page of a user's own simulation."""

from collections.abc import Mapping

from harness.core.encounter import Arm
from harness.old.report.screens.paired_tables import paired_tables
from harness.old.report.screens.tables import ARM_NAMES, Table, TableCell, count_cell
from harness.old.store.tables import Row
from harness.old.studies.runs.run_data import RunData
from harness.scenario import as_written

_MOST_ROWS = 400
"""Maximum number of rows; the Parquet table has all rows."""

_TRAFFIC = {
    "passages": "passages",
    "automated": "of AVs",
    "not_driven": "SUMO's",
    "turning": "turning",
    "bending": "bending",
    "people": "people",
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


def crosswalk_tables(run: RunData) -> list[Table]:
    """Return the tables of traffic and conflicts by crosswalk."""
    return [
        *paired_tables(run),
        _table(
            run,
            "Crosswalks: passages straight on, those of AVs, and those that no strategy may drive "
            "(SUMO's); vehicles that turn, or whose way bends within 10 m before the crosswalk or "
            "before the rear has left it, are not measured. Sums over pairs",
            _TRAFFIC,
            "crosswalk-traffic",
        ),
        _table(
            run,
            "Conflicts at the crosswalks: vehicles that reached it, those with a conflict of each "
            "kind, with one before they reached it, and collisions by SUMO. Sums over pairs",
            _CONFLICTS,
            "crosswalk-conflicts",
        ),
    ]


def _table(run: RunData, caption: str, headings: Mapping[str, str], name: str) -> Table:
    """Return a table of sums over pairs, with a row for each cell, crosswalk and arm."""
    groups: dict[tuple[int, str, str], list[Row]] = {}
    for row in run.table("crosswalks").to_pylist():
        groups.setdefault((row["cell"], row["crosswalk"], row["arm"]), []).append(row)
    # The rows of a crosswalk's two arms are adjacent.
    order = {where: place for place, where in enumerate(dict.fromkeys(w[:2] for w in groups))}
    wheres = sorted(groups, key=lambda where: (order[where[:2]], [*Arm].index(Arm(where[2]))))
    rows = []
    for cell, value, arm in wheres[:_MOST_ROWS]:
        members = groups[cell, value, arm]
        varied = run.study.cells[cell].varied
        rows.append(
            (
                *(TableCell(as_written(varied[each])) for each in run.varied_keys),
                TableCell(value),
                TableCell(ARM_NAMES[Arm(arm)]),
                *(count_cell(sum(row[column] for row in members)) for column in headings),
            )
        )
    if len(wheres) > _MOST_ROWS:
        caption += f"; crosswalks.parquet has {len(wheres) - _MOST_ROWS:,} more rows"
    titles = (*run.varied_keys, "crosswalk", "arm", *headings.values())
    return Table(name, caption, titles, tuple(rows), sortable=True, folded=True)
