"""The tables that ``harness compare`` prints."""

from rich.table import Table

from harness.comparison import (
    Place,
    Standing,
    SweepVerdict,
    Verdict,
)
from harness.report.console import make_console, number, plain, table_of_columns, with_range
from harness.review.comparisons import GroupResult, RunComparison, SweepResult

_NAMED = 4
"""Cells named in a word about another; the JSON document has all."""


def print_comparison(result: RunComparison) -> None:
    """Every group: its cells and their front, the differences, the allowed intervals."""
    console = make_console()
    for group in result.groups:
        shared = ", ".join(f"{key} = {plain(value)}" for key, value in group.group.shared.items())
        console.print(f"{result.name}: {shared}" if shared else result.name)
        console.print(_cell_table(group))
        if group.comparisons:
            console.print(_difference_table(group))
        for sweep in group.sweeps:
            console.print(_sweep_table(sweep, group))
            for line in allowed_lines(sweep, group.level):
                console.print(line)
    for line in _notes(result):
        console.print(line)


def _cell_table(result: GroupResult) -> Table:
    table = table_of_columns(
        "strategies", "cell", "AV", "N", "timed out", "μ", "delay AV s", "κ", "(μ, κ)"
    )
    for cell, standing in zip(result.cells, result.standings(), strict=True):
        table.add_row(
            str(cell.strategy.cell.number),
            cell.strategy.label,
            str(cell.pairs),
            str(cell.timed_out),
            number(cell.mu, 4),
            number(cell.delay_s, 2),
            with_range(cell.kappa, 4),
            _words(standing, result),
        )
    return table


def _difference_table(result: GroupResult) -> Table:
    table = table_of_columns(
        "differences, A less B, over the pairs both have",
        "A",
        "B",
        "N",
        "μ",
        "delay AV s",
        "crashed in A / B alone",
        "p",
        "p (Holm)",
    )
    for item in result.comparisons:
        few = item.indicative
        table.add_row(
            str(result.cells[item.a].strategy.cell.number),
            str(result.cells[item.b].strategy.cell.number),
            str(item.defined_in_both),
            with_range(item.mu_difference, 4) + ("*" if "mu_difference" in few else ""),
            with_range(item.delay_difference_s, 2) + ("*" if "delay_difference_s" in few else ""),
            f"{item.crashes.only_a} / {item.crashes.only_b}",
            f"{item.crashes.p:.2g}",
            f"{item.p_holm:.2g}",
        )
    return table


def _sweep_table(result: SweepResult, group: GroupResult) -> Table:
    sweep, limits = result.sweep, result.limits
    fixed = "".join(f", {name} = {plain(value)}" for name, value in sweep.fixed.items())
    bold = sweep.aggressiveness
    table = table_of_columns(
        f"allowed values of {sweep.key}{fixed}: μ < {limits.mu0:g}, κ < {limits.kappa0:g}",
        sweep.parameter,
        *(["aggressiveness"] if bold else []),
        *("cell", "N", "μ [bounds]", "κ [bounds]", "verdict", "N needed"),
    )
    for position, judgement in enumerate(result.found.judgements):
        mu, kappa = judgement.swept.mu, judgement.swept.kappa
        table.add_row(
            plain(sweep.values[position]),
            *([plain(bold[position])] if bold else []),
            str(group.cells[sweep.cells[position]].strategy.cell.number),
            str(judgement.swept.pairs),
            with_range(mu, 4) + ("*" if result.indicative[position] else ""),
            with_range(kappa, 4),
            judgement.verdict.value,
            "" if judgement.pairs_needed is None else f"{judgement.pairs_needed}",
        )
    return table


def allowed_lines(result: SweepResult, level: float) -> list[str]:
    """The verdict in words."""
    sweep, found = result.sweep, result.found
    together = (
        f"with {100 * (1 - level):.3g} % confidence for all {len(sweep.values)} values together"
    )
    within = f"μ below {result.limits.mu0:g} and κ below {result.limits.kappa0:g}"
    if found.verdict is SweepVerdict.SOME:
        allowed = _values(result, Verdict.ALLOWED)
        few = " Indicative: N too small for the bounds of μ." if any(result.indicative) else ""
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
    return [f"{line} At the present estimates about N = {found.pairs_needed} would show {what}."]


def _notes(result: RunComparison) -> list[str]:
    tests = sum(len(group.comparisons) for group in result.groups)
    percent, level = f"{100 * result.confidence:.3g} %", f"{1 - result.confidence:.2g}"
    notes = [
        f"Intervals: {percent} each. p: exact McNemar test of the crash rates; Holm: within the "
        f"family of all {tests} of this run.",
        f"(μ, κ): told apart where an interval leaves out 0 or p (Holm) is below {level}; alike "
        "where no pair differs.",
    ]
    few = any(item.indicative for group in result.groups for item in group.comparisons)
    few = few or any(any(s.indicative) for group in result.groups for s in group.sweeps)
    if few:
        notes.append("* indicative: N too small")
    repeats = sum(group.group.repeats for group in result.groups)
    if repeats:
        notes.append(f"{repeats} cells repeat another's strategy and parameters; left out.")
    return notes


def _values(result: SweepResult, verdict: Verdict) -> str:
    judged = zip(result.sweep.values, result.found.judgements, strict=True)
    return ", ".join(plain(value) for value, judgement in judged if judgement.verdict is verdict)


def _words(standing: Standing, result: GroupResult) -> str:
    if standing.place is Place.DOMINATED:
        return f"dominated by {_numbers(standing.dominated_by, result)}"
    if standing.place is Place.UNDECIDED:
        return f"undecided against {_numbers(standing.open_against, result)}"
    return standing.place.value


def _numbers(positions: tuple[int, ...], result: GroupResult) -> str:
    """Of these cells, the first few."""
    shown = [str(result.cells[position].strategy.cell.number) for position in positions]
    more = f" and {len(shown) - _NAMED} more" if len(shown) > _NAMED else ""
    return ", ".join(shown[:_NAMED]) + more
