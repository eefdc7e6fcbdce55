"""The table and the JSON document of ``harness worst``."""

from collections.abc import Mapping, Sequence

from harness.core.encounter import Ending
from harness.core.errors import one_line
from harness.old.report.screens.tables import DASH, Table, TableCell, count_cell, number, sort_key
from harness.old.studies.runs.worst import WorstEpisode
from harness.scenario import as_written

_SPEED = "contact_speed_mps"
"""Column of the vehicle's speed at the contact."""


def worst_tables(episodes: Sequence[WorstEpisode], by: str) -> Table:
    """Return a table of the episodes."""
    # The option --cell needs the cell's number; its keys describe the cell.
    keys = list(episodes[0].varied) if episodes else []
    names = list(episodes[0].names) if episodes else []
    rows = [
        (
            count_cell(episode.cell),
            *(TableCell(as_written(episode.varied[key])) for key in keys),
            count_cell(episode.pair),
            *(_name_cell(episode.names[name]) for name in names),
            TableCell(episode.driver),
            TableCell(episode.contact or DASH),
            *([] if by == _SPEED else [_speed(episode.contact_speed_mps)]),
            _outcome(episode.value, episode.ending),
        )
        for episode in episodes
    ]
    contact = ("contact", *([] if by == _SPEED else [_SPEED]))
    headings = ("cell", *keys, "pair", *names, "driver", *contact, by)
    if not episodes:
        return Table("worst", f"no episode to look at, by {by}", headings, ())
    caption = f"worst by {by}: {episodes[0].run}, {episodes[0].arm.value}"
    return Table("worst", caption, headings, tuple(rows))


def worst_document(episodes: Sequence[WorstEpisode], by: str) -> Mapping[str, object]:
    """Return the document that ``--json`` prints."""
    return {
        "by": by,
        "episodes": [
            {
                "cell": episode.cell,
                "varied": dict(episode.varied),
                "pair": episode.pair,
                "arm": episode.arm.value,
                **episode.names,
                "driver": episode.driver,
                "ending": episode.ending.value,
                "contact": episode.contact,
                _SPEED: episode.contact_speed_mps,
                by: episode.value,
                "command": episode.command,
            }
            for episode in episodes
        ],
    }


def _name_cell(value: str | float) -> TableCell:
    """Return a cell that identifies a passage: the id of a crosswalk or vehicle, or a time in s."""
    if isinstance(value, str):
        return TableCell(one_line(value))
    return TableCell(number(value, 1), sort=sort_key(value))


def _speed(value: float | None) -> TableCell:
    """Return the vehicle's speed at the contact, or a dash without a contact."""
    return TableCell(DASH if value is None else number(value, 2), sort=sort_key(value))


def _outcome(value: float | None, ending: Ending) -> TableCell:
    """Return the value, and below it the ending if the vehicle did not pass."""
    small = "" if ending is Ending.CROSSED else str(ending)
    text = "none" if value is None else number(value, 3)
    return TableCell(text, small, sort_key(value))
