"""The tables and sentences of a comparison, for the terminal and the page alike."""

from collections import defaultdict

from harness.comparison import Place, Standing, Summary, SweepVerdict, Verdict
from harness.report.caveats import av_label, caveats, joined_caveats, sentence
from harness.report.tables import (
    Table,
    TableCell,
    count_cell,
    counted,
    interval_cell,
    level,
    limits,
    named_values,
    number,
    share_cell,
    value_cell,
)
from harness.report.words import left_out, unreliable_keys, unreliable_words
from harness.runs.comparisons import GroupResult, RunComparison, SweepResult
from harness.scenario import as_written

_NAMED = 4
"""Cells named in a word about another; the JSON document has all."""


def comparison_tables(result: RunComparison) -> list[Table]:
    """Every group's cells and their front, the differences, and the allowed values."""
    tables = []
    for place, group in enumerate(result.groups):
        shared = named_values(group.group.shared)
        name = f"{result.name}, {shared}" if shared else result.name
        tables.append(_cell_table(group, f"compared-{place}", name))
        if group.comparisons:
            tables.append(_difference_table(group, f"differences-{place}", name))
        tables += [
            _sweep_table(sweep, group, f"allowed-{place}-{position}")
            for position, sweep in enumerate(group.sweeps)
        ]
    return tables


def comparison_caveats(result: RunComparison) -> list[str]:
    """What a reader has to know before any number of the comparison."""
    of_cells = {
        cell.number: caveats(cell.cell.scenario, summary)
        for group in result.groups
        for cell, summary in zip(group.group.cells, group.summaries, strict=True)
    }
    return [sentence(words) for words in joined_caveats(of_cells)]


def _cell_table(result: GroupResult, name: str, caption: str) -> Table:
    rows = []
    for cell, summary, standing in zip(
        result.group.cells, result.summaries, result.standings(), strict=True
    ):
        star = defaultdict(str, dict.fromkeys(unreliable_keys(summary), "*"))
        rows.append(
            (
                count_cell(cell.number),
                TableCell(av_label(cell.label, summary)),
                count_cell(summary.pairs),
                interval_cell(summary.time_ratio, 3, star["time_ratio"]),
                _left_out(summary),
                interval_cell(summary.mu, 3, star["mu"]),
                interval_cell(summary.delay_s, 2, star["delay_s"]),
                share_cell(summary.kappa),
                share_cell(summary.kappa_all),
                TableCell(_words(standing, result)),
                interval_cell(summary.time_ratio_worst, 3, star["time_ratio_worst"]),
                interval_cell(summary.mu_worst, 3, star["mu_worst"]),
                interval_cell(summary.delay_worst_s, 2, star["delay_worst_s"]),
                count_cell(summary.timed_out_av),
                count_cell(summary.defined_pairs),
            )
        )
    front = (
        "cell", "AV", "pairs", "ratio of times", "left out", "μ", "delay AV s", "κ",
        "κ with time-outs", "front",
    )  # fmt: skip
    worst = ("ratio of times, worst case", "μ, worst case", "delay AV s, worst case")
    return Table(
        name,
        f"{caption}: strategies",
        (*front, *worst, "AV timed out", "pairs with τ"),
        tuple(rows),
        sortable=True,
        terminal=tuple(range(len(front))),
    )


def _left_out(summary: Summary) -> TableCell:
    """How many pairs the ratio of times leaves out, over what it is at its worst."""
    count = summary.pairs - summary.time_ratio_pairs
    worst = f"worst {number(summary.time_ratio_worst.value, 2)}" if count else ""
    return TableCell(f"{count:,}", worst, str(count))


