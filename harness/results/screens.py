"""What ``run`` shows: one cell with a row for each measure, a sweep with a row for each cell."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from harness.core.encounter import Arm
from harness.core.errors import resume_command
from harness.results.catalogue import ENTRIES, ENTRY_OF, Entry
from harness.results.estimators import CONFIDENCE, EQUAL
from harness.results.finding import Finding, Plain
from harness.results.findings import CellFindings
from harness.results.notes import MOSTLY, Note, notes_of, rank_of
from harness.results.result import Column, Entered, Result, Shown, Style, Table, Versus
from harness.scenario import Scenario
from harness.scenario.place import place_in_words
from harness.strategies.references import keeps_its_defaults, validation
from harness.strategies.registry import fallback_of

_SWEEP = ("time_ratio", "delay_s", "pedestrian_wait_s", "kappa", "conflict_pet")
"""The numbers of a sweep's row, after the swept keys; worst cases follow if pairs are left out."""

_MOST_TABLES = 50
"""Cells of a sweep whose every number stands in a table of ``--full``; CSV and JSON have all."""

PAPER_REMARK = (
    "The paper's column (N = 50) is a reference, not a target: its 2,973 events and fitted "
    "parameters were never published, so the model here is fitted to other trajectories. "
    "Soft-Yield has no valid plan for walkers under 0.976 m/s at (30 m, 5 m/s); there Hard-Yield "
    "takes over."
)


def run_result(
    name: str,
    folder: Path,
    cells: Sequence[CellFindings],
    *,
    planned: int,
    finished: bool,
    facts: Mapping[str, Plain],
    about_run: Sequence[Note] = (),
) -> Result:
    """The result of a run of encounters.

    Args:
        name: the run's name.
        folder: its folder.
        cells: the findings of all cells with a pair.
        planned: planned pairs of all cells.
        finished: whether all of them are done.
        facts: what JSON says of the run: seed, confidence, engine and the like.
        about_run: notes about the run as a whole.
    """
    scenarios = [cell.scenario for cell in cells]
    paper = len(cells) == 1 and is_the_papers(scenarios[0])
    notes = list(about_run)
    done = sum(cell["pairs"].count for cell in cells)
    if not finished:
        text = f"The run is not finished: {done:,} of {planned:,} pairs are done; "
        text += f"{resume_command(folder)} continues it."
        notes.append(Note("unfinished", -2, "unfinished", text))
    if agreement := _agreement(cells):
        notes.append(agreement)
    one = len(cells) == 1
    title = f"{name}: {drivers(cells)}" if one else f"{name}: {len(cells)} cells, {drivers(cells)}"
    screen = _measures(cells[0], paper) if one else _sweep(cells)
    path = shlex.quote(str(folder))
    return Result(
        command="run",
        title=title,
        scope=scope_of(cells, done, facts),
        about=place_in_words(scenarios),
        screen=screen,
        full=tuple(_every_number(cell, paper) for cell in cells[:_MOST_TABLES]),
        notes=notes_of(cells, notes),
        closing=(f"All measures: harness show {path} --full. Page: harness report {path}",),
        remarks=(
            *((PAPER_REMARK,) if paper else ()),
            *dict.fromkeys(map(validation, scenarios)),
        ),
        facts={"name": name, "folder": str(folder), "finished": finished, **facts},
        records=[
            {
                "cell": cell.number,
                **cell.varied,
                "av": cell.scenario.arms.av,
                "reference": cell.scenario.arms.human,
                **cell.findings,
            }
            for cell in cells
        ],
    )


def shown(entry: Entry, cell: CellFindings, key: str = "") -> Shown:
    """A number of a cell as a table shows it."""
    return Shown(cell[key or entry.key], Style(entry.form, entry.digits))


