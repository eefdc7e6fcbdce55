"""Finds the worst episodes of a run, or the worst passages of its simulations."""

import math
import shlex
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

from harness.core.errors import InputError, Parameter, checked, unknown_name, whole_number
from harness.core.vocabulary import Arm, Ending
from harness.measures.measured import COLUMNS, MEASURES
from harness.results.finding import Finding, Form, Plain, Style
from harness.results.loaded_run import Run, older_code
from harness.results.notes import notes_of
from harness.results.place import place_in_words
from harness.results.result import Column, Entered, Result, Shown, Table
from harness.results.tables import RunKind
from harness.studies.defaults import MOST_EPISODES, RANKED_BY, WhoDrove

if TYPE_CHECKING:
    import pandas as pd

RANKED = MappingProxyType({each.column: each for each in MEASURES if each.worse is not None})
"""Measures that can rank episodes."""

CONFLICT_S = 5.0
"""A larger PET or TTC counts as this value: no conflict (SSAM's maximum, FHWA-HRT-08-051)."""

_COLUMNS: Mapping[RunKind, Mapping[str, str]] = {
    "encounters": {name: name for name in ("pair", "driver", "ending", "contact")},
    "simulations": {
        "pair": "pair", "crosswalk": "crosswalk", "vehicle": "vehicle", "driver": "driver",
        "manoeuvre": "manoeuvre", "ended": "ended", "contact_person": "contact with",
        "front_s": "at, s", "share_strategy": "steps by the strategy",
    },
}  # fmt: skip
"""The columns of a row that say which it is, with their headings."""

_SPEED = "contact_speed_mps"
_STYLES = {"front_s": Style(digits=1), "share_strategy": Style(Form.SHARE, 0)}
"""How numbers are written; any other measure has three digits."""

_CAPPED = ("pet_s", "min_ttc_s")
_FINAL = 1_000_000.0
"""Badness above every value, for a crash or (for delay) a time-out."""


@checked
def worst(
    run: Run,
    by: str = RANKED_BY,
    most: int = MOST_EPISODES,
    *,
    arm: Arm | Literal["av", "human"] = Arm.AV,
    cell: int | None = None,
    driver: WhoDrove | None = None,
) -> Result:
    """The worst episodes of a run, or passages of simulations.

    ``replay`` of a record is the command that shows it in sumo-gui.

    For a conflict measure (PET, DRAC …) crashes come first, sorted by impact speed.  For delay and
    pass time, time-outs come first; crashes are left out, because they have no such value.

    Args:
        run: a finished run.
        by: one of ``RANKED``.
        most: maximum number of episodes, 1 or more.
        arm: who drives, ``av`` or ``human``.
        cell: number of the cell; None: all cells.
        driver: of simulations, who drove; None: anybody.

    Returns:
        The result: a row for each episode or passage, the worst first.

    Raises:
        InputError: the run is not finished, the measure, arm or cell does not exist, or every
            episode failed.
    """
    if by not in RANKED:
        if by in COLUMNS:
            problem = f"neither small nor large values of {by} are bad"
            raise InputError(Parameter("by", by), problem, ", ".join(RANKED))
        raise unknown_name(Parameter("by", by), "measure", by, RANKED)
    most = whole_number(Parameter("most"), most, 1)
    if cell is not None:
        run.study.cell(cell)
    simulated = run.kind == "simulations"
    if driver is not None and not simulated:
        raise InputError(Parameter("driver", driver), "is of simulations", "arm")
    rows = _ranked(run, by, arm, cell, driver)
    bad = rows[rows["badness"] > _least(by)]
    then = ["cell", "pair", *(["front_s"] if simulated else [])]
    order = bad.sort_values(["badness", *then], ascending=[False, *(True for _ in then)])[:most]
    return _result(run, order, len(rows), by, Arm(arm))


