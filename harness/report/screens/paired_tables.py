"""Tables of both arms by type, group of trips or crosswalk, with their paired differences."""

from collections.abc import Mapping
from typing import Any

from harness.report.screens.tables import Table, TableCell, count_cell, interval_cell, level
from harness.scenario import as_written
from harness.statistics import Interval
from harness.studies.runs.run_data import RunData

_NUMBERS = {
    "duration_s": "duration (s)",
    "time_loss_s": "time loss (s)",
    "waiting_s": "waiting (s)",
    "stops": "stops",
    "co2_g": "CO₂ (g)",
    "nox_mg": "NOₓ (mg)",
    "pmx_mg": "particles (mg)",
    "fuel_g": "fuel (g)",
    "electricity_wh": "electricity (Wh)",
    "vehicle_delay_s": "delay of vehicles (s)",
    "pedestrian_wait_s": "wait of people (s)",
    "queue_mean_m": "mean queue (m)",
    "queue_p95_m": "queue, 95 % (m)",
}
"""The shown numbers of ``group_means.csv`` and ``crosswalk_means.csv``, in words."""

_MOST_ROWS = 400
"""Maximum number of rows; the CSV table has all rows."""

_ARMS = ("AV", "reference", "AV − reference")


def paired_tables(run: RunData) -> list[Table]:
    """Return a table of each of ``types``, ``group_means`` and ``crosswalk_means`` of the run."""
    return [
        table
        for table in (
            _types(run),
            _means(run, "group_means", "group", "Means per trip"),
            _means(run, "crosswalk_means", "crosswalk", "Means at the crosswalks"),
        )
        if table.rows
    ]


def _types(run: RunData) -> Table:
    names = ("vehicle_delay_s", "vehicle_delay_s_human", "difference_s")
    rows = tuple(
        (
            *_labels(run, row),
            TableCell(row["type"]),
            *(count_cell(row[name]) for name in ("vehicles", "automated")),
            *(interval_cell(_interval(row, name), 2) for name in names),
            *(count_cell(row[name]) for name in ("not_through", "not_through_human")),
        )
        for row in run.statistics("types")
    )
    delays = tuple(f"delay, {arm}, s" for arm in _ARMS)
    counts = ("not through, AV", "not through, reference")
    headings = (*run.varied_keys, "type", "vehicles", "AVs", *delays, *counts)
    caption = f"Delay by type of vehicle, means over hours with {level(run.confidence)} intervals"
    return Table("types", caption, headings, rows, sortable=True)


def _means(run: RunData, name: str, key: str, caption: str) -> Table:
    rows = tuple(
        (
            *_labels(run, row),
            TableCell(row[key]),
            TableCell(_NUMBERS[row["number"]]),
            *(interval_cell(_interval(row, arm), 2) for arm in ("av", "human", "difference")),
            count_cell(row["pairs"]),
        )
        for row in run.statistics(name)
        if row["number"] in _NUMBERS and row["pairs"]
    )
    headings = (*run.varied_keys, key, "number", *_ARMS, "pairs")
    if len(rows) > _MOST_ROWS:
        caption += f" ({name}.csv has {len(rows) - _MOST_ROWS:,} more rows)"
    caption += f" over pairs, and paired differences, with {level(run.confidence)} intervals"
    return Table(
        name.replace("_", "-"), caption, headings, rows[:_MOST_ROWS], sortable=True, folded=True
    )


def _labels(run: RunData, row: Mapping[str, Any]) -> list[TableCell]:
    varied = run.study.cells[row["cell"]].varied
    return [TableCell(as_written(varied[key])) for key in run.varied_keys]


def _interval(row: Mapping[str, Any], name: str) -> Interval:
    return Interval(row[name], row[f"{name}_ci_low"], row[f"{name}_ci_high"])
