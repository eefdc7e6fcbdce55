"""What ``run`` shows: one cell with a row for each measure, a sweep with a row for each cell."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from harness.core.vocabulary import Arm
from harness.results.catalogue import ENTRY_OF, Entry, entries_of
from harness.results.cell_findings import CellFindings, on_first_screen, worst_cases
from harness.results.finding import Findings, Form, Plain
from harness.results.place import short_names
from harness.results.references import is_the_papers
from harness.results.result import Column, Entered, Shown, Table, Versus
from harness.strategies.registry import fallback_of

_LEFT_OUT = {
    "failed": ("failure", "failures"),
    "timed_out": ("time-out", "time-outs"),
    "met_nobody": ("pair met nobody", "pairs met nobody"),
    "not_in_time_ratio": ("pair not in the ratio of times", "pairs not in the ratio of times"),
    "people_left_out": ("person left out", "people left out"),
}
"""What the scope of a result says is left out: of one, and of several."""

_MOST_CROSSWALKS = 3
"""Crosswalks whose differences stand on the first screen; ``--full`` has all."""

FALLBACK_FROM = 0.5
"""From this share on, a fallback is said to have driven most passages."""

_MOST_CELLS = 50
"""Cells of a sweep whose every number stands in tables of ``--full``; CSV and JSON have all."""


def tables_of(cells: Sequence[CellFindings]) -> tuple[Table, tuple[Table, ...]]:
    """The table of the first screen of some cells, and every number of each."""
    one = len(cells) == 1
    paper = one and is_the_papers(cells[0].scenario)
    screen = _rows("", on_first_screen(cells[0]), cells[0], paper) if one else _sweep(cells)
    every = [table for cell in cells[:_MOST_CELLS] for table in _every_number(cell, paper)]
    if more := len(cells[_MOST_CELLS:]):
        every[-1] = replace(every[-1], legend=f"The numbers of {more:,} more cells: summary.csv.")
    return screen, tuple(every)


def as_shown(entry: Entry, found: CellFindings | Findings, key: str = "") -> Shown:
    """A number of a cell as a table shows it."""
    style, paired = entry.style, key in entry.keys[2:]
    style = style._replace(form=Form.SHARE) if paired and style.form is Form.EVENTS else style
    return Shown(found[key or entry.key], style)


def driver_of(cell: CellFindings, arm: Arm) -> str:
    """An arm's strategy, and the fallback if it drove most passages that met someone."""
    strategy = cell.scenario.arms.driver(arm)
    share = cell["fallback_share" if arm is Arm.AV else "fallback_share_human"].value
    if share is None or share < FALLBACK_FROM:
        return strategy
    return f"{strategy} ({fallback_of(strategy)} in {100 * share:.0f} %)"


def drivers(cells: Sequence[CellFindings]) -> str:
    """Who drives against whom, of the arms that are the same in all cells."""
    avs, references = ({getattr(cell.scenario.arms, arm) for cell in cells} for arm in Arm)
    av = avs.pop() if len(avs) == 1 else f"{len(avs)} strategies"
    return f"{av} against {references.pop() if len(references) == 1 else 'several references'}"


def scope_of(cells: Sequence[CellFindings], facts: Mapping[str, Plain]) -> str:
    """Pairs with what is left out of them, and the seed."""
    each = sorted(cell["pairs"].count for cell in cells)
    pairs = "1 pair" if each[0] == 1 else f"{each[0]:,} pairs"
    if each[-1] > each[0]:
        pairs = f"{each[0]:,} to {each[-1]:,} pairs"
    elif len(each) > 1:
        pairs += " each"
    known = [key for key in _LEFT_OUT if cells[0].kind in ENTRY_OF[key].kinds]
    total = {key: sum(cell.total(key) for cell in cells) for key in known}
    left = [f"{count:,} {_LEFT_OUT[key][count > 1]}" for key, count in total.items() if count]
    pairs += f" ({', '.join(left)})" if left else ""
    return f"{pairs}, seed {facts['seed']}"


def _every_number(cell: CellFindings, paper: bool) -> list[Table]:
    """Every number of one cell, and of each of its crosswalks."""
    where = f"cell {cell.number}, {drivers([cell])}" if cell.varied else drivers([cell])
    entries, title = entries_of(cell.kind), f"Every number: {where}"
    at_one = [entry for entry in entries if not entry.network]
    at = [
        _rows(f"{title}, {name}", at_one, replace(cell, findings=found), paper, remarks=True)
        for name, found in cell.by_crosswalk.items()
    ]
    return [_rows(title, entries, cell, paper, remarks=True), *at]


