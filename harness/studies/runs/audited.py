"""The findings of a plain-engine run's audit: records that differ in SUMO, and ties."""

import pandas as pd

from harness.scenario import Study
from harness.studies.kinds.tasks import Failure


def shared_once(audit: pd.DataFrame, study: Study) -> pd.DataFrame:
    """Return the rows of ``audit``; if cells share an episode, only the first cell lists it."""
    same = {cell.number: cell.but_for_arms for cell in study.cells}
    arms = {cell.number: cell.scenario.arms for cell in study.cells}
    keys = [
        (same[cell], pair, arm, getattr(arms[cell], arm))
        for cell, pair, arm in audit[["cell", "pair", "arm"]].itertuples(index=False)
    ]
    return audit[~pd.Series(keys, audit.index, dtype=object).duplicated()]


def disagreements(audited: pd.DataFrame) -> tuple[Failure, ...]:
    """Return (cell, pair, arm, difference) of each record that differs in SUMO, without ties."""
    rows = audited.dropna(subset="difference")
    rows = rows[rows["tie_s"].isna()].drop(columns="tie_s")
    return tuple(rows.itertuples(index=False, name=None))


def ties(audited: pd.DataFrame) -> tuple[Failure, ...]:
    """Return (cell, pair, arm, time and difference) of each record that differs by a tie."""
    rows = audited.dropna(subset="tie_s").itertuples(index=False, name=None)
    return tuple(
        (cell, pair, arm, f"tie at {when:.3f} s, {what}") for cell, pair, arm, what, when in rows
    )
