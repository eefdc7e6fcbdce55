"""The tables over the cells of a sweep, for the terminal and the page alike."""

from collections import defaultdict
from collections.abc import Sequence

from harness.report.caveats import av_label
from harness.report.tables import (
    Table,
    TableCell,
    count_cell,
    interval_cell,
    level,
    share_cell,
    sort_key,
    value_cell,
)
from harness.report.words import (
    both_arms,
    both_shares,
    conflict_name,
    has_worst_case,
    unreliable_keys,
)
from harness.runs.run_data import CellResult, RunData

MOST_ROWS = 2_000
"""Cells of a sweep in a table; the others are in the run folder's files."""

_COUNTS = {
    "pairs with τ": "defined_pairs",
    "met someone": "met_someone",
    "met nobody": "met_nobody",
    "AV timed out": "timed_out_av",
    "human timed out": "timed_out_human",
    "strategy failed": "failed_strategy",
    "engine failed": "failed_engine",
    "fallbacks": "fallbacks",
}
"""Headings of the counts, and their names in a summary."""


def sweep_tables(run: RunData) -> list[Table]:
    """Measures and counts of every cell, and its avoidable crashes and conflicts."""
    shown = run.results[:MOST_ROWS]
    return [_over_cells(run, shown), _safety_over_cells(run, shown)]


def _over_cells(run: RunData, shown: Sequence[CellResult]) -> Table:
    """μ, c_v, κ, delays and counts of every cell."""
    worst = any(has_worst_case(of.summary) for of in shown)
    fell = "arms.av" not in run.varied_keys and any(
        _label(of) != of.cell.scenario.arms.av for of in shown
    )
    rows, few = [], False
    for result in shown:
        summary = result.summary
        star = defaultdict(str, dict.fromkeys(unreliable_keys(summary), " *"))
        few = few or bool(star)
        rows.append(
            (
                *_varied(run, result),
                *([TableCell(_label(result))] if fell else []),
                count_cell(summary.pairs),
                interval_cell(summary.time_ratio, 3, star["time_ratio"]),
                interval_cell(summary.mu, 3, star["mu"]),
                share_cell(summary.kappa),
                share_cell(summary.kappa_human),
                interval_cell(summary.delay_s, 2, star["delay_s"]),
                interval_cell(summary.delay_human_s, 2, star["delay_human_s"]),
                *(
                    [
                        interval_cell(summary.time_ratio_worst, 3, star["time_ratio_worst"]),
                        share_cell(summary.kappa_worst),
                    ]
                    if worst
                    else []
                ),
                count_cell(summary.pairs - summary.time_ratio_pairs),
                interval_cell(summary.mu_worst, 3, star["mu_worst"]),
                interval_cell(summary.delay_worst_s, 2, star["delay_worst_s"]),
                share_cell(summary.kappa_all),
                interval_cell(summary.mu_all, 3, star["mu_all"]),
                interval_cell(summary.mu_met_someone, 3, star["mu_met_someone"]),
                share_cell(summary.cv, star["cv"]),
                interval_cell(
                    summary.delay_difference_human_s, 2, star["delay_difference_human_s"]
                ),
                interval_cell(summary.pedestrian_delay_s, 2, star["pedestrian_delay_s"]),
                interval_cell(
                    summary.pedestrian_delay_human_s, 2, star["pedestrian_delay_human_s"]
                ),
                *(count_cell(getattr(summary, name)) for name in _COUNTS.values()),
            )
        )
    front = (
        *varied_headings(run),
        *(["AV drove"] if fell else []),
        "pairs",
        "ratio of times",
        "μ",
        "κ AV",
        "κ human",
        "delay AV (s)",
        "delay human (s)",
        *(["ratio of times, worst case", "κ, worst case"] if worst else []),
    )
    headings = (
        *front,
        "left out of the ratio",
        "μ, worst case",
        "delay AV, worst case (s)",
        "κ with time-outs",
        "μ, human as if untouched",
        "μ, met someone",
        "c_v",
        "delay AV − human (s)",
        "pedestrians' delay, AV's arm (s)",
        "pedestrians' delay, human's arm (s)",
        *_COUNTS,
    )
    caption = f"{_cells(run, shown)}, {level(run.confidence)} intervals under the values."
    if few:
        caption += " * unreliable: too few informative pairs."
    shown_on_terminal = tuple(range(len(front)))
    return Table("cells", caption, headings, tuple(rows), sortable=True, terminal=shown_on_terminal)


def _label(result: CellResult) -> str:
    return av_label(result.cell.scenario.arms.av, result.summary)


def _safety_over_cells(run: RunData, shown: Sequence[CellResult]) -> Table:
    """Avoidable crashes and conflict rates of both arms in every cell."""
    rows = []
    for result in shown:
        summary = result.summary
        both = [(summary.kappa_avoidable, summary.kappa_avoidable_human)]
        both += [(av.rate, human.rate) for av, human in both_arms(result.conflicts)]
        shares = [TableCell(*both_shares(*of), sort_key(of[0].value)) for of in both]
        rows.append((*_varied(run, result), *shares))
    kinds = ["avoidable crash"]
    if shown:
        kinds += [f"{conflict_name(av)} conflict" for av, _ in both_arms(shown[0].conflicts)]
    caption = f"{_cells(run, shown)}, AV / human: share of episodes, crashes count as conflicts."
    headings = (*varied_headings(run), *kinds)
    return Table("conflicts", caption, headings, tuple(rows), sortable=True, brief=True)


def _cells(run: RunData, shown: Sequence[CellResult]) -> str:
    total = len(run.results)
    first = f", the first {len(shown):,} here" if len(shown) < total else ""
    return f"{total:,} cells{first}"


def varied_headings(run: RunData) -> list[str]:
    """The varied keys' last words; the whole keys where those are not different."""
    words = [key.split(".")[-1] for key in run.varied_keys]
    return words if len(set(words)) == len(words) else run.varied_keys


def _varied(run: RunData, result: CellResult) -> list[TableCell]:
    """The varied keys' values; the AV's strategy with what drove in its place."""
    varied = {**result.cell.varied}
    if "arms.av" in varied:
        varied["arms.av"] = _label(result)
    return [value_cell(varied[key]) for key in run.varied_keys]
