"""The figures of a run in traffic: measures over a varied key, queues, time–space diagram."""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from harness.core.encounter import Arm
from harness.encounter.traffic.demand import scheduled_vehicle
from harness.encounter.traffic.lanes import Direction, lanes_of
from harness.old.report.drawing import style
from harness.old.report.drawing.style import Picture
from harness.old.report.drawing.sweep_figures import Line, draw_over
from harness.old.report.pages.sweep_pictures import across_key, axis_label
from harness.old.report.pages.traces import pair_title
from harness.old.report.screens.tables import ARM_NAMES
from harness.old.store.hour_summaries import HoursSummary
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.shown import ShownPair
from harness.scenario import Cell, Scenario, as_written

_OVER = (
    ("vehicle_delay_s", "delay of vehicles (s)", "Delay of vehicles"),
    ("pedestrian_delay_s", "delay of pedestrians (s)", "Delay of pedestrians"),
    ("throughput_per_hour", "throughput (vehicles per hour)", "Throughput"),
)
_BACK_M = 150.0
_BEYOND_M = 40.0


def hour_pictures(run: RunData, hour: ShownPair | None) -> Iterator[Picture]:
    """Return the figures of a run in traffic and of its shown hour, inside ``style.styled``."""
    if not run.varied_keys:
        yield _queues(run)
    elif (key := across_key(run)) is not None:
        for name, up, title in _OVER:
            yield from _over(run, key, name, up, title)
    if hour is not None:
        yield time_space(run, hour)


def _over(run: RunData, key: str, name: str, up: str, title: str) -> Iterator[Picture]:
    """Draw a measure over the main varied key, by strategy and for the reference."""
    groups: dict[str, list[tuple[Cell, HoursSummary]]] = {}
    for cell, summary in run.hour_results:
        others = [as_written(cell.varied[name]) for name in cell.varied if name != key]
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
    """Return a measure of one arm over a key.  The value replaces an undefined limit."""
    intervals = ((float(cell.varied[key]), hours.measures[name][arm]) for cell, hours in cells)
    points = sorted(
        (x, mean.value, *(mean.value if end is None else end for end in (mean.low, mean.high)))
        for x, mean in intervals
        if mean.value is not None
    )
    return Line(label, *np.array(points, dtype=float).reshape(-1, 4).T)


def _queues(run: RunData) -> Picture:
    """Draw the queued vehicles over the hour in both arms, as means over pairs and lanes."""
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


def time_space(run: RunData, hour: ShownPair) -> Picture:
    """Draw front bumpers in the ego's direction over time, and a bar for each pedestrian."""
    figure, panels = style.new_figure(len(Arm), height=1.7 * style.HEIGHT_INCH)
    scenario = run.scenario_of(hour.cell)
    names = {Arm.AV: scenario.arms.av, Arm.HUMAN: scenario.arms.human}
    for arm, axes in zip(Arm, panels, strict=True):
        _panel(axes, hour, arm, scenario)
        style.finish(axes, "time since the warm-up (s)", "distance to the crosswalk (m)")
        axes.set_title(style.figure_text(f"{ARM_NAMES[arm]}: {names[arm]}"), loc="left")
    where = pair_title(run, hour.cell, hour.pair)
    note = f" {hour.note}" if hour.note else ""
    return Picture(
        "time-space",
        "Time–space diagram of the approach",
        f"{where[0].upper()}{where[1:]}, around its longest queue. Lines are front bumpers of the "
        "forward direction: a horizontal line is a standing vehicle, the dash shows the lane, the "
        "colour shows whether it is an AV. Bars at the crosswalk are pedestrians: thin while they "
        f"wait, thick while they cross.{note}",
        figure,
    )


def _panel(axes: Axes, hour: ShownPair, arm: Arm, scenario: Scenario) -> None:
    """Draw a line for each vehicle.  Its dash shows the lane; its colour shows AVs."""
    states = hour.traces[hour.traces["arm"] == arm.value]
    states = states[states["time_s"].between(hour.begin_s, hour.end_s)]
    numbers = states["object"].str.extract(r"^vehicle-(\d+)$", expand=False).dropna().astype(int)
    road = lanes_of(scenario)
    forward = [lane for lane in road if lane.direction is Direction.FORWARD]
    # Sorting by lane sorts the legend too.
    for number in sorted(numbers.unique(), key=lambda number: (number % len(road), number)):
        lane = road[number % len(road)]
        if lane not in forward:
            continue
        rows = states.loc[numbers.index[numbers == number]]
        shown = rows[rows["x_m"].between(-_BACK_M, _BEYOND_M)]
        planned = scheduled_vehicle(scenario, hour.pair, number)
        automated = arm is Arm.AV and planned.uniform < scenario.known_traffic.av_share
        look = style.ARM_LOOKS[Arm.AV if automated else Arm.HUMAN]
        words = "AVs" if automated else "others"
        label = words if len(forward) == 1 else f"{words}, lane {lane.index}"
        known = axes.get_legend_handles_labels()[1]
        axes.plot(
            shown["time_s"], -shown["x_m"], color=look.colour, lw=0.9,
            ls=style.SERIES[lane.index % len(style.SERIES)].dash,
            label=None if label in known else label,
        )  # fmt: skip
    people = hour.people[hour.people["arm"] == arm.value]
    people = people.fillna({"start_s": hour.end_s, "cleared_s": hour.end_s})
    people = people[(people["arrival_s"] <= hour.end_s) & (people["cleared_s"] >= hour.begin_s)]
    at_crosswalk = np.zeros(len(people))
    axes.hlines(at_crosswalk, people["arrival_s"], people["start_s"], color=style.INK, lw=1.0)
    axes.hlines(at_crosswalk, people["start_s"], people["cleared_s"], color=style.INK, lw=4.0)
    axes.set_xlim(hour.begin_s, hour.end_s)
    axes.set_ylim(_BACK_M, -_BEYOND_M)
