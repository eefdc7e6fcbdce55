"""A run as a notebook shows it: what its cells came to, in a table and a small picture."""

from typing import Any

import pandas as pd

from harness.results.summaries import interval_from
from harness.sketch import html_table, intervals_sketch

_MOST = 12
"""Cells shown."""


def run_html(name: str, varied: list[str], summary: pd.DataFrame, finished: bool) -> str:
    """The summary of a run of encounters.

    Args:
        name: of the run.
        varied: the varied keys.
        summary: a row for each cell, as ``RunData.summary``.
        finished: False while the run goes on.
    """
    shown = summary.head(_MOST)
    rows, intervals = [], []
    for _, row in shown.iterrows():
        label = ", ".join(f"{key.rpartition('.')[2]}={row[key]}" for key in varied) or name
        rows.append(
            [
                str(row["cell"]),
                *(str(row[key]) for key in varied),
                str(row["pairs"]),
                _with_limits(row, "mu"),
                _with_limits(row, "kappa"),
                _with_limits(row, "delay_s"),
            ]
        )
        mu = interval_from(row, "mu")
        intervals.append((label, mu.value, mu.low, mu.high))
    more = f", {len(summary) - _MOST} more cells" if len(summary) > _MOST else ""
    caption = f"{name}{'' if finished else ' (unfinished)'}{more}"
    headings = ["cell", *varied, "pairs", "μ", "κ", "delay AV s"]
    picture = intervals_sketch(intervals, f"{name}: μ with its interval; the line is μ = 1", 1.0)
    return html_table(caption, headings, rows) + picture


def _with_limits(row: "pd.Series[Any]", name: str) -> str:
    return interval_from(row, name).words(".4g")
