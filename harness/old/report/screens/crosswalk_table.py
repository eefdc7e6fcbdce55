"""The table of the crosswalks in a user's own scenario, with their traffic."""

from collections.abc import Sequence
from pathlib import Path

from harness.core.errors import one_line
from harness.encounter.simulation.listing import CrosswalkRow
from harness.old.report.screens.console import make_console, print_table
from harness.old.report.screens.tables import DASH, Table, TableCell, counted, number


def print_crosswalks(config: Path, rows: Sequence[CrosswalkRow], simulated_s: float) -> None:
    """Print one row per crosswalk; the caption has the time that was counted."""
    usable = sum(row.usable for row in rows)
    caption = f"{config}: {counted(len(rows), 'crosswalk')}, {usable} usable"
    caption += f", counted for {simulated_s:,.0f} s"
    console = make_console()
    if rows:
        print_table(console, crosswalk_table(caption, rows))
    else:
        console.print(caption)


def crosswalk_table(caption: str, rows: Sequence[CrosswalkRow]) -> Table:
    """Return the crosswalks as a table, with the reason if one cannot be chosen."""
    headings = (
        "crosswalk",
        "vehicles per hour",
        "straight on",
        "people per hour",
        "limit, m/s",
        "straight, m",
        "roads",
        "usable",
    )
    return Table("crosswalks", caption, headings, tuple(map(_cells, rows)))


def _cells(row: CrosswalkRow) -> tuple[TableCell, ...]:
    roads = one_line(" / ".join(row.streets))
    values = (
        (row.vehicles_per_hour, 0),
        (row.straight_per_hour, 0),
        (row.people_per_hour, 0),
        (row.speed_limit_mps, 1),
        (row.straight_m, 0),
    )
    return (
        TableCell(one_line(row.edge)),
        *(TableCell(DASH if value is None else number(value, digits)) for value, digits in values),
        TableCell(roads),
        TableCell("yes" if row.problem is None else f"no: {one_line(row.problem)}"),
    )
