"""The first screen and the tables of ``harness validate people``."""

from harness.report.screens.console import make_console, print_table
from harness.report.screens.screen import MOST_LINES, Screen, screen_lines
from harness.report.screens.tables import Table, TableCell, number, sort_key
from harness.statistics.findings import Note, Rank
from harness.studies.validation.people import Held, PeopleFindings, Row
from harness.studies.validation.people.findings import Scores

_DIGITS = {"": 3}
"""Decimals by the name of a number: shares have three, times two."""


def print_people(findings: PeopleFindings, full: bool = False) -> None:
    """Print the first screen, or a table of every experiment with ``full``."""
    console = make_console()
    for line in screen_lines(people_screen(findings, full=full), console.width):
        console.print(line)
    if full:
        for held in findings.held:
            print_table(console, people_table(held))
            console.print(f"Source: {held.experiment.source}.")


def people_screen(findings: PeopleFindings, *, full: bool = False) -> Screen:
    """Return the first screen with a row for each experiment and driver."""
    hours = f", {findings.hours} h a site" if findings.hours else ""
    return Screen(
        title=f"{findings.behaviour} and {', '.join(findings.drivers)} beside measured people",
        scope=f"{findings.trials:,} trials a cell{hours}, seed {findings.seed}",
        headings=("", "mean error", "mean |error|", "R²", "measured with"),
        rows=tuple(row for held in findings.held for row in _rows(held)),
        notes=tuple(_notes(findings)),
        footer="Every cell, with standard errors and sources: --full",
        always=5,
        most_lines=None if full else MOST_LINES,
    )


def people_table(held: Held) -> Table:
    """Return the cells of one experiment, simulated beside measured."""
    handbook = held.handbook is not None
    contacts = any(row.contacts is not None for row in held.rows)
    headings = ["cell", "measured", "trials", "simulated", "s.e.", "simulated trials"]
    headings += ["NCHRP 17-87"] * handbook + ["contacts"] * contacts
    rows = []
    for row in held.rows:
        digits = _DIGITS.get(row.number, 2)
        cells = [
            TableCell(f"{row.cell}: {row.number}" if row.number else row.cell),
            _cell(row.measured, digits),
            _cell(row.trials, 0),
            _cell(row.simulated, digits),
            _cell(row.standard_error, digits),
            _cell(row.simulated_trials, 0),
        ]
        cells += [_cell(row.handbook, digits)] * handbook + [_cell(row.contacts, 0)] * contacts
        rows.append(tuple(cells))
    name = f"people-{held.experiment.key}-{held.driver}".rstrip("-")
    return Table(name, f"{_title(held)}: {_behind(held)}", tuple(headings), tuple(rows))


def _rows(held: Held) -> list[tuple[str, ...]]:
    rows = [(_title(held), *_scores(held.scores, held.rows), _behind(held))]
    if held.handbook is not None:
        rows.append(("  by NCHRP 17-87", *_scores(held.handbook, held.rows), ""))
    return rows


def _scores(scores: Scores | None, rows: tuple[Row, ...]) -> tuple[str, ...]:
    if scores is None:
        return ("–", "–", "–")
    share = not rows[0].number
    digits, unit = (3, "") if share else (2, " s")
    signed = f"{scores.mean_error:+.{digits}f}{unit}"
    absolute = f"{scores.mean_absolute_error:.{digits}f}{unit}"
    return signed, absolute, number(scores.r2, 2)


def _title(held: Held) -> str:
    return f"{held.experiment.title}: {held.driver}" if held.driver else held.experiment.title


def _behind(held: Held) -> str:
    """Return how many people and trials stand behind the measured figures, and of what kind."""
    trials = f", {held.trials:,} trials" if held.trials else ""
    return f"{held.experiment.people}{trials} ({held.experiment.kind})"


def _cell(value: float | None, digits: int) -> TableCell:
    text = "–" if value is None else f"{value:,.{digits}f}"
    return TableCell(text, sort=sort_key(value))


def _notes(findings: PeopleFindings) -> list[Note]:
    """Return what is undefined, which contacts there were, and what the counts include."""
    notes = []
    for held in findings.held:
        missing = sum(row.simulated is None for row in held.rows)
        if missing:
            text = f"{_title(held)}: {missing} of {len(held.rows)} numbers are undefined."
            notes.append(Note(Rank.UNDEFINED, text))
        contacts = sum(row.contacts or 0 for row in held.rows)
        if contacts:
            count = sum(row.simulated_trials for row in held.rows)
            text = f"{_title(held)}: {contacts:,} of {count:,} trials had a contact."
            notes.append(Note(Rank.LEFT_OUT, text))
        if held.model_limits is not None:
            fastest_mps, farthest_m = held.model_limits
            text = (
                f"{_title(held)}: cars come faster than {fastest_mps:.3g} m/s or from beyond "
                f"{farthest_m:.3g} m, outside the data of its model, which used the nearest state."
            )
            notes.append(Note(Rank.OUTSIDE_MODEL, text))
    text = "The measured gaps include people who set off before the first car had passed."
    return sorted([*notes, Note(Rank.REFERENCE, text)])
