"""A run as a notebook shows it: what its cells came to, in a table and a small picture."""

from typing import Any

import pandas as pd

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
        values = (_known(row[f"mu{end}"]) for end in ("", "_ci_low", "_ci_high"))
        intervals.append((label, *values))
    more = f", {len(summary) - _MOST} more cells" if len(summary) > _MOST else ""
    caption = f"{name}{'' if finished else ' (unfinished)'}{more}"
    headings = ["cell", *varied, "pairs", "μ", "κ", "delay AV s"]
    picture = intervals_sketch(intervals, f"{name}: μ with its interval; the line is μ = 1", 1.0)  # type: ignore[arg-type]
    return html_table(caption, headings, rows) + picture


def _with_limits(row: "pd.Series[Any]", name: str) -> str:
    value, low, high = (_known(row[f"{name}{end}"]) for end in ("", "_ci_low", "_ci_high"))
    if value is None:
        return "undefined"
    limits = "" if low is None or high is None else f" ({low:.4g} … {high:.4g})"
    return f"{value:.4g}{limits}"


def _known(value: float | None) -> float | None:
    return None if value is None or pd.isna(value) else float(value)
