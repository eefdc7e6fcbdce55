"""The tables of a report's page, as rows of cells: what is shown, and what it is sorted by."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from harness.comparison import INDICATIVE_BELOW, Interval, Proportion, Summary
from harness.measures import MEASURES
from harness.report.console import number, plain
from harness.report.words import (
    PAPER,
    both_arms,
    conflict_name,
    conflict_rows,
    indicative,
    is_the_papers,
    measure_rows,
    per_cent,
)
from harness.review.run_data import CellResult, RunData

MOST_ROWS = 2_000
"""Cells of a sweep in a table; the others are in the run folder's files."""


@dataclass(frozen=True)
class Cell:
    """One cell: text, small text under it, and for numbers what to sort by (empty: undefined)."""

    text: str
    small: str = ""
    sort: str | None = None

    @property
    def number(self) -> bool:
        """Whether it is one."""
        return self.sort is not None


@dataclass(frozen=True)
class Table:
    """A table with its identifier on the page."""

    name: str
    caption: str
    headings: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    sortable: bool = False
    folded: bool = False
    """Shown on request."""


def result_tables(run: RunData) -> list[Table]:
    """The results of one cell in full, or the tables over cells."""
    if run.varied_keys:
        shown = run.results[:MOST_ROWS]
        return [_over_cells(run, shown), _safety_over_cells(run, shown)]
    return [_of_one_cell(run), _statistics(run)]


def _of_one_cell(run: RunData) -> Table:
    (result,) = run.results
    paper = is_the_papers(result.cell.scenario)
    rows = []
    for name, value, interval, key, remark in (
        *measure_rows(result.summary),
        *conflict_rows(result.conflicts),
    ):
        reference = [Cell(PAPER.get(key, ""))] if paper else []
        rows.append((Cell(name), Cell(value), Cell(interval), *reference, Cell(remark)))
    headings = (
        "measure",
        "value",
        "95 % interval",
        *(["paper, N = 50"] if paper else []),
        "remark",
    )
    return Table("measures", f"Measures, N = {result.summary.pairs:,} pairs", headings, tuple(rows))


def _statistics(run: RunData) -> Table:
    """Mean and quantiles of every measure, both arms."""
    of = {(row["arm"], row["measure"]): row for _, row in run.measures.iterrows()}
    rows = []
    for measure in MEASURES:
        unit = f" ({measure.unit})" if measure.unit else ""
        cells = [Cell(f"{_spoken(measure.column)}{unit}", measure.formula)]
        for arm in ("av", "human"):
            row = of[arm, measure.column]
            low, middle, high = (_three(row[name]) for name in ("p05", "p50", "p95"))
            quantiles = f"{low} / {middle} / {high}" if row["defined"] else ""
            cells += [
                Cell(f"{row['defined']:,}", sort=str(row["defined"])),
                Cell(_three(row["mean"]), quantiles, _sort(row["mean"])),
            ]
        rows.append(tuple(cells))
    headings = ("measure", "n, AV", "mean, AV", "n, human", "mean, human")
    caption = "Every measure over the episodes in which it is defined: mean, and 5 % / 50 % / 95 %"
    return Table("statistics", caption, headings, tuple(rows), folded=True)


def _spoken(column: str) -> str:
    """A column's name without its unit."""
    words = re.sub(r"_(s|m|mps|mps2|mps3)$", "", column).split("_")
    return " ".join(word.upper() if word in _ACRONYMS else word for word in words)


_ACRONYMS = ("ttc", "pet", "drac")


def _over_cells(run: RunData, shown: Sequence[CellResult]) -> Table:
    """μ, c_v, κ, delays and counts of every cell."""
    rows = []
    for result in shown:
        summary = result.summary
        star = {key: " *" if indicative(summary.defined_pairs, key) else "" for key in _STARRED}
        rows.append(
            (
                *_varied(run, result),
                _count(summary.pairs),
                _interval(summary.mu, 3, star["mu"]),
                _share(summary.cv, star["cv"]),
                _share(summary.kappa),
                _share(summary.kappa_human),
                _interval(summary.delay_s, 2, star["delay_s"]),
                _interval(summary.delay_human_s, 2, star["delay_human_s"]),
                *(_count(getattr(summary, name)) for name in _COUNTS.values()),
            )
        )
    headings = (
        *_headings(run),
        "N",
        "μ",
        "c_v",
        "κ AV",
        "κ human",
        "delay AV (s)",
        "delay human (s)",
        *_COUNTS,
    )
    caption = f"{_cells(run, shown)}, 95 % intervals under the values."
    if any(indicative(of.summary.defined_pairs, key) for of in shown for key in _STARRED):
        caption += " * indicative: N too small."
    return Table("cells", caption, headings, tuple(rows), sortable=True)


