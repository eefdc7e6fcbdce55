"""The time–space diagram of an approach, with the people on the crosswalk."""

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes

from harness.encounter import Arm
from harness.report import style
from harness.report.shown_hour import ShownHour
from harness.report.style import Picture
from harness.report.tables import ARM_NAMES
from harness.report.words import pair_name
from harness.runs.run_data import RunData
from harness.traffic.lanes import Direction, lanes_of

_BACK_M = 150.0
_BEYOND_M = 40.0
_BAR_M = 4.0


def time_space(run: RunData, hour: ShownHour) -> Picture:
    """Front bumpers of the ego's direction over time, and a bar for each pedestrian."""
    figure, panels = style.new_figure(len(Arm), height=1.7 * style.HEIGHT_INCH)
    scenario = run.scenario_of(hour.cell)
    lanes = lanes_of(scenario)
    forward_m = [lane.centre_m for lane in lanes if lane.direction is Direction.FORWARD]
    names = {Arm.AV: scenario.arms.av, Arm.HUMAN: scenario.arms.human}
    for arm, axes in zip(Arm, panels, strict=True):
        _panel(axes, hour, arm, forward_m, style.ARM_LOOKS[arm])
        style.finish(axes, "time since the warm-up (s)", "distance to the crosswalk (m)")
        axes.set_title(style.figure_text(f"{ARM_NAMES[arm]}: {names[arm]}"), loc="left")
    where = pair_name(run, hour.cell, hour.pair).capitalize()
    note = f" {hour.note}" if hour.note else ""
    return Picture(
        "time-space",
        "Time–space diagram of the approach",
        f"{where}, around its longest queue: front bumpers of the ego's direction (a flat line "
        "stands), and a bar at the crosswalk for each pedestrian, thin while they wait, thick "
        f"while they cross.{note}",
        figure,
    )


def _panel(
    axes: Axes, hour: ShownHour, arm: Arm, forward_m: Sequence[float], look: style.Look
) -> None:
    ways = hour.ways[hour.ways["arm"] == arm.value]
    own = ways[ways["time_s"].between(hour.begin_s, hour.end_s) & ways["y_m"].isin(forward_m)]
    for _, rows in own[own["object"].str.startswith("vehicle-")].groupby("object", sort=False):
        shown = rows[rows["x_m"].between(-_BACK_M, _BEYOND_M)]
        axes.plot(shown["time_s"], -shown["x_m"], color=look.colour, lw=0.9)
    _bars(axes, hour, arm)
    axes.set_xlim(hour.begin_s, hour.end_s)
    axes.set_ylim(_BACK_M, -_BEYOND_M)


def _bars(axes: Axes, hour: ShownHour, arm: Arm) -> None:
    walks = hour.walks[hour.walks["arm"] == arm.value]
    for row in walks.to_dict("records"):
        start = hour.end_s if pd.isna(row["start_s"]) else row["start_s"]
        end = hour.end_s if pd.isna(row["cleared_s"]) else row["cleared_s"]
        if row["arrival_s"] > hour.end_s or end < hour.begin_s:
            continue
        axes.plot([row["arrival_s"], start], [0, 0], color=style.INK, lw=1.0, solid_capstyle="butt")
        axes.plot([start, end], [0, 0], color=style.INK, lw=_BAR_M, solid_capstyle="butt")
