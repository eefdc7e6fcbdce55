"""Finds the worst passages of a run."""

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from harness.core.encounter import Arm, Contact, Ending
from harness.core.errors import InputError, unknown_name
from harness.measures.catalogue import COLUMNS, MEASURES
from harness.old.store.summaries import known
from harness.old.studies.runs.opening import opened_run
from harness.old.studies.runs.run_data import RunData

RANKED = {measure.column: measure for measure in MEASURES if measure.worse is not None}
"""Measures that can rank episodes."""

CONFLICT_S = 5.0
"""A larger PET or TTC counts as this value: no conflict (SSAM's maximum, FHWA-HRT-08-051)."""

_CAPPED = ("pet_s", "min_ttc_s")


@dataclass(frozen=True)
class WorstEpisode:
    """An episode with the value that ranks it.

    ``value`` is the value of the measure; None if it is undefined, and ``ending`` explains why.
    ``driver`` is the strategy that drove; ``sumo`` if none may drive the passage.  ``contact`` is
    the side of the vehicle that touched a pedestrian, and ``contact_speed_mps`` its speed then in
    m/s; None without a contact.
    ``varied`` has the cell's varied keys.  ``names`` identifies a passage within its
    arm by crosswalk, vehicle and time of R0; it is empty for an episode.
    """

    run: Path
    cell: int
    pair: int
    arm: Arm
    ending: Ending
    value: float | None
    driver: str
    contact: Contact | None
    contact_speed_mps: float | None
    varied: Mapping[str, Any] = field(default_factory=dict)
    names: Mapping[str, Any] = field(default_factory=dict)

    @property
    def command(self) -> str:
        """The shell command that shows the episode in sumo-gui."""
        cell = f" --cell {self.cell}" if self.cell else ""
        where = shlex.quote(str(self.run))
        passage = "".join(
            f" --{name} {shlex.quote(str(self.names[name]))}"
            for name in ("vehicle", "crosswalk")
            if name in self.names
        )
        pair = f"--pair {self.pair} --arm {self.arm.value}"
        return f"harness replay {where}{cell} {pair}{passage} --gui"


def worst(
    run: RunData | str | Path,
    by: str = "pet_s",
    most: int = 20,
    arm: Arm | str = Arm.AV,
    cell: int | None = None,
) -> list[WorstEpisode]:
    """Return the worst episodes of a run.

    For a conflict measure (PET, DRAC …) crashes come first, sorted by impact speed.  For delay and
    pass time, time-outs come first; crashes are excluded, because they have no such value.

    Args:
        run: a finished run or its folder.
        by: one of ``RANKED``.
        most: maximum number of episodes, 1 or more.
        arm: driver of the episodes, ``av`` or ``human``.
        cell: number of the cell; None: all cells.

    Raises:
        InputError: the run is not a finished run of encounters, the measure, arm or cell does not
            exist, ``most`` is less than 1, or every episode failed.
    """
    arm = _check(by, most, arm)
    data = opened_run(run)
    rows = _episodes(data, by, arm, cell)
    bad = rows[rows["badness"] > least(by)].nlargest(most, "badness", keep="all")
    return _ranked(data, bad, by, arm)[:most]


def _ranked(run: RunData, rows: pd.DataFrame, by: str, arm: Arm) -> list[WorstEpisode]:
    names = ["cell", "pair", *run.kind.ranked[1]]
    order = rows.sort_values(
        ["badness", *names], ascending=[False, *[True] * len(names)], kind="stable"
    )
    return [_episode(run, row, by, arm) for _, row in order.iterrows()]


def _check(by: str, most: int, arm: Arm | str) -> Arm:
    if by in COLUMNS and by not in RANKED:
        raise InputError(
            "--by", f"neither small nor large values of {by} are bad", ", ".join(RANKED)
        )
    if by not in RANKED:
        raise unknown_name("--by", "measure", by, RANKED)
    if most < 1:
        raise InputError("-n", f"{most}", "1 or more")
    if arm not in (*Arm,):
        raise unknown_name("--arm", "arm", str(arm), [*Arm])
    return Arm(arm)


def _episodes(run: RunData, by: str, arm: Arm, cell: int | None = None) -> pd.DataFrame:
    """Return the arm's completed episodes with a column ``badness``: larger is worse."""
    if run.kind.ranked[0] not in run.kind.records:
        problem = f"is a run of {run.kind.name}, which has no episodes to list"
        allowed = "passages.parquet of the run, or `harness replay RUN --pair 0 --arm av --gui`"
        raise InputError(str(run.path), problem, allowed)
    episodes, cells = run.ranked, len(run.study.cells)
    if by not in episodes:
        raise InputError(str(run.path), f"has no {by}", "a run that has it")
    if cell is not None and not 0 <= cell < cells:
        raise InputError("--cell", f"{cell}", f"0 to {cells - 1}")
    of_arm = episodes[(episodes["arm"] == arm.value) & (cell is None or episodes["cell"] == cell)]
    rows = of_arm[of_arm["ending"] != Ending.ENGINE_FAILED].copy()
    if rows.empty:
        where = str(run.path) if cell is None else f"{run.path}: cell {cell}"
        example = f"e.g. {of_arm['reason'].iloc[0]}" if len(of_arm) else "there is none"
        problem = f"all {len(of_arm)} episodes of {arm.value} failed, {example}"
        raise InputError(where, problem, "a run with an episode that did not fail")
    rows["badness"] = [
        badness(by, *values)
        for values in zip(rows[by], rows["ending"], rows["contact_speed_mps"], strict=True)
    ]
    return rows


_FINAL = 1_000_000.0
"""Badness above every value, for a crash or (for delay) a time-out."""


def badness(by: str, value: float | None, ending: str, contact_speed_mps: float | None) -> float:
    """Return an episode's badness by a measure of ``RANKED``; larger is worse, NaN undefined."""
    measure = RANKED[by]
    if measure.about == "time" and ending == Ending.TIMED_OUT:
        return _FINAL
    if measure.about == "conflict" and ending == Ending.CRASHED:
        return _FINAL + (contact_speed_mps or 0.0)
    if by == "contact_speed_mps":
        return 0.0
    if value is None or math.isnan(value):
        return -CONFLICT_S if by in _CAPPED else math.nan
    if by in _CAPPED:
        return -min(value, CONFLICT_S)
    return float(value if measure.worse == "large" else -value)


def least(by: str) -> float:
    """Return the badness up to which an episode is not listed."""
    if by in _CAPPED:
        return -CONFLICT_S
    return -math.inf if RANKED[by].worse == "small" or by == "delay_s" else 0.0


def _episode(run: RunData, row: "pd.Series[Any]", by: str, arm: Arm) -> WorstEpisode:
    return WorstEpisode(
        run.path,
        int(row["cell"]),
        int(row["pair"]),
        arm,
        Ending(row["ending"]),
        known(row[by]),
        row["strategy"],
        None if pd.isna(row["contact"]) else Contact(row["contact"]),
        known(row["contact_speed_mps"]),
        run.study.cells[int(row["cell"])].varied,
        {name: row[name] for name in run.kind.ranked[1]},
    )
