"""The episodes of a run to look at: the worst by a measure, or those that got worse since a run."""

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from harness.core.encounter import Arm, Ending
from harness.core.errors import InputError, unknown_name
from harness.measures.agreement import TOLERANCE
from harness.measures.catalogue import COLUMNS, MEASURES
from harness.store.summaries import known
from harness.studies.runs.opening import finished_run
from harness.studies.runs.run_data import RunData
from harness.studies.runs.same_pairs import check_same_pairs, names_of
from harness.studies.runs.strategy_groups import StrategyCell, groups_over

RANKED = {measure.column: measure for measure in MEASURES if measure.worse is not None}
"""Measures by which episodes are ranked."""

CONFLICT_S = 5.0
"""A PET or TTC above this counts as this: no conflict (SSAM's largest PET, FHWA-HRT-08-051)."""

_CAPPED = ("pet_s", "min_ttc_s")

_BEFORE = "_before"
"""Ends the columns of the earlier run."""


@dataclass(frozen=True)
class WorstEpisode:
    """An episode, and how bad it was.

    ``value`` is that of the measure, None where it is undefined: then ``ending`` says more.
    ``before`` is the same in the other run, ``ending_before`` its ending there; both None where
    runs are not compared.  ``varied`` names the cell by its keys.
    """

    run: Path
    cell: int
    pair: int
    arm: Arm
    ending: Ending
    value: float | None
    before: float | None = None
    ending_before: Ending | None = None
    varied: Mapping[str, Any] = field(default_factory=dict)

    @property
    def command(self) -> str:
        """The shell command that shows it in sumo-gui."""
        cell = f" --cell {self.cell}" if self.cell else ""
        where = shlex.quote(str(self.run))
        return f"harness replay {where}{cell} --pair {self.pair} --arm {self.arm.value} --gui"


def worst(
    run: RunData | str | Path,
    by: str = "pet_s",
    most: int = 20,
    arm: Arm | str = Arm.AV,
    cell: int | None = None,
) -> list[WorstEpisode]:
    """The worst episodes of a run.

    By a measure of conflicts (PET, DRAC …) crashes come first, the fastest before the others.  By
    delay and pass time time-outs do, which have none; a crash has none either and is left out.

    Args:
        run: a finished run, or its folder.
        by: one of ``RANKED``.
        most: how many, 1 or more.
        arm: whose episodes, ``av`` or ``human``.
        cell: number of the cell; None: all.

    Raises:
        InputError: no finished run of encounters, no such measure, arm or cell, ``most`` is less
            than 1, or every episode failed.
    """
    arm = _check(by, most, arm)
    data = finished_run(run)
    rows = _episodes(data, by, arm, cell)
    bad = rows[rows["badness"] > _least(by)].nlargest(most, "badness", keep="all")
    return _ranked(data, bad, "badness", by, arm)[:most]


def got_worse(
    run: RunData | str | Path,
    since: RunData | str | Path,
    by: str = "pet_s",
    most: int = 20,
    arm: Arm | str = Arm.AV,
    cell: int | None = None,
) -> list[WorstEpisode]:
    """The episodes of a run that are worse than in an earlier one, the greatest change first.

    Cells are matched as ``compare`` groups them: the same strategy and parameters in both runs,
    or the only cell of each in a group.  PET and TTC beyond 5 s, and where there is none, count
    as 5 s; no contact counts as 0 m/s; by other measures an episode is left out in which one of
    the two is undefined.  A new crash (by delay, a new time-out) comes before all others.

    Args:
        run: a finished run, or its folder.
        since: the earlier one, of the same people.
        by: one of ``RANKED``.
        most: how many, 1 or more.
        arm: whose episodes; the human's are the same in both.
        cell: number of the cell of ``run``; None: all.

    Raises:
        InputError: as ``worst``, or the runs cannot be compared pair by pair.
    """
    arm = _check(by, most, arm)
    now, then = finished_run(run), finished_run(since)
    groups = groups_over([then.study, now.study], names_of([then, now]))
    check_same_pairs([then, now], groups)
    old, new = _episodes(then, by, arm), _episodes(now, by, arm, cell)
    parts = []
    for before, after in [match for group in groups for match in _matches(group.cells)]:
        past = old.loc[old["cell"] == before.cell.number, ["pair", "badness", by, "ending"]]
        own = new[new["cell"] == after.cell.number]
        parts.append(own.merge(past, on="pair", suffixes=("", _BEFORE)))
    if not parts:
        allowed = "the same strategy and parameters in both, or one cell of each"
        raise InputError(
            str(now.path), f"no cell of it has one counterpart in {then.path}", allowed
        )
    rows = pd.concat(parts)
    rows["change"] = rows["badness"] - rows[f"badness{_BEFORE}"]
    worse = rows[rows["change"] > TOLERANCE].nlargest(most, "change", keep="all")
    return _ranked(now, worse, "change", by, arm)[:most]