_STARRED = tuple(INDICATIVE_BELOW)

_COUNTS = {
    "defined": "defined_pairs",
    "timed out": "timed_out",
    "fallbacks": "fallbacks",
    "met nobody": "met_nobody",
    "failed": "failed",
}


def _safety_over_cells(run: RunData, shown: Sequence[CellResult]) -> Table:
    """Avoidable crashes and conflict rates of both arms in every cell."""
    rows = []
    for result in shown:
        summary = result.summary
        both = [(summary.kappa_avoidable, summary.kappa_avoidable_human)]
        both += [(av.rate, human.rate) for av, human in both_arms(result.conflicts)]
        rows.append((*_varied(run, result), *(_share(of) for pair in both for of in pair)))
    kinds = ["avoidable crash"]
    if shown:
        kinds += [f"{conflict_name(av)} conflict" for av, _ in both_arms(shown[0].conflicts)]
    headings = (*_headings(run), *(f"{kind}, {arm}" for kind in kinds for arm in ("AV", "human")))
    caption = f"{_cells(run, shown)}: share of episodes with a conflict, crashes included."
    return Table("conflicts", caption, headings, tuple(rows), sortable=True)


def _cells(run: RunData, shown: Sequence[CellResult]) -> str:
    total = len(run.results)
    first = f", the first {len(shown):,} here" if len(shown) < total else ""
    return f"{total:,} cells{first}"


def _headings(run: RunData) -> list[str]:
    """The varied keys' last words; the whole keys where those are not different."""
    words = [key.split(".")[-1] for key in run.varied_keys]
    return words if len(set(words)) == len(words) else run.varied_keys


def _varied(run: RunData, result: CellResult) -> list[Cell]:
    values = (result.cell.varied[key] for key in run.varied_keys)
    return [Cell(plain(value), sort=_key_sort(value)) for value in values]


def _key_sort(value: Any) -> str | None:
    numeric = isinstance(value, int | float) and not isinstance(value, bool)
    return repr(value) if numeric else None


def _count(value: int) -> Cell:
    return Cell(f"{value:,}", sort=str(value))


def _interval(interval: Interval, digits: int, star: str = "") -> Cell:
    limits = ""
    if interval.low is not None and interval.high is not None:
        limits = f"{interval.low:z.{digits}f} … {interval.high:z.{digits}f}{star}"
    return Cell(number(interval.value, digits), limits, _sort(interval.value))


def _share(share: Interval | Proportion, star: str = "") -> Cell:
    if share.value is None:
        return Cell("undefined", sort="")
    limits = ""
    if share.low is not None and share.high is not None:
        limits = f"{per_cent(share.low, 1)} … {per_cent(share.high, 1)} %{star}"
    return Cell(f"{per_cent(share.value, 1)} %", limits, _sort(share.value))


def _sort(value: float | None) -> str:
    return "" if value is None or value != value else repr(float(value))


def _three(value: float | None) -> str:
    # Differences of times end in the last bits of their sums.
    return "undefined" if value is None or value != value else f"{round(value, 9) + 0.0:.3g}"


def tiles(summary: Summary) -> list[dict[str, Any]]:
    """The few numbers a reader looks for first, with their intervals in words."""
    n = summary.defined_pairs
    notes = {key: [words] if (words := indicative(n, key)) else [] for key in ("mu", "cv")}
    kappa, human = summary.kappa, summary.kappa_human
    return [
        {
            "name": "N, pairs",
            "value": f"{summary.pairs:,}",
            "lines": [f"τ defined in {summary.defined_pairs:,}"],
        },
        {
            "name": "μ, mean of τ",
            "value": number(summary.mu.value, 4),
            "lines": [_limits(summary.mu, 4), *notes["mu"]],
        },
        {
            "name": "c_v, spread of τ",
            "value": _share(summary.cv).text,
            "lines": [_share(summary.cv).small, *notes["cv"]],
        },
        {
            "name": "κ, crash rate of the AV",
            "value": _share(kappa).text,
            "lines": [_share(kappa).small, f"{kappa.successes:,} of {kappa.trials:,} episodes"],
        },
        {
            "name": "κ of the human driver",
            "value": _share(human).text,
            "lines": [_share(human).small, f"{human.successes:,} of {human.trials:,} episodes"],
        },
    ]


def _limits(interval: Interval, digits: int) -> str:
    if interval.low is None or interval.high is None:
        return "no interval"
    return f"95 %: {interval.low:.{digits}f} … {interval.high:.{digits}f}"