def _difference_table(result: GroupResult, name: str, caption: str) -> Table:
    numbers = [cell.number for cell in result.group.cells]
    rows = []
    for item in result.comparisons:
        star = {
            key: "*" if key in item.indicative else ""
            for key in ("time_ratio_difference", "mu_difference", "delay_difference_s")
        }
        rows.append(
            (
                count_cell(numbers[item.a]),
                count_cell(numbers[item.b]),
                count_cell(item.counted_in_both),
                interval_cell(item.time_ratio_difference, 4, star["time_ratio_difference"]),
                _p_cell(item.time_ratio_p_holm),
                interval_cell(item.mu_difference, 4, star["mu_difference"]),
                interval_cell(item.delay_difference_s, 2, star["delay_difference_s"]),
                TableCell(f"{item.crashes.only_a} / {item.crashes.only_b}"),
                _p_cell(item.crashes.p),
                _p_cell(item.p_holm),
                TableCell(f"{item.misses.only_a} / {item.misses.only_b}"),
                _p_cell(item.misses_p_holm),
                count_cell(item.defined_in_both),
            )
        )
    headings = (
        "A", "B", "pairs", "ratio of times", "times, p (Holm)", "μ", "delay AV s",
        "crashed in A / B alone", "p", "p (Holm)", "missed in A / B alone",
        "missed, p (Holm)", "pairs with τ",
    )  # fmt: skip
    words = f"{caption}: differences, A − B (negative: A takes less time), over the pairs both have"
    shown = tuple(at for at, heading in enumerate(headings) if heading not in ("p", "pairs with τ"))
    return Table(name, words, headings, tuple(rows), sortable=True, terminal=shown)


def _sweep_table(result: SweepResult, group: GroupResult, name: str) -> Table:
    sweep, allowed = result.sweep, result.limits
    fixed = "".join(f", {name} = {as_written(value)}" for name, value in sweep.fixed.items())
    bold = sweep.aggressiveness
    rows = []
    for position, judgement in enumerate(result.found.judgements):
        star = "*" if result.indicative[position] else ""
        needed, cell = judgement.pairs_needed, sweep.cells[position]
        summary = group.summaries[cell]
        rows.append(
            (
                value_cell(sweep.values[position]),
                *([value_cell(bold[position])] if bold else []),
                count_cell(group.group.cells[cell].number),
                count_cell(judgement.swept.pairs),
                interval_cell(judgement.swept.mu, 4, star),
                interval_cell(summary.mu_worst, 4),
                share_cell(judgement.swept.kappa),
                count_cell(summary.failed_engine),
                TableCell(judgement.verdict.value),
                TableCell("") if needed is None else count_cell(needed),
            )
        )
    headings = (
        sweep.parameter,
        *(["aggressiveness"] if bold else []),
        *("cell", "pairs", "μ, bounds", "μ, worst case", "κ, bounds", "engine failed"),
        *("verdict", "pairs needed"),
    )
    caption = f"allowed values of {sweep.key}{fixed}: μ < {allowed.mu0:g}, κ < {allowed.kappa0:g}"
    caption += " (μ: human's crashes as if untouched; κ: time-outs and failures as crashes)"
    return Table(name, caption, headings, tuple(rows))


def allowed_lines(result: SweepResult, error: float) -> list[str]:
    """The verdict in words.

    Args:
        result: the judgement of each value of one parameter.
        error: chance that any of the bounds is wrong.
    """
    sweep, found = result.sweep, result.found
    together = f"with {level(1 - error)} confidence for all {len(sweep.values)} values together"
    within = f"μ below {result.limits.mu0:g} and κ below {result.limits.kappa0:g}"
    if found.verdict is SweepVerdict.SOME:
        allowed = _values(result, Verdict.ALLOWED)
        words = " Bounds of μ unreliable: too few informative pairs."
        few = words if any(result.indicative) else ""
        lines = [f"Allowed: {sweep.parameter} = {allowed}: {within}, {together}.{few}"]
        if Verdict.UNDECIDED in {judgement.verdict for judgement in found.judgements}:
            lines.append(f"Undecided: {sweep.parameter} = {_values(result, Verdict.UNDECIDED)}.")
        return lines
    if found.verdict is SweepVerdict.NONE:
        return [f"No value is allowed: none has {within}, {together}."]
    undecided = _values(result, Verdict.UNDECIDED)
    line = f"Too few pairs to tell: {sweep.parameter} = {undecided} undecided."
    if found.pairs_needed is None:
        return [f"{line} The present estimates do not say how many would do."]
    what = "one of them allowed" if found.expected is SweepVerdict.SOME else "that none is allowed"
    return [
        f"{line} At the present estimates about {found.pairs_needed:,} pairs would show {what}."
    ]


