"""The first screen of a validation, and the tables of the terminal and the page."""

from collections.abc import Iterable
from typing import Any

from harness.old.report.screens.console import make_console, print_table
from harness.old.report.screens.screen import MOST_LINES, Screen, screen_lines
from harness.old.report.screens.tables import (
    Table,
    TableCell,
    count_cell,
    counted,
    entry_heading,
    entry_limits,
    entry_value,
    sort_key,
)
from harness.old.statistics.entries import Entry
from harness.old.studies.validation import ENTRIES, LEFT_OUT, DriverFindings, ValidationFindings

READING = (
    "Drivers are ranked by the mean score of the pass time; without randomness it is the mean "
    "absolute error. Intervals are 95 % of a bootstrap over vehicles. Recorded pedestrians do not "
    "react, so contacts count against every driver. The number in brackets counts the contacts "
    "that happened only because of this."
)
_RANKED = [entry for entry in ENTRIES if entry.first_screen and not entry.key.startswith("cont")]
_RECORDED = {"order_right": "100.0 %"}


def print_validation(findings: ValidationFindings, full: bool = False) -> None:
    """Print the first screen, or every note and number with ``full``."""
    console = make_console()
    for line in screen_lines(validation_screen(findings, full=full), console.width):
        console.print(line)
    if full:
        for table in validation_tables(findings):
            print_table(console, table)
        console.print(READING)


def validation_screen(findings: ValidationFindings, *, full: bool = False) -> Screen:
    """Return the first screen with a row for each driver; ``full`` removes its limit of lines."""
    rows = []
    for driver in findings.drivers:
        score, *others = (entry_value(entry, driver.findings[entry.key]) for entry in _RANKED)
        interval = entry_limits(_RANKED[0], driver.findings[_RANKED[0].key])
        score += f" ({interval})" if interval else ""
        rows.append((driver.driver, score, *others, _contacts(driver)))
    return Screen(
        title=f"Drivers compared with recordings of {', '.join(findings.sources)}, nearest first",
        scope=scope(findings),
        headings=("", *(entry_heading(entry, {}) for entry in _RANKED), "contacts"),
        rows=tuple(rows),
        notes=findings.notes,
        footer="All numbers: --full. Page: --out DIR",
        most_lines=None if full else MOST_LINES,
    )


def scope(findings: ValidationFindings) -> str:
    """Return the size of the recorded data, in words."""
    passages = counted(findings.passages, "passage")
    contacts = counted(findings.contacts_recorded, "contact")
    return f"{passages} of {counted(findings.vehicles, 'vehicle')}, {contacts}"


def validation_tables(findings: ValidationFindings) -> list[Table]:
    """Return tables of the ranking, the other findings, and the excluded passages."""
    first = [entry for entry in ENTRIES if entry.key.startswith(("pass_time", "order_right"))]
    others = [
        entry for entry in ENTRIES if entry not in first and not entry.key.startswith("contacts")
    ]
    ranking = [
        (
            TableCell(str(driver.rank), sort=str(driver.rank)),
            TableCell(driver.driver, _fitted(driver)),
            *_cells(driver, first),
            TableCell(_contacts(driver), sort=sort_key(driver.findings["contacts"].number)),
            TableCell(", ".join(driver.not_told_apart) or "–"),
        )
        for driver in findings.drivers
    ]
    recorded = (TableCell(_RECORDED.get(entry.key, "0"), sort="0") for entry in first)
    contacts = count_cell(findings.contacts_recorded)
    ranking.append(
        (TableCell(""), TableCell("recorded drivers"), *recorded, contacts, TableCell(""))
    )
    further = [(TableCell(driver.driver), *_cells(driver, others)) for driver in findings.drivers]
    left_out = [
        (TableCell(reason), count_cell(count), TableCell(LEFT_OUT[reason]))
        for reason, count in findings.left_out.items()
    ]
    names = [[entry_heading(entry, {}) for entry in entries] for entries in (first, others)]
    return [
        Table(
            "validation",
            "Pass time, simulated minus recorded; who passes first",
            ("", "driver", *names[0], "contacts", "not told apart from"),
            tuple(ranking),
            sortable=True,
        ),
        Table(
            "validation-further",
            "Root mean square errors of position; Wasserstein distances of distributions; in "
            f"brackets the passages used, of {findings.passages:,}",
            ("driver", *names[1]),
            tuple(further),
            sortable=True,
        ),
        Table("validation-left-out", "Left out", ("reason", "number", "rule"), tuple(left_out)),
    ]


def _cells(driver: DriverFindings, entries: Iterable[Entry[Any]]) -> list[TableCell]:
    """Return each number above its limits, with the passages used if it may leave some out."""
    return [
        TableCell(
            entry_value(entry, finding) + (f" ({finding.n:,})" if finding.n is not None else ""),
            entry_limits(entry, finding),
            sort_key(finding.number),
        )
        for entry in entries
        for finding in [driver.findings[entry.key]]
    ]


def _fitted(driver: DriverFindings) -> str:
    if driver.folds:
        return f"fitted again without each of {driver.folds} folds"
    return "fitted on these data" if driver.fitted_on_these_data else ""


def _contacts(driver: DriverFindings) -> str:
    """Return the passages with a contact; in brackets, how many happened only without reactions."""
    contacts, explained = (
        f"{round(driver.findings[key].number or 0.0, 1):g}"
        for key in ("contacts", "contacts_explained")
    )
    return f"{contacts} ({explained})"
