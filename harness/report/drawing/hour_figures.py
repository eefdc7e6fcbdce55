"""The time–space diagram of an approach, with the people on the crosswalk."""

from itertools import islice

import numpy as np
from matplotlib.axes import Axes

from harness.core.encounter import Arm
from harness.episode.traffic.demand import scheduled_vehicles
from harness.episode.traffic.lanes import Direction, Lane, lanes_of
from harness.report.drawing import style
from harness.report.drawing.style import Picture
from harness.report.pages.player import pair_title
from harness.report.screens.tables import ARM_NAMES
from harness.scenario import Scenario
from harness.studies.runs.run_data import RunData
from harness.studies.runs.shown import ShownPair

_BACK_M = 150.0
_BEYOND_M = 40.0


def time_space(run: RunData, hour: ShownPair) -> Picture:
    """Front bumpers of the ego's direction over time, and a bar for each pedestrian."""
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
    """A line for each vehicle: its dash shows the lane, its colour whether it is an AV."""
    states = hour.traces[hour.traces["arm"] == arm.value]
    states = states[states["time_s"].between(hour.begin_s, hour.end_s)]
    numbers = states["object"].str.extract(r"^vehicle-(\d+)$", expand=False).dropna().astype(int)
    road = lanes_of(scenario)
    forward = [lane for lane in road if lane.direction is Direction.FORWARD]
    # Sorted by lane, so that the legend is, too.
    for number in sorted(numbers.unique(), key=lambda number: (number % len(road), number)):
        lane = road[number % len(road)]
        if lane not in forward:
            continue
        rows = states.loc[numbers.index[numbers == number]]
        shown = rows[rows["x_m"].between(-_BACK_M, _BEYOND_M)]
        automated = arm is Arm.AV and _is_automated(scenario, hour.pair, lane, number // len(road))
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


def _is_automated(scenario: Scenario, pair: int, lane: Lane, count: int) -> bool:
    """Whether a lane's vehicle is an AV in the AV's arm; vehicles of the warm-up have no row."""
    planned = next(islice(scheduled_vehicles(scenario, pair, lane), count, None))
    return planned.uniform < scenario.known_traffic.av_share
