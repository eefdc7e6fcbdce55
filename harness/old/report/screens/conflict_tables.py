"""The first screen of a recording's conflicts, and the tables of the terminal and the page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.core.encounter import Ending
from harness.measures.catalogue import MEASURES, Measure
from harness.old.report.screens.console import make_console, print_table
from harness.old.report.screens.screen import MOST_LINES, Screen, screen_lines
from harness.old.report.screens.tables import (
    DASH,
    Table,
    TableCell,
    count_cell,
    counted,
    number,
    sort_key,
)
from harness.old.statistics.conflicts import CONFLICTS
from harness.old.statistics.findings import Note, Rank
from harness.old.studies.conflicts import REASONS, ConflictFindings, worst_rows

MOST_WORST = 20
_MOST_ROWS = 6
_FROM_SPEEDS = (
    *("max_deceleration_mps2", "max_jerk_mps3"),
    *("rms_acceleration_mps2", "rms_jerk_mps3"),
)
_ON_STEP = {
    "exact": "computed between records: the step changes it only if vehicles or people move "
    "differently between records than assumed",
    "states": "an extreme over the records: a shorter step has more records, so the extreme can "
    "only become worse",
    "steps": "counted in steps: whole multiples of a step",
}
_FROM_DIFFERENCES = "a difference of two speeds: its resolution depends on decimals and step"


def print_conflicts(findings: ConflictFindings, folder: Path, full: bool = False) -> None:
    """Print the first screen, or every table with ``full``."""
    console = make_console()
    for line in screen_lines(conflict_screen(findings, folder, full=full), console.width):
        console.print(line, soft_wrap=True)
    if full:
        for table in conflict_tables(findings):
            print_table(console, table)


def conflict_screen(findings: ConflictFindings, folder: Path, *, full: bool = False) -> Screen:
    """Return the first screen: the crosswalks with the most conflicts, and notes."""
    rows = [each.row(findings.thresholds) for each in findings.crosswalks]
    rows.sort(key=lambda row: (-row["contacts"], -row["conflicts_pet"], -row["with_people"]))
    shown = [row for row in rows if row["with_people"]][: None if full else _MOST_ROWS]
    total = {
        name: sum(row[name] for row in rows)
        for name in ("people", "passages", "with_people", "contacts", "conflicts_pet", *REASONS)
    } | {
        "crosswalk": "all",
        "conflicts_ttc": sum(row["conflicts_ttc"] for row in rows),
        "min_pet_s": min(
            (r["min_pet_s"] for r in rows if r["min_pet_s"] is not None), default=None
        ),
    }
    limits = findings.thresholds
    return Screen(
        title=f"Conflicts of people and vehicles at {counted(len(rows), 'crosswalk')}",
        scope=f"{counted(total['passages'], 'passage')}, {counted(total['people'], 'walk')}",
        headings=(
            "",
            "passages with people",
            "contacts",
            f"PET < {limits.pet_s:g} s",
            f"TTC < {limits.ttc_s:g} s",
            "smallest PET, s",
        ),
        rows=tuple(
            (
                str(row["crosswalk"]),
                f"{row['with_people']:,} of {row['passages']:,}",
                f"{row['contacts']:,}",
                f"{row['conflicts_pet']:,}",
                f"{row['conflicts_ttc']:,}",
                DASH if row["min_pet_s"] is None else number(row["min_pet_s"], 2),
            )
            for row in [total, *shown]
        ),
        notes=tuple(sorted(notes_of(findings))),
        footer=f"All crosswalks and measures: --full. Page: {folder / 'report.html'}",
        most_lines=None if full else MOST_LINES,
    )


def notes_of(findings: ConflictFindings) -> list[Note]:
    """Return the notes that a reader needs for the numbers."""
    notes = []
    left_out = {
        reason: sum(each.not_measured.get(reason, 0) for each in findings.crosswalks)
        for reason in REASONS
    }
    words = ", ".join(f"{count:,} {reason}" for reason, count in left_out.items() if count)
    if words:
        notes.append(Note(Rank.LEFT_OUT, f"Passages counted and not measured: {words}."))
    if findings.unusable:
        first, why = next(iter(findings.unusable.items()))
        count = counted(len(findings.unusable), "crosswalk")
        notes.append(Note(Rank.LEFT_OUT, f"Nothing is measured at {count}: {first} ({why})."))
    if findings.undefined_types:
        names = ", ".join(name or "(none)" for name in list(findings.undefined_types)[:3])
        count = counted(sum(findings.undefined_types.values()), "passage")
        text = (
            f"{count} of vehicle types without a definition ({names}) are measured as those of "
            "cars of 5 m; --types FILE defines the types."
        )
        notes.append(Note(Rank.OUTSIDE_MODEL, text))
    notes.append(Note(Rank.FEW_PAIRS, _joined(findings)))
    return notes


def _joined(findings: ConflictFindings) -> str:
    """Describe how records are interpolated, and the effect of the time step on the measures."""
    how = {
        "euler": "in each step vehicles drive at its final speed (Euler), which fits the records",
        "ballistic": "in each step vehicles accelerate evenly (ballistic), which fits the records",
    }[findings.motion]
    if findings.by_places:
        how = (
            "vehicles move evenly between records, because their speeds do not fit their positions"
        )
    return (
        f"Records are {findings.step_s:g} s apart: {how}; people walk straight. TTC, DRAC and time "
        "advantage are extremes over the records."
    )


def conflict_tables(findings: ConflictFindings) -> list[Table]:
    """Return tables of crosswalks, worst passages, measures, and passages that are not measured."""
    rows = [each.row() for each in findings.passages]
    return [
        _crosswalks(findings),
        worst_table(worst_rows(rows, "pet_s", MOST_WORST), "pet_s"),
        _measures(findings, rows),
        Table(
            "not-measured",
            "Passages that are counted and not measured",
            ("reason", "passages", "rule"),
            tuple(
                (
                    TableCell(reason),
                    count_cell(sum(c.not_measured.get(reason, 0) for c in findings.crosswalks)),
                    TableCell(rule),
                )
                for reason, rule in REASONS.items()
            ),
            folded=True,
        ),
    ]


def _crosswalks(findings: ConflictFindings) -> Table:
    limits = findings.thresholds
    kinds = [kind.heading.format_map(limits.model_dump()) for kind in CONFLICTS]
    rows = []
    for each in findings.crosswalks:
        row = each.row(limits)
        counts = ("people", "passages", "with_people", "contacts")
        rows.append(
            (
                TableCell(row["crosswalk"], "light" if row["signalled"] else ""),
                *(count_cell(row[name]) for name in counts),
                *(count_cell(row[f"conflicts_{kind.name}"]) for kind in CONFLICTS),
                *(_cell(row[name]) for name in ("min_pet_s", "min_ttc_s", "max_drac_mps2")),
                *(count_cell(row[reason]) for reason in REASONS),
            )
        )
    headings = (
        *("crosswalk", "people", "passages", "with people", "contacts", *kinds),
        *("smallest PET, s", "smallest TTC, s", "largest DRAC, m/s²", *REASONS),
    )
    return Table("crosswalks", "Crosswalks", headings, tuple(rows), sortable=True)


def _cell(value: float | None) -> TableCell:
    return TableCell(DASH if value is None else number(value, 2), sort=sort_key(value))


def worst_table(rows: Sequence[Mapping[str, Any]], by: str) -> Table:
    """Return a table of the worst passages, with place, time and measure."""
    names = {"min_ttc_s": "TTC, s", "max_drac_mps2": "DRAC, m/s²", "pet_s": "PET, s"}
    columns = [by, *(name for name in ("pet_s", "min_ttc_s", "max_drac_mps2") if name != by)]
    cells = [
        (
            TableCell(row["crosswalk"]),
            TableCell(row["vehicle"], row["type"]),
            _cell(row["edge_s"]),
            TableCell(_ending(row)),
            *(_cell(row[name]) for name in columns),
        )
        for row in rows
    ]
    headings = (
        *("crosswalk", "vehicle", "at its edge, s", "ending"),
        *(names.get(name, name) for name in columns),
    )
    caption = f"Worst passages by {by}" if rows else f"No passage to look at, by {by}"
    return Table("worst", caption, headings, tuple(cells))


def _ending(row: Mapping[str, Any]) -> str:
    if row["ending"] == Ending.CRASHED:
        speed = number(row["contact_speed_mps"], 2)
        return f"{row['contact']} touched {row['contact_person']} at {speed} m/s"
    return str(row["ending"]).replace("_", " ")


def _measures(findings: ConflictFindings, rows: Sequence[Mapping[str, Any]]) -> Table:
    cells = []
    for measure in MEASURES:
        values = sorted(
            float(row[measure.column]) for row in rows if row[measure.column] is not None
        )
        middle = values[len(values) // 2] if values else None
        worst = None
        if values and measure.worse is not None:
            worst = values[0] if measure.worse == "small" else values[-1]
        unit = f", {measure.unit}" if measure.unit else ""
        cells.append(
            (
                TableCell(f"{measure.column}{unit}", measure.formula),
                count_cell(len(values)),
                _cell(middle),
                _cell(worst),
                TableCell(on_step(measure)),
            )
        )
    caption = f"Every measure, and how it depends on the step ({findings.step_s:g} s)"
    headings = ("measure", "defined in", "median", "worst", "the step")
    return Table("measures", caption, headings, tuple(cells), folded=True, brief=True)


def on_step(measure: Measure) -> str:
    """Return the effect of the time between two records on a measure."""
    return _FROM_DIFFERENCES if measure.column in _FROM_SPEEDS else _ON_STEP[measure.on_step]
