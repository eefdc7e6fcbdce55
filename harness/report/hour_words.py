"""Tables and sentences about hours of traffic, for the terminal and the page alike."""

from collections.abc import Callable

from harness.encounter import Arm
from harness.report.tables import (
    Table,
    TableCell,
    counted,
    interval_cell,
    level,
    named_values,
    number,
    share_cell,
)
from harness.results.hour_summaries import HoursSummary
from harness.runs.notes import MOSTLY
from harness.runs.run_data import RunData
from harness.scenario import Cell, Scenario, as_written
from harness.strategies.registry import fallback_of
from harness.traffic.saturation import GROWTH

_DIGITS = 2

_NAMES = {
    "vehicle_delay_s": "vehicle delay, s",
    "automated_delay_s": "vehicle delay of AVs (reference: of the same vehicles), s",
    "other_delay_s": "vehicle delay of the others, s",
    "control_delay_s": "vehicle delay to the road's end, s",
    "pedestrian_delay_s": "pedestrian delay, s",
    "person_delay_h": "delay of all persons, h",
    "throughput_per_hour": "vehicles through per hour",
    "queue_mean": "queue, mean",
    "queue_p95": "queue, 95 %",
    "queue_longest": "queue, longest",
    "stops_per_vehicle": "stops per vehicle",
    "first_driver_yield_share": "pedestrians the first vehicle let go, share",
    "crashes_per_1000": "crashes per 1,000 that reached it",
    "conflicts_ttc_per_1000": "conflicts per 1,000: TTC",
    "conflicts_time_advantage_per_1000": "conflicts per 1,000: time advantage",
    "conflicts_pet_per_1000": "conflicts per 1,000: PET",
    "conflicts_drac_per_1000": "conflicts per 1,000: DRAC",
}

_ARMS = {Arm.AV: "AV's arm", Arm.HUMAN: "reference"}

_OVER_CELLS = (
    "crashes_per_1000",
    "vehicle_delay_s",
    "pedestrian_delay_s",
    "person_delay_h",
    "throughput_per_hour",
)
_ON_TERMINAL = 3
"""So many of ``_OVER_CELLS`` fit on the terminal."""

_OF_MIXED = ("automated_delay_s", "other_delay_s")
"""Measures that are shown where the AV's arm has both kinds of vehicles."""


def hour_tables(run: RunData) -> list[Table]:
    """The results of one cell in full, or a table over cells."""
    if run.varied_keys:
        return [_over_cells(run)]
    return [_of_one_cell(cell, summary) for cell, summary in run.hour_results]


def hour_lines(run: RunData) -> list[str]:
    """What a reader has to know before any number: who came, crashes, saturation."""
    lines = [_who_came(run), *(line for arm in Arm if (line := _crashes(run, arm)))]
    for cell, summary in run.hour_results:
        which = f"{named_values(cell.varied)}: " if run.varied_keys else ""
        lines += [which + line for line in _warnings(cell, summary)]
    return lines


def _who_came(run: RunData) -> str:
    """Share, strategies, flows and λ; a key that differs between cells is varied."""
    scenarios = [cell.scenario for cell, _ in run.hour_results]

    def common(value: Callable[[Scenario], str]) -> str:
        values = {value(scenario) for scenario in scenarios}
        return values.pop() if len(values) == 1 else "a varied number of"

    av, human = ({getattr(s.arms, arm.value) for s in scenarios} for arm in Arm)
    flows = (
        common(lambda s: as_written(s.known_traffic.flow_per_hour)),
        common(lambda s: as_written(s.known_traffic.oncoming_per_hour)),
    )
    share = common(lambda s: f"{100 * s.known_traffic.av_share:.4g} % of the")
    came = f"{flows[0]} + {flows[1]}" if not scenarios[0].known_traffic.saturated else "queued"
    return (
        f"In the AV's arm {share} vehicles are driven by {' or '.join(sorted(av))}, all others and "
        f"all of the reference by {' or '.join(sorted(human))}; {came} vehicles and "
        f"{common(lambda s: as_written(s.pedestrians.flow_per_hour))} pedestrians per hour."
    )


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
            f"{1000 * (most or 0.0):.3g} per 1,000 vehicles that reached the crosswalk "
            f"({named_values(cell.varied)})"
        )
    else:
        often = (
            f"in {kappa.successes:,} of {counted(kappa.trials, 'vehicle')} that reached the "
            "crosswalk"
        )
    return (
        f"Crashes ({_ARMS[arm]}) {often}: traffic goes on as if nobody had been hit, so no "
        "delay has what a crash costs."
    )


def _warnings(cell: Cell, summary: HoursSummary) -> list[str]:
    traffic = cell.scenario.known_traffic
    lines = []
    for arm, name in _ARMS.items():
        lines += _of_arm(cell, summary, arm, name)
    if traffic.saturated:
        lines.append("A permanent queue: vehicles through per hour are the capacity, no delays.")
    if summary.failed:
        lines.append(
            f"{summary.failed} of {counted(summary.pairs, 'pair')} failed and count nowhere."
        )
    return lines


