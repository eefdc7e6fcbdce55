"""The figures of a run of a user's own simulation."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from harness.core.encounter import Arm
from harness.old.report.drawing import style
from harness.old.report.drawing.safety_figures import draw_shares
from harness.old.report.drawing.style import Picture
from harness.old.report.drawing.sweep_figures import Line, draw_over, lines_of
from harness.old.report.pages.sweep_pictures import across_key, axis_label
from harness.old.report.screens.tables import level
from harness.old.statistics import CONFIDENCE
from harness.old.studies.runs.run_data import RunData
from harness.scenario import as_written

_OVER = (
    ("av_time_loss_s", "time loss of AVs"),
    ("other_time_loss_s", "time loss of other vehicles"),
    ("people_time_loss_s", "time loss of people"),
    ("queue_p95_m", "queue, 95 %"),
)
_SAFETY = (("pet_s", "PET (s)", "PET"), ("min_ttc_s", "smallest TTC (s)", "TTC"))
_UP_TO_S = 5.0
_MOST_SAFETY = 3
"""Maximum number of crosswalks that have a panel each."""


def simulation_pictures(run: RunData) -> Iterator[Picture]:
    """Return the figures of a run with finished pairs.  Call this inside ``style.styled``."""
    if not run.varied_keys:
        yield from _safety(run)
    elif (key := across_key(run)) is not None:
        for name, words in _OVER:
            yield from _over(run, key, name, words)


def _over(run: RunData, key: str, name: str, words: str) -> Iterator[Picture]:
    """Draw a measure over the main varied key, by strategy and for the reference."""
    summary = run.summary
    others = [each for each in run.varied_keys if each != key]
    labels = [", ".join(as_written(row[each]) for each in others) for _, row in summary.iterrows()]
    labels = [label or run.scenario.arms.av for label in labels]
    x = summary[key].astype(float)
    lines = [
        Line(f"AV's arm: {line.label}", line.x, line.value, line.low, line.high)
        for line in lines_of(summary, x.tolist(), labels, name)
    ]
    if others in ([], ["arms.av"]):
        # Cells that differ only in the AV have the same reference arm.
        once = np.array(labels) == labels[0]
        label = [f"reference: {run.scenario.arms.human}"] * int(once.sum())
        lines[1:1] = lines_of(summary[once], x[once].tolist(), label, f"{name}_human")
    lines = [_defined(line) for line in lines]
    lines = [line for line in lines if len(line.x)]
    if not lines:
        return
    unit = "m" if name.endswith("_m") else "s"
    figure, (axes,) = style.new_figure()
    draw_over(axes, lines[: len(style.SERIES)], axis_label(key), f"{words} ({unit})")
    left = len(lines) - len(style.SERIES)
    more = f" summary.csv has {left} more strategies." if left > 0 else ""
    yield Picture(
        f"over-{name.rsplit('_', 1)[0].replace('_', '-')}",
        f"{words[0].upper()}{words[1:]} over {axis_label(key)}",
        f"Mean over pairs with its {level(CONFIDENCE)} interval (Student's t). In the "
        f"reference's arm AVs are the vehicles that are AVs in the other one.{more}",
        figure,
    )


def _defined(line: Line) -> Line:
    """Return the points of a line that have a value.  The value replaces an undefined limit."""
    there = ~np.isnan(line.value)
    x, value, low, high = (each[there] for each in (line.x, line.value, line.low, line.high))
    low, high = (np.where(np.isnan(end), value, end) for end in (low, high))
    return Line(line.label, x, value, low, high)


def _busiest(rows: pd.DataFrame) -> list[str]:
    """Return the crosswalks, sorted by descending number of people."""
    people = rows.groupby("crosswalk", sort=False)["people"].sum()
    return [str(name) for name in people.sort_values(ascending=False, kind="stable").index]


def _safety(run: RunData) -> Iterator[Picture]:
    """Draw PET and TTC of the passages with people at the busiest crosswalks."""
    met = run.passages_over[run.passages_over["pedestrians"] > 0]
    names = [
        name
        for name in _busiest(run.table("crosswalks").to_pandas())
        if (met["crosswalk"] == name).any()
    ]
    human = run.scenario.arms.human
    for column, across, words in _SAFETY:
        if met[column].isna().all() or not names:
            continue
        shown = names[:_MOST_SAFETY]
        figure, panels = style.new_figure(len(shown), height=0.4 + 3.0 * len(shown))
        for axes, name in zip(panels, shown, strict=True):
            there = met[met["crosswalk"] == name]
            values = {
                label: there.loc[there["arm"] == arm.value, column].to_numpy(dtype=float)
                for label, arm in (("AV", Arm.AV), (human, Arm.HUMAN))
            }
            draw_shares(axes, values, across, _UP_TO_S, "share of passages at most x", name)
        more = len(names) - len(shown)
        yield Picture(
            f"safety-{words.lower()}",
            f"{words} at the crosswalks",
            f"Share of passages with people whose {words} is at most x, in both arms, at the "
            f"{'' if more == 0 else f'{len(shown)} '}crosswalks with the most people. A curve ends "
            "below 1 where the measure is undefined or larger. A contact has TTC 0 and no PET."
            + (f" Crosswalks that are left out: {more}." if more else ""),
            figure,
        )