def is_the_papers(scenario: Scenario) -> bool:
    """Whether a scenario is the paper's (Table II, arms, pedestrian), for any N and seed."""
    ego, people, arms = scenario.ego, scenario.pedestrians, scenario.arms
    return (
        (ego.trigger_range_m, scenario.crossing.length_m, ego.initial_speed_mps) == (30, 9, 5)
        and scenario.crosswalk().lane_centre_m == scenario.crossing.length_m / 4
        and (arms.av, arms.human) == ("soft_yield", "human_gmm")
        and all(keeps_its_defaults(scenario, name) for name in (arms.av, arms.human))
        and (people.behaviour, people.timed) == ("constant", ())
        and people.first_at_trigger
        and people.max_count == 1
    )


def av_of(cell: CellFindings) -> str:
    """The AV's strategy, and the fallback if it drove most passages that met someone."""
    strategy, share = cell.scenario.arms.av, cell["fallback_share"].value
    if share is None or share < MOSTLY:
        return strategy
    return f"{strategy} ({fallback_of(strategy)} in {100 * share:.0f} %)"


def drivers(cells: Sequence[CellFindings]) -> str:
    """Who drives against whom, of the arms that are the same in all cells."""
    avs, references = ({getattr(cell.scenario.arms, arm) for cell in cells} for arm in Arm)
    av = avs.pop() if len(avs) == 1 else f"{len(avs)} strategies"
    return f"{av} against {references.pop() if len(references) == 1 else 'several references'}"


def worst_cases(cells: Sequence[CellFindings]) -> list[Entry]:
    """The worst cases that differ from the number itself in a cell, because pairs are left out."""
    return [
        entry
        for entry in ENTRIES
        if entry.worst_case
        and any(cell[entry.key] != cell[entry.key.removesuffix("_worst")] for cell in cells)
    ]


def scope_of(cells: Sequence[CellFindings], done: int, facts: Mapping[str, Plain]) -> str:
    """Pairs with what is left out of them, and the seed."""
    each = {cell["pairs"].count for cell in cells}
    pairs = f"{done:,} pair{'s' * (done != 1)}"
    if len(cells) > 1:
        pairs = (
            f"{min(each):,} pairs each"
            if len(each) == 1
            else f"{min(each):,} to {max(each):,} pairs"
        )
    total = {
        words: sum(cell[key].count for cell in cells for key in keys)
        for words, keys in (
            ("failed episodes", ("failed", "failed_human")),
            ("time-outs", ("timed_out", "timed_out_human")),
            ("pairs met nobody", ("met_nobody",)),
        )
    }
    without = sum(cell["pairs"].count - cell["time_ratio_pairs"].count for cell in cells)
    total["pairs not in the ratio of times"] = without
    left = ", ".join(f"{count:,} {words}" for words, count in total.items() if count)
    parts = [f"{pairs} ({left})" if left else pairs, f"seed {facts['seed']}"]
    if facts["confidence"] != CONFIDENCE:
        parts.append(f"{100 * float(facts['confidence'] or 0):.4g} % intervals")
    return ", ".join(parts)


def _measures(cell: CellFindings, paper: bool) -> Table:
    """The first screen of one cell: a row for each measure, worst cases if pairs are left out.

    A mean that is 0 in every episode of both arms, such as the wait if nobody waits, has no row.
    """
    worst = len(worst_cases([cell])) > 0
    entries = [
        entry
        for entry in ENTRIES
        if (entry.screen or (entry.worst_case and worst))
        and not all((cell[key].value, cell[key].reason) == (0, EQUAL) for key in entry.keys)
    ]
    return _rows("", entries, cell, paper)


def _every_number(cell: CellFindings, paper: bool) -> Table:
    """Every number of one cell."""
    where = f"cell {cell.number}, {drivers([cell])}" if cell.varied else drivers([cell])
    return _rows(f"Every number: {where}", ENTRIES, cell, paper, remarks=True)


