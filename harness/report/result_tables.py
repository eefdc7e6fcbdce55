"""The tables of a run's results, for the terminal and the page alike."""

import re
from collections.abc import Sequence
from typing import Any

from harness.comparison import Interval, Summary
from harness.measures import MEASURES
from harness.report.caveats import av_label
from harness.report.sweep_tables import sweep_tables
from harness.report.tables import (
    Table,
    TableCell,
    counted,
    level,
    limits,
    number,
    percentage,
    share_cell,
    share_limits,
    sort_key,
)
from harness.report.words import (
    PAPER,
    both_arms,
    both_shares,
    conflict_condition,
    has_worst_case,
    is_the_papers,
    left_out,
    unreliable_words,
)
from harness.results.measure_tables import ConflictRate
from harness.runs.run_data import RunData

Row = tuple[str, str, str, str, str]
"""Measure, value, interval, key of the paper's value, remark."""


def result_tables(run: RunData) -> list[Table]:
    """The results of one cell in full, or the tables over cells."""
    return sweep_tables(run) if run.varied_keys else [_of_one_cell(run)]


def _of_one_cell(run: RunData) -> Table:
    (result,) = run.results
    arms, summary = result.cell.scenario.arms, result.summary
    paper = is_the_papers(result.cell.scenario)
    rows = []
    for name, value, interval, key, remark in (
        *measure_rows(summary),
        *conflict_rows(result.conflicts),
    ):
        reference = [TableCell(PAPER.get(key, ""))] if paper else []
        rows.append(
            (TableCell(name), TableCell(value), TableCell(interval), *reference, TableCell(remark))
        )
    headings = (
        "measure",
        "value",
        f"{level(summary.confidence)} interval",
        *(["paper, N = 50"] if paper else []),
        "remark",
    )
    caption = f"{av_label(arms.av, summary)} against {arms.human}, {counted(summary.pairs, 'pair')}"
    return Table("measures", caption, headings, tuple(rows))


def measure_rows(summary: Summary) -> list[Row]:
    """The measures of a cell, the paper's three and what they have to be read with."""
    some_missing = has_worst_case(summary)
    rows = [
        _row(
            "ratio of times, Σ AV / Σ human (below 1: AV takes less)",
            summary,
            "time_ratio",
            remark=left_out(summary),
        ),
        _row("μ: mean of AV time / human time, pair by pair", summary, "mu", paper="mu"),
        _row("μ with the human's crashes as if untouched", summary, "mu_all"),
        _row("μ of the pairs that met someone", summary, "mu_met_someone"),
    ]
    if summary.fallbacks:
        words = "pairs chosen by what the AV did"
        rows.append(("μ without fallbacks", number(summary.mu_without_fallback, 4), "", "", words))
    if some_missing:
        words = "AV's crashes, failures, time-outs at the time-out"
        rows.append(_row("ratio of times, worst case", summary, "time_ratio_worst", remark=words))
        rows.append(_row("μ, worst case", summary, "mu_worst", remark=words))
    rows += [
        _row("c_v: spread of τ", summary, "cv", share=True, paper="cv"),
        _row("κ: crash rate, AV", summary, "kappa", share=True, paper="kappa"),
        _row("κ, hit by the car's front", summary, "kappa_front", share=True),
        _row("κ of the pairs that met someone", summary, "kappa_met_someone", share=True),
    ]
    if some_missing:
        words = "and failures of the strategy, as crashes"
        rows.append(_row("κ with time-outs", summary, "kappa_all", share=True, remark=words))
        words = "AV's failures and time-outs count as crashes"
        rows.append(_row("κ, worst case", summary, "kappa_worst", share=True, remark=words))
    avoidable = both_shares(summary.kappa_avoidable, summary.kappa_avoidable_human)
    stops = f"{number(summary.stops, 2)} / {number(summary.stops_human, 2)}"
    stopped = f"{number(summary.stopped_s, 2)} / {number(summary.stopped_human_s, 2)}"
    return [
        *rows,
        ("κ avoidable, AV / human", *avoidable, "", "by full braking at once"),
        _row("κ: crash rate, human", summary, "kappa_human", share=True),
        _row("delay AV, s", summary, "delay_s"),
        _row("delay human, s", summary, "delay_human_s"),
        *([_row("delay AV, s, worst case", summary, "delay_worst_s")] if some_missing else []),
        _row("delay AV − human, s, same pairs", summary, "delay_difference_human_s"),
        _row("delay AV, s, met someone", summary, "delay_met_someone_s"),
        _row("delay human, s, met someone", summary, "delay_human_met_someone_s"),
        _row("delay of pedestrians, AV's arm, s", summary, "pedestrian_delay_s"),
        _row("delay of pedestrians, human's arm, s", summary, "pedestrian_delay_human_s"),
        ("stops, AV / human", stops, "", "", "per episode"),
        ("stopped s, AV / human", stopped, "", "", "per episode"),
    ]