def best_lines(result: GroupResult) -> list[str]:
    """The best of a group's allowed cells in words; nothing where nothing is judged."""
    if result.judged is None:
        return []
    cells, best = result.group.cells, result.best_allowed
    shared = named_values(result.group.shared)
    where = "Best allowed cell" + (f" at {shared}" if shared else "")
    sure = f"by bounds of all {len(cells)} cells together, {level(1 - result.level)}"
    if best is None:
        return [f"{where}: none is allowed, {sure}."]
    summary, untold = result.summaries[best], result.untold_from(best)
    times, few = summary.time_ratio, unreliable_words(summary, "time_ratio")
    said = (
        f"{where}: {cells[best].number} ({cells[best].label}), ratio of times "
        f"{number(times.value, 3)} ({limits(times, 3)}{few and '; ' + few}; {left_out(summary)}), "
        f"the least of {counted(len(result.allowed), 'cell')} allowed {sure}."
    )
    if untold:
        names = ", ".join(str(cells[at].number) for at in untold)
        said += f" Not told apart from it: cell{'s' * (len(untold) > 1)} {names}."
    return [said]


def comparison_lines(result: RunComparison) -> list[str]:
    """The tables' findings in words, and how to read them."""
    tests = sum(len(group.comparisons) for group in result.groups)
    error = f"{1 - result.confidence:.2g}"
    notes = [
        line
        for group in result.groups
        for sweep in group.sweeps
        for line in allowed_lines(sweep, group.level)
    ]
    notes += [
        f"Intervals: {level(result.confidence)} each; of differences they leave out 0 only where "
        "the sign-flip test of the pairs rejects. p: exact McNemar test of the crash rates; Holm: "
        f"within the family of all {tests} of this comparison.",
        "Ratio of times: sum of the AV's times / sum of the reference's, over the pairs in which "
        "nobody failed and the AV did not crash. Missed: crashed, timed out or strategy failed; "
        "these are in κ with time-outs.",
        "Front: by ratio of times and κ with time-outs, told apart where p (Holm) of either is "
        f"below {error}, within the family of all {2 * tests} tests of both, which an interval may "
        "contradict; alike where no pair differs.",
    ]
    few = any(unreliable_keys(of) for group in result.groups for of in group.summaries)
    few = few or any(item.indicative for group in result.groups for item in group.comparisons)
    few = few or any(any(s.indicative) for group in result.groups for s in group.sweeps)
    if few:
        notes.append("* unreliable: too few informative pairs")
    repeats = sum(group.group.repeats for group in result.groups)
    if repeats:
        notes.append(f"{repeats} cells repeat another's strategy and parameters; left out.")
    notes += [line for group in result.groups for line in best_lines(group)]
    return notes


def _p_cell(p: float) -> TableCell:
    return TableCell(f"{p:.2g}", sort=repr(p))


def _values(result: SweepResult, verdict: Verdict) -> str:
    judged = zip(result.sweep.values, result.found.judgements, strict=True)
    return ", ".join(
        as_written(value) for value, judgement in judged if judgement.verdict is verdict
    )


def _words(standing: Standing, result: GroupResult) -> str:
    if standing.place is Place.DOMINATED:
        return f"dominated by {_numbers(standing.dominated_by, result)}"
    if standing.place is Place.UNDECIDED:
        return f"undecided against {_numbers(standing.open_against, result)}"
    return standing.place.value


def _numbers(positions: tuple[int, ...], result: GroupResult) -> str:
    """The numbers of the first few of these cells."""
    shown = [str(result.group.cells[position].number) for position in positions]
    more = f" and {len(shown) - _NAMED} more" if len(shown) > _NAMED else ""
    return ", ".join(shown[:_NAMED]) + more