def _ranked(run: RunData, rows: pd.DataFrame, key: str, by: str, arm: Arm) -> list[WorstEpisode]:
    order = rows.sort_values([key, "cell", "pair"], ascending=[False, True, True], kind="stable")
    return [_episode(run, row, by, arm) for _, row in order.iterrows()]


def _check(by: str, most: int, arm: Arm | str) -> Arm:
    if by in COLUMNS and by not in RANKED:
        raise InputError("--by", f"neither end of {by} is the bad one", ", ".join(RANKED))
    if by not in RANKED:
        raise unknown_name("--by", "measure", by, RANKED)
    if most < 1:
        raise InputError("-n", f"{most}", "1 or more")
    if arm not in (*Arm,):
        raise unknown_name("--arm", "arm", str(arm), [*Arm])
    return Arm(arm)


def _matches(cells: tuple[StrategyCell, ...]) -> list[tuple[StrategyCell, StrategyCell]]:
    """Cells of the first run with their counterparts in the second."""
    first, second = ([cell for cell in cells if cell.run == run] for run in (0, 1))
    same = [
        (a, b)
        for a in first
        for b in second
        if (a.strategy, a.parameters) == (b.strategy, b.parameters)
    ]
    return same or ([(first[0], second[0])] if len(first) == len(second) == 1 else [])


def _episodes(run: RunData, by: str, arm: Arm, cell: int | None = None) -> pd.DataFrame:
    """The arm's episodes that ran, with a column ``badness``: the larger, the worse."""
    episodes, cells = run.episodes, len(run.study.cells)
    if by not in episodes:
        raise InputError(str(run.path), f"has no {by}", "a run that has it: harness score RUN")
    if cell is not None and not 0 <= cell < cells:
        raise InputError("--cell", f"{cell}", f"0 to {cells - 1}")
    of_arm = episodes[(episodes["arm"] == arm.value) & (cell is None or episodes["cell"] == cell)]
    rows = of_arm[of_arm["ending"] != Ending.ENGINE_FAILED].copy()
    if rows.empty:
        where = str(run.path) if cell is None else f"{run.path}: cell {cell}"
        why = f"e.g. {of_arm['reason'].iloc[0]}" if len(of_arm) else "there is none"
        what = f"all {len(of_arm)} episodes of {arm.value} failed, {why}"
        raise InputError(where, what, "a run with an episode that ended otherwise")
    rows["badness"] = [
        _badness(by, *values)
        for values in zip(rows[by], rows["ending"], rows["contact_speed_mps"], strict=True)
    ]
    return rows


_FINAL = 1_000_000.0
"""Worse than every value: a crash or, by delay, a time-out."""


def _badness(by: str, value: float, ending: str, contact_speed_mps: float) -> float:
    measure = RANKED[by]
    if measure.about == "time" and ending == Ending.TIMED_OUT:
        return _FINAL
    if measure.about == "conflict" and ending == Ending.CRASHED:
        return _FINAL + contact_speed_mps
    if by == "contact_speed_mps":
        return 0.0
    unknown = value is None or math.isnan(value)
    if by in _CAPPED:
        return -CONFLICT_S if unknown else -min(value, CONFLICT_S)
    return math.nan if unknown else float(value if measure.worse == "large" else -value)


def _least(by: str) -> float:
    """An episode of this badness, or less, is not worth a look."""
    if by in _CAPPED:
        return -CONFLICT_S
    return -math.inf if RANKED[by].worse == "small" or by == "delay_s" else 0.0


def _episode(run: RunData, row: "pd.Series[Any]", by: str, arm: Arm) -> WorstEpisode:
    compared = f"ending{_BEFORE}" in row
    return WorstEpisode(
        run.path,
        int(row["cell"]),
        int(row["pair"]),
        arm,
        Ending(row["ending"]),
        known(row[by]),
        known(row[f"{by}{_BEFORE}"]) if compared else None,
        Ending(row[f"ending{_BEFORE}"]) if compared else None,
        run.study.cells[int(row["cell"])].varied,
    )
