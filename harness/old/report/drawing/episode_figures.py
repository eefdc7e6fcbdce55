"""Figures of single episodes: arrivals of pedestrians, speed over distance and over time.

They follow the paper's figures of arriving times and of the Soft-Yield model.  Each function but
``top_view`` draws into the given axes and neither saves nor shows the figure.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from harness.core.encounter import Arrival, Crossing, FloatArray, Side
from harness.old.report.drawing.style import (
    ARM_LOOKS,
    BLUE,
    GRID,
    MUTED,
    SERIES,
    VERMILLION,
    finish,
)
from harness.old.report.screens.tables import ARM_NAMES, counted


def draw_arrivals(
    axes: Axes,
    arrivals: Sequence[Arrival],
    flow_per_hour: float,
    most: int | None = None,
    horizon_s: float = 60.0,
) -> None:
    """Draw the cumulative number of arrivals over time; markers show the pedestrians' sides.

    Args:
        arrivals: the arrivals of one pair, sorted by time.
        flow_per_hour: λ; the expected number λt is drawn too.
        most: number of simulated pedestrians; None for all.  The others are drawn hollow.
        horizon_s: end of the time axis; later arrivals are left out.
    """
    shown = [arrival for arrival in arrivals if arrival.arrival_s <= horizon_s]
    times = [arrival.arrival_s for arrival in shown]
    axes.step(
        [0.0, *times, horizon_s], [*range(len(times) + 1), len(times)], where="post", color=MUTED,
        lw=1.4, label="arrived",
    )  # fmt: skip
    for side, marker, colour, words in (
        (Side.NEAR, "^", BLUE, "from the ego's side"),
        (Side.FAR, "v", VERMILLION, "from the other side"),
    ):
        for fill, label in ((colour, words), ("none", f"{words}, not simulated")):
            marks = [
                (arrival.arrival_s, number)
                for number, arrival in enumerate(shown, start=1)
                if arrival.side is side and (most is None or number <= most) is (label == words)
            ]
            if marks:
                axes.plot(
                    *zip(*marks, strict=True), marker, mfc=fill, mec=colour, ms=7, label=label,
                    clip_on=False,
                )  # fmt: skip
    axes.plot(
        [0, horizon_s], [0, flow_per_hour * horizon_s / 3600], color=MUTED, ls=":", lw=1.2,
        label="expected, λt",
    )  # fmt: skip
    axes.set_xlim(0, horizon_s)
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    finish(axes, "time since the trigger (s)", "pedestrians arrived", f"n = {len(shown)}")


def draw_speed_over_distance(
    axes: Axes, traces: Mapping[str, pd.DataFrame], crossing_width_m: float
) -> None:
    """Draw both arms' ego speed over the distance from the front bumper to the centre line.

    Args:
        traces: by label, the ``traces`` rows of both arms of one pair.
        crossing_width_m: width of the shaded crosswalk.
    """
    half = crossing_width_m / 2
    axes.axvspan(-half, half, color=GRID, lw=0, label="crosswalk", zorder=0)
    axes.invert_xaxis()
    _speeds(axes, traces, "x_m", -1, "R, front bumper to centre line (m)")


def draw_speed_over_time(axes: Axes, traces: Mapping[str, pd.DataFrame]) -> None:
    """Draw the ego's speed over the time since the trigger, for both arms' traces by label."""
    _speeds(axes, traces, "time_s", 1, "time since the trigger (s)")


def _speeds(
    axes: Axes, traces: Mapping[str, pd.DataFrame], column: str, sign: int, across: str
) -> None:
    """Draw the ego's speed in every pair (colour) and arm (dash)."""
    drawn = 0
    for (label, rows), series in zip(traces.items(), SERIES, strict=False):
        ego = rows[rows["object"] == "ego"]
        for arm, look in ARM_LOOKS.items():
            states = ego[ego["arm"] == arm.value]
            if len(states):
                axes.plot(
                    sign * states[column], states["speed_mps"], color=series.colour, ls=look.dash,
                    lw=1.6, label=f"{label}, {ARM_NAMES[arm]}",
                )  # fmt: skip
                drawn += 1
    axes.set_ylim(bottom=0)
    axes.margins(x=0)
    count = f"n = {drawn} episodes of {counted(len(traces), 'pair')}"
    finish(axes, across, "speed v (m/s)", count)


def time_advantage(rows: pd.DataFrame, crossing: Crossing) -> FloatArray:
    """Return T_adv = |R/v − L/v_p| over time, the minimum over pedestrians.

    Args:
        rows: the ``traces`` rows of one arm of one pair.
        crossing: the crosswalk from the ego's lane.

    Returns:
        Values in s, one for each of the ego's rows.  A value is NaN if R ≤ 0 or v = 0, or if nobody
        on the crossing is walking and has L > 0.
    """
    parts = dict(iter(rows.groupby("object", sort=False)))
    ego = parts.pop("ego", rows.iloc[:0])
    times = ego["time_s"].to_numpy()
    distance, speed = -ego["x_m"].to_numpy(), ego["speed_mps"].to_numpy()
    smallest = np.full(len(times), np.nan)
    for name, walker in parts.items():
        if not str(name).startswith("pedestrian-"):
            continue  # a perceived position of a pedestrian, not the true one
        y, walking = walker["y_m"].to_numpy(), np.abs(walker["speed_mps"].to_numpy())
        # The walking direction; without movement they are assumed to be near their kerb.
        direction = np.sign(y[-1] - y[0]) or (1.0 if y[0] < crossing.length_m / 2 else -1.0)
        lateral = (crossing.lane_centre_m - y) * direction
        at = np.searchsorted(times, walker["time_s"].to_numpy())
        ahead = (distance[at] > 0) & (lateral > 0) & (speed[at] > 0) & (walking > 0)
        at = at[ahead]
        advantage = np.abs(distance[at] / speed[at] - lateral[ahead] / walking[ahead])
        smallest[at] = np.fmin(smallest[at], advantage)
    return smallest
