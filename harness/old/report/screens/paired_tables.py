"""The table of both arms by crosswalk, with their paired differences."""

from harness.old.report.screens.tables import Table, TableCell, count_cell, interval_cell, level
from harness.old.statistics import CONFIDENCE, Interval
from harness.old.studies.runs.run_data import RunData
from harness.scenario import as_written

_NUMBERS = {
    "vehicle_delay_s": "delay of vehicles (s)",
    "pedestrian_wait_s": "wait of people (s)",
    "queue_mean_m": "mean queue (m)",
    "queue_p95_m": "queue, 95 % (m)",
}
"""The shown numbers of ``crosswalk_means.csv``, in words."""

_MOST_ROWS = 400
"""Maximum number of rows; the CSV table has all rows."""

_ARMS = {"av": "AV", "human": "reference", "difference": "AV − reference"}


def paired_tables(run: RunData) -> list[Table]:
    """Return the table of ``crosswalk_means``; none if the run has no such rows."""
    rows = [
        (
            *(
                TableCell(as_written(run.study.cells[row["cell"]].varied[k]))
                for k in run.varied_keys
            ),
            TableCell(row["crosswalk"]),
            TableCell(_NUMBERS[row["number"]]),
            *(
                interval_cell(Interval(row[arm], row[f"{arm}_ci_low"], row[f"{arm}_ci_high"]), 2)
                for arm in _ARMS
            ),
            count_cell(row["pairs"]),
        )
        for row in run.statistics("crosswalk_means")
        if row["number"] in _NUMBERS and row["pairs"]
    ]
    if not rows:
        return []
    headings = (*run.varied_keys, "crosswalk", "number", *_ARMS.values(), "pairs")
    caption = "Means at the crosswalks"
    if len(rows) > _MOST_ROWS:
        caption += f" (crosswalk_means.csv has {len(rows) - _MOST_ROWS:,} more rows)"
    caption += f" over pairs, and paired differences, with {level(CONFIDENCE)} intervals"
    shown = tuple(rows[:_MOST_ROWS])
    return [Table("crosswalk-means", caption, headings, shown, sortable=True, folded=True)]