def _rows(
    title: str, entries: Sequence[Entry], cell: CellFindings, paper: bool, remarks: bool = False
) -> Table:
    """A row for each entry: the arms' numbers, what is paired, the paper's value, and remarks."""
    beside = {entry.beside: entry for entry in entries if entry.beside}
    several = len(cell.by_crosswalk) > 1 and not remarks
    crosswalks = dict([*cell.by_crosswalk.items()][: _MOST_CROSSWALKS if several else 0])
    places = (cell.findings, *crosswalks.values())
    rows = []
    for entry in (each for each in entries if not each.beside):
        own = [as_shown(entry, cell, key) for key in entry.keys[:2] if entry.estimate.of != "pair"]
        pair = entry if entry.estimate.of in ("pair", "both") else beside.get(entry.key)
        at = [as_shown(pair, of, pair.keys[-1]) if pair else None for of in places]
        found = [cell[key] for each in (entry, pair) if each is not None for key in each.keys]
        reasons = "; ".join(dict.fromkeys(filter(None, (finding.reason for finding in found))))
        heading = entry.title(cell.scenario.conflicts.model_dump())
        if pair is not None and entry.worst_of:
            heading = "worst case: crashes, time"
        told = (entry.paper or None) if paper else None, (reasons or None) if remarks else None
        rows.append((heading, *own, *[None] * (2 - len(own)), *at, *told))
    simulated = cell.kind == "simulations"
    columns = (
        Column("measure", ""),
        Column("av", driver_of(cell, Arm.AV)),
        Column("reference", driver_of(cell, Arm.HUMAN)),
        Column("paired", "difference in all" if simulated else "AV against reference", True),
        *(Column(name, name) for name in crosswalks),
        Column("paper", "paper"),
        Column("remark", "remark"),
    )
    return Table(title, columns, tuple(rows))


def _sweep(cells: Sequence[CellFindings]) -> Table:
    """A row for each cell; what is equal in all cells stands beside the table."""
    columns: list[tuple[Column, tuple[Entered, ...]]] = []
    arms = {f"arms.{arm.value}": arm for arm in Arm}
    for key, name in short_names([*cells[0].varied]).items():
        own = (driver_of(cell, arms[key]) if key in arms else cell.varied[key] for cell in cells)
        columns.append((Column(key, name), tuple(own)))
    thresholds = cells[0].scenario.conflicts
    swept = any(cell.scenario.conflicts != thresholds for cell in cells)
    numbers = [(entry, place) for entry in entries_of(cells[0].kind) for place in entry.sweep]
    for entry, place in (*numbers, *((entry, 0) for entry in worst_cases(cells))):
        key, paired = entry.keys[place], place == 2
        # A threshold that is swept has a column of its own.
        bare, threshold, _ = entry.heading.partition(" {")
        name = bare if swept and threshold else entry.title(thresholds.model_dump())
        name = f"{name}, AV − reference" if paired else name
        columns.append((Column(key, name, paired), tuple(_number(entry, key, c) for c in cells)))
    return table_of("", columns, legend="Two numbers in a cell: AV / reference.")


def table_of(
    title: str, columns: Sequence[tuple[Column, tuple[Entered, ...]]], legend: str = ""
) -> Table:
    """A table of columns with their values; columns that are equal in all rows become ``same``."""
    kept, same = [], []
    for name, values in columns:
        first, *others = map(_if_defined, values)
        if others and all(each == first for each in others):
            same.append((name, values[0]))
        else:
            kept.append((name, values))
    rows = tuple(zip(*(values for _, values in kept), strict=True))
    return Table(title, tuple(name for name, _ in kept), rows, tuple(same), legend)


def _if_defined(entered: Entered) -> object:
    """What two cells of a table are compared by: undefined numbers are all alike."""
    if isinstance(entered, Versus):
        return tuple(map(_if_defined, entered))
    return None if isinstance(entered, Shown) and entered.finding.value is None else entered


def _number(entry: Entry, key: str, cell: CellFindings) -> Entered:
    if key == entry.key and entry.estimate.of in ("arms", "both"):
        return Versus(*(as_shown(entry, cell, each) for each in entry.keys[:2]))
    return as_shown(entry, cell, key)