def _ranked(
    run: Run, by: str, arm: str, cell: int | None, driver: WhoDrove | None
) -> "pd.DataFrame":
    """The episodes or passages of an arm that have a measure, each with its badness.

    Episodes that failed are left out, and passages that the end of the simulation cut off.
    """
    run.refuse_unfinished()
    if run.kind == "simulations":
        rows = _passages(run, Arm(arm), driver)
    else:
        rows = run.episodes.rename(columns={"strategy": "driver"})
    of_arm = rows[(rows["arm"] == arm) & (cell is None or rows["cell"] == cell)]
    rows = of_arm[of_arm["ending"] != Ending.FAILED]
    if rows.empty and run.kind == "simulations":
        raise InputError(str(run.path), "has no such passage", "another arm, cell or driver")
    if rows.empty:
        problem = f"all {len(of_arm)} episodes of {arm} failed, e.g. {of_arm['reason'].iloc[0]}"
        raise InputError(str(run.path), problem, "a run with an episode that did not fail")
    values = zip(rows[by], rows["ending"], rows["contact_speed_mps"], strict=True)
    return rows.assign(badness=[_badness(by, *of) for of in values])


def _passages(run: Run, arm: Arm, driver: WhoDrove | None) -> "pd.DataFrame":
    """The passages that did not end with the simulation, each with the ending of an episode."""
    from harness.simulation.arm import ENDED  # which no run of encounters needs

    rows = run.table("passages")
    by_av = rows["driven"] & rows["automated"] & (arm is Arm.AV)
    who = {"av": by_av, "reference": rows["driven"] & ~by_av, "sumo": ~rows["driven"]}
    rows = rows[(rows["ended"] != ENDED) & (driver is None or who[driver])]
    touched = rows["contact_person"].notna()
    return rows.assign(ending=touched.map({True: Ending.CRASHED, False: Ending.CROSSED}))


def _badness(by: str, value: float, ending: str, contact_speed_mps: float) -> float:
    """An episode's badness: larger is worse, NaN undefined."""
    measure = RANKED[by]
    if measure.about == "time" and ending == Ending.TIMED_OUT:
        return _FINAL
    if measure.about == "conflict" and ending == Ending.CRASHED:
        return _FINAL + contact_speed_mps
    if by in _CAPPED:
        return -CONFLICT_S if math.isnan(value) else -min(value, CONFLICT_S)
    return float(value if measure.worse == "large" else -value)


def _least(by: str) -> float:
    """The badness up to which an episode is not listed."""
    if by in _CAPPED:
        return -CONFLICT_S
    return -math.inf if RANKED[by].worse == "small" or by == "delay_s" else 0.0


def _result(run: Run, rows: "pd.DataFrame", among: int, by: str, arm: Arm) -> Result:
    """What ``harness worst`` shows of the chosen rows."""
    several, unit = len(run.study.cells) > 1, {each.column: each.unit for each in MEASURES}[by]
    keys = {"cell": "cell", **{key: key.rpartition(".")[2] for key in run.study.varied_keys}}
    headings = {
        **(keys if several else {}),
        **_COLUMNS[run.kind],
        **{_SPEED: "speed at contact, m/s", by: f"{by}, {unit}" if unit else by},
    }
    styles = {name: _STYLES.get(name, Style(digits=3)) for name in (_SPEED, *_STYLES, by)}
    records, cells = list[dict[str, Plain | Finding]](), list[tuple[Entered, ...]]()
    for row in rows.astype(object).where(rows.notna(), None).to_dict("records"):
        number = row["cell"]
        chosen = f" --cell {number}" if several else ""
        place = f"{shlex.quote(str(run.path))}{chosen} --pair {row['pair']} --arm {arm}"
        command = f"harness replay {place} --gui"
        found = {name: row[name] for name in headings if name in row}
        numbers = {name: Finding(found[name]) for name in styles if name in found}
        varied = run.study.cells[number].varied
        records.append({"cell": number, **varied, **found, **numbers, "replay": command})
        styled = {name: Shown(each, styles[name]) for name, each in numbers.items()}
        cells.append(tuple(map({**varied, **found, **styled}.get, headings)))
    noun = "episodes" if run.kind == "encounters" else "passages"
    return Result(
        command="worst",
        title=f"{run.name}: the worst {noun} of {arm} by {by}",
        scope=f"{len(records)} of {among:,}",
        about=place_in_words([cell.scenario for cell in run.cells]),
        screen=Table("", tuple(Column(*each) for each in headings.items()), tuple(cells)),
        full=(),
        notes=notes_of(run.cells, older_code(run.manifest)),
        closing=tuple(dict.fromkeys(str(record["replay"]) for record in records)),
        facts={"folder": str(run.path), "by": by, "arm": arm.value},
        records=records,
    )
