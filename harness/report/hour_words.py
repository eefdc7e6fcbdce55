"""Tables and sentences about hours of traffic, for the terminal and the page alike."""

from harness.encounter import Arm
from harness.report.sweep_tables import varied_headings
from harness.report.tables import (
    ARM_NAMES,
    Table,
    TableCell,
    counted,
    interval_cell,
    level,
    named_values,
    number,
    share_cell,
)
from harness.results.hour_summaries import GROWTH, HOUR_MEASURES, HoursSummary
from harness.runs.run_data import RunData
from harness.scenario import Cell, as_written

_DIGITS = 2

_NAMES = {
    "vehicle_delay_s": "vehicle delay, s",
    "control_delay_s": "vehicle delay to the road's end, s",
    "pedestrian_delay_s": "pedestrian delay, s",
    "person_delay_h": "delay of all persons, h",
    "throughput_per_hour": "vehicles through per hour",
    "queue_mean": "queue, mean",
    "queue_p95": "queue, 95 %",
    "queue_longest": "queue, longest",
    "stops_per_vehicle": "stops per vehicle",
    "first_let_go": "pedestrians the first vehicle let go, share",
    "crashes_per_1000": "crashes per 1,000 passages",
    "conflicts_ttc_per_1000": "conflicts per 1,000: TTC",
    "conflicts_time_advantage_per_1000": "conflicts per 1,000: time advantage",
    "conflicts_pet_per_1000": "conflicts per 1,000: PET",
    "conflicts_drac_per_1000": "conflicts per 1,000: DRAC",
}

_OVER_CELLS = (
    "crashes_per_1000",
    "vehicle_delay_s",
    "pedestrian_delay_s",
    "person_delay_h",
    "throughput_per_hour",
)
_ON_TERMINAL = 3
"""So many of ``_OVER_CELLS`` fit on the terminal."""


def hour_tables(run: RunData) -> list[Table]:
    """The results of one cell in full, or a table over cells."""
    if run.varied_keys:
        return [_over_cells(run)]
    return [_of_one_cell(summary) for _, summary in run.hour_results]


def hour_lines(run: RunData) -> list[str]:
    """What a reader has to know before any number: crashes and saturation first."""
    lines = [line for arm in Arm if (line := _crashes(run, arm))]
    for cell, summary in run.hour_results:
        which = f"{named_values(cell.varied)}: " if run.varied_keys else ""
        lines += [which + line for line in _warnings(cell, summary)]
    return lines


def _crashes(run: RunData, arm: Arm) -> str:
    crashed = [
        (kappa.value, cell, kappa)
        for cell, summary in run.hour_results
        if (kappa := summary.arms[arm].kappa).successes
    ]
    if not crashed:
        return ""
    most, cell, kappa = max(crashed, key=lambda found: found[0] or 0.0)
    if run.varied_keys:
        often = (
            f"in {len(crashed)} of {counted(len(run.hour_results), 'cell')}, at most "
            f"{1000 * (most or 0.0):.3g} per 1,000 passages ({named_values(cell.varied)})"
        )
    else:
        often = f"in {kappa.successes:,} of {counted(kappa.trials, 'passage')}"
    return (
        f"Crashes ({ARM_NAMES[arm]}) {often}: traffic goes on as if nobody had been hit, so no "
        "delay has what a crash costs."
    )


def _warnings(cell: Cell, summary: HoursSummary) -> list[str]:
    traffic = cell.scenario.known_traffic
    lines = []
    for arm, name in ARM_NAMES.items():
        own = summary.arms[arm]
        if own.saturated and own.growth is not None:
            lines.append(
                f"Saturated ({name}): the vehicles on the road grow by {100 * own.growth:.0f} % of "
                f"what arrives (limit {100 * GROWTH:.0f} %); its delays are those of "
                f"{traffic.duration_s:g} s and would grow with a longer hour."
            )
        if own.not_through:
            lines.append(
                f"{own.not_through} vehicles ({name}) never got through; they count with the time "
                "until the end, which is less than their delay."
            )
        if own.never_went:
            lines.append(f"{own.never_went} pedestrians ({name}) never got to go.")
    if traffic.saturated:
        lines.append("A permanent queue: vehicles through per hour are the capacity, no delays.")
    if summary.failed:
        lines.append(
            f"{summary.failed} of {counted(summary.pairs, 'pair')} failed and count nowhere."
        )
    return lines


def _of_one_cell(summary: HoursSummary) -> Table:
    rows: list[tuple[TableCell, ...]] = [
        (
            TableCell("travel time, AV / human"),
            interval_cell(summary.mu, _DIGITS),
            TableCell(""),
            TableCell(""),
        ),
        (
            TableCell("κ, crashes per passage"),
            share_cell(summary.arms[Arm.AV].kappa),
            share_cell(summary.arms[Arm.HUMAN].kappa),
            TableCell(""),
        ),
    ]
    rows += [
        (
            TableCell(_NAMES[measure.name]),
            *(interval_cell(found, _DIGITS) for found in summary.measures[measure.name]),
        )
        for measure in HOUR_MEASURES
    ]
    for name, attribute in (
        ("pedestrian delay by the HCM, s", "hcm_pedestrian_delay_s"),
        ("pedestrian delay by NCHRP 17-87, s", "nchrp_pedestrian_delay_s"),
    ):
        values = [getattr(summary.arms[arm], attribute) for arm in Arm]
        rows.append((TableCell(name), *(TableCell(number(v, 2)) for v in values), TableCell("")))
    for name, attribute in (
        ("level of service, vehicles", "los_vehicles"),
        ("level of service, pedestrians", "los_pedestrians"),
    ):
        values = [getattr(summary.arms[arm], attribute) or "undefined" for arm in Arm]
        rows.append((TableCell(name), *(TableCell(v) for v in values), TableCell("")))
    headings = ("mean over hours", "AV", "human", "AV − human")
    caption = f"Traffic, N = {counted(summary.pairs, 'pair')} of hours"
    caption += f", {level(summary.confidence)} intervals"
    return Table("traffic", caption, headings, tuple(rows))


def _over_cells(run: RunData) -> Table:
    rows = []
    for cell, summary in run.hour_results:
        values = [TableCell(as_written(cell.varied[key])) for key in run.varied_keys]
        for name in _OVER_CELLS:
            for found in summary.measures[name][:2]:
                values.append(interval_cell(found, _DIGITS))
        saturated = [ARM_NAMES[arm] for arm in Arm if summary.arms[arm].saturated]
        values.insert(len(run.varied_keys), TableCell(", ".join(saturated) or "no"))
        rows.append(tuple(values))
    names = [f"{_NAMES[name]}{end}" for name in _OVER_CELLS for end in (", AV", ", human")]
    headings = (*varied_headings(run), "saturated", *names)
    caption = (
        f"Traffic over the cells, {level(run.confidence)} intervals under the values; all measures "
        "and differences: summary.csv"
    )
    on_terminal = tuple(range(len(run.varied_keys) + 1 + 2 * _ON_TERMINAL))
    return Table("traffic", caption, headings, tuple(rows), sortable=True, terminal=on_terminal)
