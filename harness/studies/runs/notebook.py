"""Results for a notebook: a table, and a figure of values with their intervals."""

import io
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from harness.statistics import Difference, Interval
from harness.store.summaries import interval_from

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 12
"""Maximum number of cells or differences in a figure."""


def table_html(caption: str, table: pd.DataFrame) -> str:
    """Return a table as HTML.  Its values are escaped, so that a file cannot add markup."""
    # Long names are not shortened.
    with pd.option_context("display.max_colwidth", None):
        html: str = table.to_html(index=False, border=0)
    return html.replace(">", f"><caption>{escape(caption)}</caption>", 1)


def figure_html(figure: "Figure") -> str:
    """Return a figure as an ``<svg>`` element."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg")
    return buffer.getvalue()[buffer.getvalue().index("<svg") :]


def intervals_html(
    intervals: Sequence[tuple[str, Interval | Difference]], label: str, mark: float
) -> str:
    """Draw the first values with their intervals, one per row, and a vertical line at ``mark``."""
    from matplotlib.figure import Figure

    drawn = [(name, each) for name, each in intervals if each.value is not None][:_MOST]
    figure = Figure(figsize=(5.8, 1.0 + 0.3 * len(drawn)), layout="constrained")
    axes = figure.subplots()
    for place, (_, each) in enumerate(drawn):
        limits = np.array([each.low, each.high], dtype=float)
        (line,) = axes.plot(limits, [place, place], marker="|")
        axes.plot(np.array([each.value]), [place], "o", color=line.get_color())
    axes.set_yticks(range(len(drawn)), [name.replace("$", r"\$") for name, _ in drawn])
    axes.axvline(mark, color="#57606a", lw=1)
    axes.invert_yaxis()
    axes.set_xlabel(label)
    return figure_html(figure)


def run_html(name: str, varied: list[str], summary: pd.DataFrame, finished: bool) -> str:
    """Return the summary of a run as HTML; without μ it is a table of all columns.

    Args:
        name: name of the run.
        varied: the varied keys.
        summary: a row for each cell, as in ``RunData.summary``.
        finished: False while the run continues.
    """
    if "mu" not in summary:
        return table_html(name, summary)
    cells = summary.head(_MOST)
    table = cells[["cell", *varied, "pairs"]].copy()
    for heading, column in (("μ", "mu"), ("κ", "kappa"), ("delay AV s", "delay_s")):
        table[heading] = [interval_from(row, column).words(".4g") for _, row in cells.iterrows()]
    mu = [(_label(name, varied, row), interval_from(row, "mu")) for _, row in cells.iterrows()]
    more = f", {len(summary) - _MOST} more cells" if len(summary) > _MOST else ""
    caption = f"{name}{'' if finished else ' (unfinished)'}{more}"
    return table_html(caption, table) + intervals_html(mu, "μ with its interval", 1.0)


def _label(name: str, varied: list[str], row: "pd.Series[Any]") -> str:
    return ", ".join(f"{key.rpartition('.')[2]}={row[key]}" for key in varied) or name
