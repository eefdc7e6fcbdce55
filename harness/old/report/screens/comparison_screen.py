"""The first screen of a comparison: the better cells, and the allowed values."""

import shlex
from collections.abc import Mapping

from harness.old.report.screens.comparison_sentences import allowed_lines
from harness.old.report.screens.comparison_tables import cell_numbers, comparison_notes
from harness.old.report.screens.result_texts import with_limits, zero_lines
from harness.old.report.screens.screen import KEPT, Screen
from harness.old.report.screens.tables import counted, entry_value, named_values
from harness.old.statistics import CONFIDENCE, ENTRIES, Rank
from harness.old.statistics.entries import Finding
from harness.old.studies.runs.comparisons import LEVEL, GroupResult, RunComparison
from harness.old.studies.runs.notes import av_label
from harness.old.studies.runs.site_words import site_words
from harness.scenario import as_written

_MOST_CELLS = 6
"""Maximum number of rows; the tables of ``--full`` have every cell."""

_MOST_SENTENCES = 3
_NAMED = 3
_CRASHES = ENTRIES["kappa"]


def comparison_screen(result: RunComparison) -> Screen:
    """Return the first cells of each group, by the ratio of times."""
    each = max(1, _MOST_CELLS // len(result.groups))
    groups = result.groups[:_MOST_CELLS]
    rows = [row for group in groups for row in _group_rows(group, each)]
    several = len(result.groups) > 1
    shared = ", ".join(key.split(".")[-1] for key in result.groups[0].group.shared)
    scenarios = [member.cell.scenario for group in result.groups for member in group.group.cells]
    summaries = [summary for group in result.groups for summary in group.summaries]
    cells = len(scenarios)
    hidden = cells - len(rows)
    notes = comparison_notes(result)
    tested = all(note.rank is not Rank.NOTHING_TESTED for note in notes)
    crashes = [(summary.findings["kappa"], CONFIDENCE) for summary in summaries if tested]
    zeros = zero_lines(_CRASHES, crashes)
    counts = [summary.findings["pairs"].count for summary in summaries]
    pairs = " … ".join(f"{count:,}" for count in sorted({min(counts), max(counts)}))
    met_nobody = sum(summary.findings["met_nobody"].count for summary in summaries)
    nobody = f" ({met_nobody:,} of {sum(counts):,} met nobody)" if met_nobody else ""
    seeds = ", ".join(map(str, sorted({scenario.experiment.seed for scenario in scenarios})))
    footer = "All cells, differences and tests: --full. Page: harness report "
    footer += shlex.quote(str(result.folders[0]))
    # On a narrow terminal the last column is left out, and a time without crashes would flatter.
    better = [f"fewer{KEPT}crashes or{KEPT}time-outs than", "less time than"]
    headings = ["cell", "AV", "ratio of times", "worst case", "crashes", *better]
    return Screen(
        title=f"{result.name}: {counted(cells, 'cell')} compared pair by pair",
        scope=f"{pairs} pairs each{nobody}, seed {seeds}, significant if p (Holm) < {LEVEL:.2g}",
        headings=(*([shared] if several else []), *headings),
        rows=tuple(row if several else row[1:] for row in rows),
        conclusions=tuple(_sentences(result, [*_hidden(result, hidden), *zeros])),
        notes=notes,
        footer=footer,
        site=site_words(scenarios),
        always=5 + several,
    )


def _group_rows(group: GroupResult, most: int) -> list[tuple[str, ...]]:
    cells = group.group.cells
    times = [summary.findings["time_ratio"].number for summary in group.summaries]

    def rank(at: int) -> tuple[bool, float]:
        return times[at] is None, times[at] or 0.0

    rows = []
    for at in sorted(range(len(cells)), key=rank)[:most]:
        findings = group.summaries[at].findings
        rows.append(
            (
                ", ".join(map(as_written, group.group.shared.values())),
                str(cells[at].number),
                av_label(cells[at].label, findings),
                with_limits(ENTRIES["time_ratio"], findings["time_ratio"]),
                _worst_case(findings),
                entry_value(_CRASHES, findings["kappa"]),
                *(_numbers(group, group.beaten_by(at, by)) for by in (1, 0)),
            )
        )
    return rows


def _worst_case(findings: Mapping[str, Finding]) -> str:
    """Return the worst ratio of times of a cell with excluded or timed-out pairs."""
    counts = [findings[name].number or 0 for name in ("pairs", "time_ratio_pairs", "timed_out")]
    if counts[0] == counts[1] and not counts[2]:
        return ""
    entry = ENTRIES["time_ratio_worst"]
    return entry_value(entry, findings["time_ratio_worst"], entry.paired_digits)


def _numbers(group: GroupResult, positions: list[int]) -> str:
    """Return the numbers of the first few of these cells."""
    if not positions:
        return "–"
    if len(positions) == len(group.summaries) - 1 > 1:
        return "all"
    return cell_numbers(positions, group, _NAMED)


def _sentences(result: RunComparison, first: list[str]) -> list[str]:
    """Return the first sentences as one line, and those about the allowed values that fit."""
    lines = [
        line for group in result.groups for sweep in group.sweeps for line in allowed_lines(sweep)
    ]
    if len(lines) > _MOST_SENTENCES:
        lines = [*lines[: _MOST_SENTENCES - 1], "More on what the limits allow: --full."]
    return [*([" ".join(first)] if first else []), *lines]


def _hidden(result: RunComparison, hidden: int) -> list[str]:
    """Return a sentence about the number of hidden cells, and the hidden groups."""
    if not hidden:
        return []
    groups = [named_values(group.group.shared) for group in result.groups[_MOST_CELLS:]]
    more = f" and {len(groups) - _NAMED} more groups" if len(groups) > _NAMED else ""
    whole = f", among them all of {'; '.join(groups[:_NAMED])}{more}" if groups else ""
    return [f"Not shown here: {counted(hidden, 'cell')}{whole}."]