def _of_arm(cell: Cell, summary: HoursSummary, arm: Arm, name: str) -> list[str]:
    own, strategy, lines = summary.arms[arm], getattr(cell.scenario.arms, arm.value), []
    if own.growth.saturated:
        lines.append(
            f"Saturated ({name}): late vehicles grow by {100 * (own.growth.share or 0.0):.0f} % of "
            f"what arrives (limit {100 * GROWTH:.0f} %, by chance up to "
            f"{100 * (own.growth.bound or 0.0):.0f} %); its delays are those of "
            f"{cell.scenario.known_traffic.duration_s:g} s and would grow with a longer hour."
        )
    elif own.still_rises:
        lines.append(
            f"The delay still grows ({name}): vehicles due in the last third of the hour lose "
            f"{own.rising_s.words('.1f')} s more than those of the first, so its mean is one over "
            "the way up: --settle finds a warm-up, and more hours tell where it ends."
        )
    if own.not_through:
        lines.append(
            f"{own.not_through} vehicles ({name}) never got through; they count with the time "
            "until the end, which is less than their delay."
        )
    if own.never_went:
        lines.append(f"{own.never_went} pedestrians ({name}) never got to go.")
    share = own.fallback.value or 0.0
    if share >= MOSTLY:
        lines.append(
            f"{name}: {fallback_of(strategy)} drove {100 * share:.0f} % of the passages that met "
            f"someone, for which {strategy} has no answer."
        )
    return lines


def _of_one_cell(cell: Cell, summary: HoursSummary) -> Table:
    nothing, arms = TableCell(""), [summary.arms[arm] for arm in Arm]
    rows: list[tuple[TableCell, ...]] = [
        (
            TableCell("travel times, AV's arm / reference"),
            interval_cell(summary.time_ratio, _DIGITS),
            nothing,
            nothing,
        ),
        (
            TableCell("κ, crashes per vehicle that reached the crosswalk"),
            *(share_cell(arm.kappa) for arm in arms),
            nothing,
        ),
        (
            TableCell("vehicles that did not (with a conflict all the same)"),
            *(TableCell(f"{arm.unreached:,} ({arm.conflicts_unreached:,})") for arm in arms),
            nothing,
        ),
    ]
    if any(arm.fallback.successes for arm in arms):
        shares = (share_cell(arm.fallback) for arm in arms)
        rows.append((TableCell("passages driven by the strategy's fallback"), *shares, nothing))
    mixed = 0 < cell.scenario.known_traffic.av_share < 1
    rows += [
        (
            TableCell(heading),
            *(interval_cell(found, _DIGITS) for found in summary.measures[name]),
        )
        for name, heading in _NAMES.items()
        if mixed or name not in _OF_MIXED
    ]
    for name, key in (("by the HCM, s", "hcm_s"), ("by NCHRP 17-87, s", "nchrp_s")):
        values = [
            f"none: {arm.handbook.reason}"
            if arm.handbook.reason
            else number(getattr(arm.handbook, key), 2)
            for arm in arms
        ]
        rows.append((TableCell(f"pedestrian delay {name}"), *map(TableCell, values), nothing))
    for name in ("vehicles", "pedestrians"):
        values = [getattr(arm, f"los_{name}") or "undefined" for arm in arms]
        rows.append((TableCell(f"level of service, {name}"), *map(TableCell, values), nothing))
    headings = ("mean over hours", *_ARMS.values(), "difference")
    caption = f"Traffic, N = {counted(summary.pairs, 'pair')} of hours"
    caption += f", {level(summary.confidence)} intervals"
    return Table("traffic", caption, headings, tuple(rows))


def _over_cells(run: RunData) -> Table:
    shares = [cell.scenario.known_traffic.av_share for cell, _ in run.hour_results]
    mixed = _OF_MIXED if any(0 < share < 1 for share in shares) else ()
    rows = []
    for cell, summary in run.hour_results:
        values = [TableCell(as_written(cell.varied[key])) for key in run.varied_keys]
        saturated = [name for arm, name in _ARMS.items() if summary.arms[arm].saturated]
        values.append(TableCell(", ".join(saturated) or "no"))
        shown = [found for name in _OVER_CELLS for found in summary.measures[name][:2]]
        shown += [summary.measures[name][0] for name in mixed]
        rows.append((*values, *(interval_cell(found, _DIGITS) for found in shown)))
    names = [f"{_NAMES[name]}, {arm}" for name in _OVER_CELLS for arm in _ARMS.values()]
    names += [f"{_NAMES[name]}, {_ARMS[Arm.AV]}" for name in mixed]
    headings = (*(key.split(".")[-1] for key in run.varied_keys), "saturated", *names)
    caption = (
        f"Traffic over the cells, {level(run.confidence)} intervals under the values; all measures "
        "and differences: summary.csv"
    )
    on_terminal = tuple(range(len(run.varied_keys) + 1 + 2 * _ON_TERMINAL))
    return Table("traffic", caption, headings, tuple(rows), sortable=True, terminal=on_terminal)
