"""The figures of a run in traffic: delays and capacity over what is varied, queues over time."""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from harness.report.drawing import style
from harness.report.drawing.hour_figures import time_space
from harness.report.drawing.style import Picture
from harness.report.drawing.sweep_figures import Line, draw_over
from harness.report.pages.sweep_pictures import across_key, axis_label
from harness.report.screens.tables import ARM_NAMES
from harness.scenario import Cell, as_written
from harness.store.hour_summaries import HoursSummary
from harness.studies.runs.run_data import RunData
from harness.studies.runs.shown import ShownPair

_OVER = (
    ("vehicle_delay_s", "delay of vehicles (s)", "Delay of vehicles"),
    ("pedestrian_delay_s", "delay of pedestrians (s)", "Delay of pedestrians"),
    ("throughput_per_hour", "throughput (vehicles per hour)", "Throughput"),
)


def hour_pictures(run: RunData, hour: ShownPair | None) -> Iterator[Picture]:
    """The figures of a run in traffic and of the hour shown; call it inside ``style.styled``."""
    if not run.varied_keys:
        yield _queues(run)
    elif (key := across_key(run)) is not None:
        for name, up, title in _OVER:
            yield from _over(run, key, name, up, title)
    if hour is not None:
        yield time_space(run, hour)


def _over(run: RunData, key: str, name: str, up: str, title: str) -> Iterator[Picture]:
    """A measure over the main varied key: a line for each strategy, and one for the reference."""
    groups: dict[str, list[tuple[Cell, HoursSummary]]] = {}
    # ``--settle`` sets the warm-up of each cell, so cells that differ in it alone share a line.
    same_line = (key, "traffic.warm_up_s")
    for cell, summary in run.hour_results:
        others = [as_written(cell.varied[name]) for name in cell.varied if name not in same_line]
        groups.setdefault(", ".join(others) or cell.scenario.arms.av, []).append((cell, summary))
    lines = [_line(f"AV's arm: {label}", cells, key, name, 0) for label, cells in groups.items()]
    references = {cell.scenario.arms.human for cell, _ in run.hour_results}
    if len(references) == 1:
        # The second entry of ``style.SERIES`` is the look of the human's arm.
        label = f"reference: {next(iter(references))}"
        lines.insert(1, _line(label, next(iter(groups.values())), key, name, 1))
    lines = [line for line in lines if len(line.x)]
    if not lines:
        return
    figure, (axes,) = style.new_figure()
    draw_over(axes, lines[: len(style.SERIES)], axis_label(key), up)
    left = len(lines) - len(style.SERIES)
    more = f" summary.csv has {left} more strategies." if left > 0 else ""
    yield Picture(
        f"over-{name.replace('_', '-')}",
        f"{title} over {key}",
        "Mean over the hours of a cell with its interval (Student's t). If a road is saturated, "
        f"its delay holds for the simulated hour alone.{more}",
        figure,
    )


def _line(
    label: str, cells: Sequence[tuple[Cell, HoursSummary]], key: str, name: str, arm: int
) -> Line:
    """A measure of one arm over a key; an undefined limit is replaced by the value."""
    intervals = ((float(cell.varied[key]), hours.measures[name][arm]) for cell, hours in cells)
    points = sorted(
        (x, mean.value, *(mean.value if end is None else end for end in (mean.low, mean.high)))
        for x, mean in intervals
        if mean.value is not None
    )
    return Line(label, *np.array(points, dtype=float).reshape(-1, 4).T)


def _queues(run: RunData) -> Picture:
    """Queued vehicles over the hour in both arms, mean over pairs and lanes."""
    figure, (axes,) = style.new_figure()
    for arm, look in style.ARM_LOOKS.items():
        queues = run.queues[run.queues["arm"] == arm.value]
        mean: pd.Series[float] = queues.groupby("minute")["mean"].mean()
        line = mean.index, mean.to_numpy()
        axes.plot(*line, color=look.colour, ls=look.dash, label=ARM_NAMES[arm])
    style.finish(axes, "minute", "queued vehicles per lane")
    return Picture(
        "queues",
        "Queue over time",
        "Number of vehicles that are slower than 5 km/h on the approach or wait upstream of the "
        "road; mean of each minute over pairs and lanes.",
        figure,
    )
