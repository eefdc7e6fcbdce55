"""What the fit of the interaction model adds to the error of a number.

A sweep over refits of a model, which are fits to resampled vehicles of its data, has a value θ_r of
each number for each of R refits.  Pairs are the same in all cells.  By the law of total variance
the variance of their mean is C + S² (1 + 1/R).  C is the mean variance over pairs, from the usual
intervals.  S² is the variance between refits; 1/R as in Rubin (1987), since R of them are averaged.
The interval adds the two errors as Zou and Donner (2008) do; that of the model has Student's t with
R − 1 degrees of freedom.
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy import special

from harness.results.catalogue import ENTRY_OF
from harness.results.finding import Finding, Form
from harness.results.findings import CellFindings
from harness.results.notes import FIRST, Note
from harness.results.result import Column, Entered, Shown, Style, Table

MODEL_KEYS = ("model.name", "model.path")
_KEYS = ("time_ratio", "mu", "kappa", "delay_difference_s")
_FEWEST = 3
_LARGE = 0.5
"""A note says so if the model has a larger share of the variance."""


def over_model(cells: Sequence[CellFindings]) -> tuple[list[Table], list[Note]]:
    """The numbers over the refits of a model, each with the interval that includes the fit.

    Empty if the cells are not a sweep over at least three refits of a model.
    """
    keys = {key for cell in cells for key in cell.varied}
    refits = all(".refit-" in str(value) for cell in cells for value in cell.varied.values())
    if len(cells) < _FEWEST or len(keys) != 1 or not keys <= {*MODEL_KEYS} or not refits:
        return [], []
    rows: list[tuple[Entered, ...]] = []
    notes: list[Note] = []
    for key in _KEYS:
        entry, found = ENTRY_OF[key], [cell[key] for cell in cells]
        number, share = combined(found)
        form = Form.SHARE if entry.form is Form.EVENTS else entry.form
        heading = entry.title(cells[0].scenario.conflicts.model_dump())
        part = None if share is None else Shown(Finding(share), Style(Form.SHARE))
        rows.append((heading, Shown(number, Style(form, entry.digits)), part))
        if share is not None and share > _LARGE and not notes:
            text = f"{100 * share:.0f} % of the variance of {entry.heading} is the model's fit: "
            text += "more pairs will not help. Data of more vehicles would."
            notes.append(Note("over_model", FIRST, "the model's fit", text))
    columns = (
        Column("measure", ""),
        Column("over_model", f"over {len(cells)} refits, with the fit's error", True),
        Column("model_share", "the fit's share of the variance"),
    )
    return [Table("Over the model's refits", columns, tuple(rows))], notes


def combined(found: Sequence[Finding]) -> tuple[Finding, float | None]:
    """The mean of findings over refits, with its interval, and the model's share of the variance.

    Undefined without a value in each; without an interval if one of them has none.
    """
    values = np.array([np.nan if each.value is None else each.value for each in found])
    if np.isnan(values).any():
        return Finding(None, reason="a refit has no value"), None
    mean, count = float(values.mean()), len(values)
    model = float(values.var(ddof=1)) * (1 + 1 / count)
    lows = [each.low for each in found if each.low is not None]
    highs = [each.high for each in found if each.high is not None]
    if not len(lows) == len(highs) == count:
        return Finding(mean, n=count, reason="a refit has no interval"), None
    low, high = float(np.mean(values - lows)), float(np.mean(np.array(highs) - values))
    pairs = ((low + high) / 2 / special.ndtri(0.975)) ** 2
    q = float(special.stdtrit(count - 1, 0.975)) * math.sqrt(model)
    reliable = all(each.reliable for each in found)
    interval = mean - math.hypot(low, q), mean + math.hypot(high, q)
    share = model / (model + pairs) if model + pairs > 0 else None
    return Finding(mean, *interval, n=count, reliable=reliable), share
