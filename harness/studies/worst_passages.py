"""Finds the worst passages of simulations."""

import shlex
from typing import TYPE_CHECKING, Literal

from harness.core.encounter import Arm, Ending
from harness.core.errors import InputError, resume_command
from harness.measures.catalogue import MEASURES
from harness.results.finding import Finding, Plain
from harness.results.result import Column, Result, Shown, Style, Table
from harness.results.run import Run
from harness.simulation.arm import ENDED

if TYPE_CHECKING:
    from collections.abc import Callable

Driver = Literal["av", "other"]
"""The vehicles that an AV's strategy drove, or all others."""

_SPEED = "contact_speed_mps"
_NAMES = ("pair", "crosswalk", "vehicle", "driver", "manoeuvre", "ended", "contact_person")


def worst_passages(
    run: Run,
    by: str,
    most: int,
    arm: Arm,
    cell: int | None,
    driver: Driver | None,
    badness: "Callable[[str, float, str, float], float]",
    least: float,
) -> Result:
    """The worst passages of an arm; who was cut off by the end of the simulation is left out.

    Args:
        run: a finished run of simulations.
        by: a measure.
        most: maximum number of passages.
        arm: the arm.
        cell: number of the cell; None: all cells.
        driver: the only drivers; None: all, SUMO too.
        badness: of a measure, its value, an ending and the speed at a contact; larger is worse.
        least: the badness up to which a passage is not listed.

    Raises:
        InputError: the run is not finished, or nobody passed.
    """
    if not run.finished:
        advice = f"`{resume_command(run.path)}` finishes it"
        raise InputError(str(run.path), "is not finished", advice)
    rows = run.table("passages")
    rows = rows[(rows["arm"] == arm) & (cell is None or rows["cell"] == cell)]
    rows = rows[rows["ended"] != ENDED]
    if driver is not None:
        rows = rows[(rows["automated"] & rows["driven"]) == (driver == "av")]
    if rows.empty:
        raise InputError(str(run.path), "has no such passage", "another arm, cell or driver")
    touched = rows["contact_person"].notna()
    endings = [Ending.CRASHED if each else Ending.CROSSED for each in touched]
    values = zip(rows[by], endings, rows[_SPEED], strict=True)
    rows = rows.assign(badness=[badness(by, *of) for of in values])
    order = ["badness", "cell", "pair", "front_s"]
    bad = rows[rows["badness"] > least].sort_values(order, ascending=[False, True, True, True])
    several, unit = len(run.study.cells) > 1, {each.column: each.unit for each in MEASURES}[by]
    keys = ["cell", *run.study.varied_keys] if several else []
    numbers = ("front_s", _SPEED, by)
    headings = {
        **{name: name.rpartition(".")[2] for name in keys},
        **{name: name.replace("_", " ") for name in _NAMES},
        **{"front_s": "at, s", _SPEED: "speed at contact, m/s", by: f"{by}, {unit}"},
    }
    records: list[dict[str, Plain | Finding]] = []
    commands: dict[str, None] = {}
    for row in bad[:most].to_dict("records"):
        number = row["cell"]
        chosen = f" --cell {number}" if several else ""
        place = f"{shlex.quote(str(run.path))}{chosen} --pair {row['pair']} --arm {arm}"
        commands[f"harness replay {place} --gui"] = None
        known = {
            name: row[name] if row[name] == row[name] else None for name in (*_NAMES, *numbers)
        }
        found = {name: Finding(of) if name in numbers else of for name, of in known.items()}
        records.append({"cell": number, **run.study.cells[number].varied, **found})
    cells = tuple(
        tuple(
            Shown(value, Style(digits=3)) if isinstance(value, Finding) else value
            for value in map(record.get, headings)
        )
        for record in records
    )
    return Result(
        command="worst",
        title=f"{run.name}: the worst passages of the {arm} arm by {by}",
        scope=f"{len(records)} of {len(rows):,}",
        about="",
        screen=Table("", tuple(Column(*each) for each in headings.items()), cells),
        full=(),
        notes=(),
        closing=tuple(commands),
        facts={"folder": str(run.path), "by": by, "arm": arm.value, "driver": driver},
        records=records,
    )