def _rows(
    title: str, entries: Sequence[Entry], cell: CellFindings, paper: bool, remarks: bool = False
) -> Table:
    beside = {entry.beside: entry for entry in entries if entry.beside}
    rows = []
    for entry in (each for each in entries if not each.beside):
        numbers: list[Entered] = [None, None, None]
        pair = entry if entry.of == "pair" else beside.get(entry.key)
        if entry.of != "pair":
            numbers[: len(entry.keys)] = [shown(entry, cell, key) for key in entry.keys]
        if pair is not None:
            numbers[2] = shown(pair, cell)
        found = [cell[key] for each in (entry, pair) if each is not None for key in each.keys]
        reasons = "; ".join(dict.fromkeys(filter(None, (finding.reason for finding in found))))
        heading = entry.title(cell.scenario.conflicts.model_dump())
        if pair is not None and entry.worst_case:
            heading = "worst case: crashes, time"
        row = (heading, *numbers, *((entry.paper or None,) if paper else ()))
        rows.append((*row, reasons or None) if remarks else row)
    columns = [
        Column("measure", ""),
        Column("av", av_of(cell)),
        Column("reference", cell.scenario.arms.human),
        Column("paired", "AV against reference", True),
        *([Column("paper", "paper")] if paper else []),
        *([Column("remark", "remark")] if remarks else []),
    ]
    return Table(title, tuple(columns), tuple(rows))


def _sweep(cells: Sequence[CellFindings]) -> Table:
    """A row for each cell; what is equal in all cells stands beside the table."""
    columns: list[tuple[Column, tuple[Entered, ...]]] = []
    for key in cells[0].varied:
        name = Column(key, key.rpartition(".")[2])
        own = (av_of(cell) if key == "arms.av" else cell.varied[key] for cell in cells)
        columns.append((name, tuple(own)))
    for entry in (*map(ENTRY_OF.__getitem__, _SWEEP), *worst_cases(cells)):
        name = Column(entry.key, entry.title(cells[0].scenario.conflicts.model_dump()))
        columns.append((name, tuple(_number(entry, cell) for cell in cells)))
    return table_of("", columns, legend="Two numbers in a cell: AV / reference.")


def table_of(
    title: str, columns: Sequence[tuple[Column, tuple[Entered, ...]]], legend: str = ""
) -> Table:
    """A table of columns with their values; columns that are equal in all rows become ``same``."""
    rows = len(columns[0][1])
    same = tuple((name, values[0]) for name, values in columns if rows > 1 and len({*values}) == 1)
    kept = [(name, values) for name, values in columns if rows == 1 or len({*values}) > 1]
    names = tuple(name for name, _ in kept)
    return Table(
        title, names, tuple(zip(*(values for _, values in kept), strict=True)), same, legend
    )


def _number(entry: Entry, cell: CellFindings) -> Entered:
    if entry.of == "arms":
        av, human = (shown(entry, cell, key) for key in entry.keys)
        return Versus(av, human)
    return shown(entry, cell)


def _agreement(cells: Sequence[CellFindings]) -> Note | None:
    """Whether all references of a sweep over ``arms.human`` agree on who is faster."""
    if len(cells) < 2 or tuple(cells[0].varied) != ("arms.human",):
        return None
    sides: dict[str, list[str]] = {}
    for cell in cells:
        ratio: Finding = cell["time_ratio"]
        side = "undecided"
        if ratio.low is not None and ratio.high is not None and not ratio.includes(1):
            side = "less" if ratio.high < 1 else "more"
        sides.setdefault(side, []).append(cell.scenario.arms.human)
    parts = [
        f"{side if side == 'undecided' else f'{side} time than'} {', '.join(names)}"
        for side, names in sides.items()
    ]
    text = f"The AV against each reference: {'; '.join(parts)}."
    rank = rank_of("time_outs") if {"less", "more"} <= sides.keys() else len(sides) + 100
    return Note("agreement", rank, "the references", text)
