"""The figures of a sweep: measures over its main key, and over a strategy's aggressiveness."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from harness.old.report.drawing import style, sweep_figures as draw
from harness.old.report.drawing.style import Picture
from harness.old.report.screens.tables import level as words_of_level
from harness.old.statistics import CONFIDENCE
from harness.old.studies.runs.run_data import RunData
from harness.old.studies.runs.strategy_groups import (
    ParameterSweep,
    StrategyGroup,
    parameter_sweeps,
    strategy_groups,
)
from harness.scenario import as_written
from harness.scenario.units import unit_of

_FLOW = "pedestrians.flow_per_hour"
_RATIO = "ratio of times, Σ AV / Σ reference (below 1: the AV is faster)"
_MEASURES = (
    ("time_ratio", "AV times / reference times", _RATIO),
    ("mu", "μ: AV time / reference time", "μ, mean of AV time / reference time"),
    ("kappa", "κ, crash rate of the AV", "κ, crash rate of the AV"),
    ("delay_s", "delay of the AV (s)", "mean delay of the AV"),
    ("pedestrian_delay_s", "delay of pedestrians (s)", "delay of pedestrians in the AV's arm"),
)
_BESIDE = (_MEASURES[0], *_MEASURES[3:])
"""Measures that the figure of aggressiveness does not show."""

_MOST_SWEEPS = 4
"""Maximum number of swept parameters; if there are more, none has a figure."""

_FEWEST_VALUES = 3


def sweep_pictures(run: RunData) -> Iterator[Picture]:
    """Return the figures over cells.  Call this inside ``style.styled``."""
    swept = _parameters(run)
    for number, (group, parameter) in enumerate(swept):
        yield _aggressiveness(run, group, parameter, number if len(swept) > 1 else None)
    key = across_key(run)
    if key is not None:
        drawn = any(parameter.key == key for _, parameter in swept)
        yield from _over(run, key, _BESIDE if drawn else _MEASURES)


def across_key(run: RunData) -> str | None:
    """Return the key of the x axis: the flow, or else the numeric key with the most values."""
    varied = run.summary[run.varied_keys].select_dtypes("number").dropna(axis="columns").nunique()
    numeric = varied[varied > 1]
    if _FLOW in numeric or numeric.empty:
        return _FLOW if _FLOW in numeric else None
    return str(numeric.idxmax())


def axis_label(key: str) -> str:
    """Return a varied key as an axis label, with the unit in which the key's name ends."""
    if key == _FLOW:
        return "pedestrian flow λ (per hour)"
    *section, name = key.split(".")
    owner = f"{section[1]}: " if section[:1] == ["strategies"] and len(section) > 1 else ""
    ending, unit = unit_of(name) or ("", "")
    words = owner + name.removesuffix(ending).replace("_", " ")
    return f"{words} ({unit})" if unit else words


def _over(run: RunData, key: str, measures: tuple[tuple[str, str, str], ...]) -> Iterator[Picture]:
    """Draw measures over one key, with a line for each combination of the other keys."""
    summary = run.summary
    others = [name for name in run.varied_keys if name != key]
    labels = [", ".join(as_written(row[name]) for name in others) for _, row in summary.iterrows()]
    if not others:
        labels = [run.scenario.arms.av] * len(summary)
    if len(set(labels)) > len(style.SERIES):
        return
    counted = f"n = {_range_of(summary['pairs'])} pairs per point"
    x = summary[key].astype(float).tolist()
    for measure, up, words in measures:
        if summary[measure].isna().all():
            continue
        figure, (axes,) = style.new_figure()
        level = (1.0, "as fast as the reference") if measure == "time_ratio" else None
        lines = draw.lines_of(summary, x, labels, measure)
        # Cells that differ only in the AV have the same reference arm.
        if measure == "pedestrian_delay_s" and others in ([], ["arms.av"]):
            one_av = np.array(labels) == labels[0]
            label = f"{run.scenario.arms.human} (reference)"
            rows, places = summary[one_av], summary[key][one_av].tolist()
            lines += draw.lines_of(rows, places, [label] * len(rows), "pedestrian_delay_human_s")
        draw.draw_over(axes, lines, axis_label(key), up, counted, level)
        yield Picture(
            f"sweep-{measure.removesuffix('_s').replace('_', '-')}",
            f"{words} over {axis_label(key)}",
            f"Over {key}: {words} with its {words_of_level(CONFIDENCE)} interval, one line for "
            f"each {' and '.join(others) if others else 'strategy'}; {counted}. Points are drawn a "
            "little apart so that their bars do not overlap.",
            figure,
        )


def _parameters(run: RunData) -> list[tuple[StrategyGroup, ParameterSweep]]:
    """Return the strategy parameters that the run sweeps; empty if there are too many to draw."""
    swept = [
        (group, parameter)
        for group in strategy_groups(run.study)
        for parameter in parameter_sweeps(group)
        # A key of perception or actuation is drawn for all strategies together.
        if len(parameter.values) >= _FEWEST_VALUES and not parameter.of_equipment
    ]
    return swept if len(swept) <= _MOST_SWEEPS else []


def _aggressiveness(
    run: RunData, group: StrategyGroup, parameter: ParameterSweep, number: int | None
) -> Picture:
    """Draw μ and κ over one parameter of a strategy."""
    bold = parameter.aggressiveness
    x = np.array(bold or parameter.values)
    label = f"aggressiveness: −{parameter.parameter}" if bold else axis_label(parameter.key)
    cells = [group.cells[position].cell.number for position in parameter.cells]
    rows = run.summary.set_index("cell").reindex(cells)
    counted = f"n = {_range_of(rows['pairs'].dropna())} pairs per point"
    figure, panels = style.new_figure(2, 1, height=6.4)
    for panel, (measure, up, _) in zip(panels, _MEASURES[1:3], strict=True):
        drivers = [parameter.strategy] * len(x)
        (line,) = draw.lines_of(rows, x.tolist(), drivers, f"{measure}_all")
        band = f"{words_of_level(CONFIDENCE)} interval"
        draw.draw_aggressiveness(panel, line, label, up, counted, band)
    where = "".join(f", {key} = {as_written(value)}" for key, value in group.shared.items())
    name = "aggressiveness" if number is None else f"aggressiveness-{number}"
    return Picture(
        name,
        f"μ and κ over {parameter.key}",
        f"Influence of {'the aggressiveness' if bold else parameter.parameter} of "
        f"{parameter.strategy}{where}; {counted}. In μ a human who crashed counts as if "
        "they had driven on; in κ time-outs and failures count as crashes.",
        figure,
    )


def _range_of(values: "pd.Series[int]") -> str:
    low, high = int(values.min()), int(values.max())
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"