def _row(
    name: str, summary: Summary, key: str, share: bool = False, paper: str = "", remark: str = ""
) -> Row:
    interval: Interval = getattr(summary, key)
    if few := unreliable_words(summary, key):
        remark = f"{few}; {remark}".removesuffix("; ")
    if share:
        within = share_limits(interval, 2) or "undefined"
        return name, percentage(interval.value), within, paper, remark
    digits = 4 if key.startswith(("mu", "time_ratio")) else 2
    within = limits(interval, digits) or "undefined"
    return name, number(interval.value, digits), within, paper, remark


def _share_met(rate: ConflictRate) -> str:
    return percentage(rate.rate_met_someone.value)


def conflict_rows(rates: Sequence[ConflictRate]) -> list[Row]:
    """A row for each kind of conflict."""
    return [
        (
            f"{conflict_condition(av)}, AV / human",
            *both_shares(av.rate, human.rate),
            "",
            f"conflict rate; {_share_met(av)} / {_share_met(human)} where somebody was met",
        )
        for av, human in both_arms(rates)
    ]


def statistics_table(run: RunData) -> Table:
    """Mean and quantiles of every measure, both arms."""
    of = {(row["arm"], row["measure"]): row for _, row in run.measures.iterrows()}
    rows = []
    for measure in MEASURES:
        unit = f" ({measure.unit})" if measure.unit else ""
        cells = [TableCell(f"{_spoken(measure.column)}{unit}", measure.formula)]
        for arm in ("av", "human"):
            row = of[arm, measure.column]
            low, middle, high = (_three(row[name]) for name in ("p05", "p50", "p95"))
            quantiles = f"{low} / {middle} / {high}" if row["defined"] else ""
            cells += [
                TableCell(f"{row['defined']:,}", sort=str(row["defined"])),
                TableCell(_three(row["mean"]), quantiles, sort_key(row["mean"])),
            ]
        rows.append(tuple(cells))
    headings = ("measure", "n, AV", "mean, AV", "n, human", "mean, human")
    caption = "Every measure over the episodes in which it is defined: mean, and 5 % / 50 % / 95 %"
    return Table("statistics", caption, headings, tuple(rows), folded=True)


def _three(value: float | None) -> str:
    # Differences of times end in the last bits of their sums.
    return "undefined" if value is None or value != value else f"{round(value, 9) + 0.0:.3g}"


def _spoken(column: str) -> str:
    """A column's name without its unit."""
    words = re.sub(r"_(s|m|mps|mps2|mps3)$", "", column).split("_")
    return " ".join(word.upper() if word in ("ttc", "pet", "drac") else word for word in words)


def tiles(summary: Summary, human: str) -> list[dict[str, Any]]:
    """The few numbers a reader looks for first; ``human`` is the reference's strategy."""
    notes = {
        key: [words] if (words := unreliable_words(summary, key)) else []
        for key in ("time_ratio", "mu", "cv")
    }
    kappa, reference, of = summary.kappa, summary.kappa_human, level(summary.confidence)
    worst = f"{percentage(summary.kappa_worst.value)} with its failures and time-outs"
    return [
        {
            "name": "pairs",
            "value": f"{summary.pairs:,}",
            "lines": [
                f"τ defined in {summary.defined_pairs:,}",
                f"{summary.met_someone:,} met someone",
            ],
        },
        {
            "name": "ratio of times, Σ AV / Σ human (below 1: AV takes less)",
            "value": number(summary.time_ratio.value, 4),
            "lines": [
                _within(limits(summary.time_ratio, 4), of),
                left_out(summary),
                *notes["time_ratio"],
            ],
        },
        {
            "name": "μ, mean of AV time / human time",
            "value": number(summary.mu.value, 4),
            "lines": [_within(limits(summary.mu, 4), of), *notes["mu"]],
        },
        {
            "name": "c_v, spread of τ",
            "value": share_cell(summary.cv).text,
            "lines": [_within(share_limits(summary.cv), of), *notes["cv"]],
        },
        {
            "name": "κ, crash rate of the AV",
            "value": share_cell(kappa).text,
            "lines": [
                _within(share_limits(kappa), of),
                f"{kappa.successes:,} of {counted(kappa.trials, 'episode')}",
                *([worst] if summary.failed_av or summary.timed_out_av else []),
            ],
        },
        {
            "name": f"κ of {human}, the reference",
            "value": share_cell(reference).text,
            "lines": [
                _within(share_limits(reference), of),
                f"{reference.successes:,} of {counted(reference.trials, 'episode')}",
            ],
        },
    ]


def _within(interval: str, of: str) -> str:
    return f"{of}: {interval}" if interval else "no interval"
