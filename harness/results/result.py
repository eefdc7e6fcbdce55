"""What a command shows: its rows and columns.  Screen, page, JSON and CSV are views of it.

A view computes nothing and asks for no kind of run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from harness.core.documents import as_plain
from harness.core.freezing import Frozen
from harness.results.finding import Finding, Plain, Style, finding_to_dict
from harness.results.notes import Note

if TYPE_CHECKING:
    import pandas as pd


class Shown(NamedTuple):
    """A number in a table."""

    finding: Finding
    style: Style = Style()


class Versus(NamedTuple):
    """The AV's and the reference's number in one cell of a table."""

    av: Shown
    reference: Shown


Entered = Shown | Versus | Plain
"""What a cell of a table holds."""


class Column(NamedTuple):
    """A column of a table: its key in JSON and CSV, and its heading with its unit.

    ``interval``: its intervals are on every screen, however narrow.
    """

    key: str
    heading: str
    interval: bool = False


@dataclass(frozen=True)
class Table:
    """A table of a screen or page.

    Attributes:
        title: empty for a screen's first table.
        columns: the columns.
        rows: a cell for each column.
        same: columns that are equal in all rows, with that value, in place of a column.
        legend: a line that explains its cells; may be empty.
    """

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Entered, ...], ...]
    same: tuple[tuple[Column, Entered], ...] = ()
    legend: str = ""


@dataclass(frozen=True)
class Result(Frozen):
    """What a command found.

    Attributes:
        command: the name of the command.
        title: what was compared with what.
        scope: pairs, failures among them, seed.
        about: the place, the people and what is special, in one line; may be empty.
        screen: the table of the first screen.
        full: every number, for ``--full`` and the page.
        notes: the sentences without which the numbers mislead, the worst first.
        remarks: further sentences, for ``--full`` and the page.
        closing: lines that end a screen: what to do next.
        facts: folder, seed, confidence and the like, for JSON.
        records: the same numbers for machines, one mapping a row.
    """

    command: str
    title: str
    scope: str
    about: str
    screen: Table
    full: tuple[Table, ...]
    notes: tuple[Note, ...]
    closing: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    facts: Mapping[str, Plain] = field(default_factory=dict)
    records: Sequence[Mapping[str, Plain | Finding]] = ()

    def to_dict(self) -> dict[str, Any]:
        """The result as JSON, of the same form for all commands; it has all that a screen says.

        A number of a record is an object: ``value, low, high, n, events, reliable, reason, p``.
        """
        named = ("command", "title", "scope", "about")
        return {name: getattr(self, name) for name in named} | {
            "facts": as_plain(self.facts),
            "records": [
                {k: finding_to_dict(v) if isinstance(v, Finding) else v for k, v in record.items()}
                for record in as_plain(self.records)
            ],
            "notes": [note.to_dict() for note in self.notes],
            "remarks": list(self.remarks),
        }

    def frame(self) -> "pd.DataFrame":
        """The records as a frame; see ``flat``."""
        import pandas as pd

        return pd.DataFrame([flat(record) for record in self.records])


def listed(
    command: str,
    rows: Sequence[Mapping[str, Plain]],
    title: str = "",
    closing: Sequence[str] = (),
    headings: Mapping[str, str] = MappingProxyType({}),
) -> Result:
    """A result whose rows are its records; without a heading a column has its key's name."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = tuple(Column(name, headings.get(name, name)) for name in names)
    table = Table("", columns, tuple(tuple(map(row.get, names)) for row in rows))
    return Result(command, title, "", "", table, (), (), tuple(closing), records=[*rows])


def flat(record: Mapping[str, Plain | Finding]) -> dict[str, Plain]:
    """A record as one row: a number has ``key``, and what else it has beside it.

    That is ``key_ci_low``, ``key_ci_high``, ``key_n``, ``key_events``, ``key_reliable``,
    ``key_reason`` and ``key_p``.
    """
    row: dict[str, Plain] = {}
    for key, value in record.items():
        if not isinstance(value, Finding):
            row[key] = as_plain(value)
            continue
        parts = finding_to_dict(value)
        row[key] = parts.pop("value")
        row |= {f"{key}_{_ENDS.get(name, name)}": part for name, part in parts.items()}
    return row


_ENDS = {"low": "ci_low", "high": "ci_high"}
