"""The sentences below the tables of a comparison, for the terminal and the page."""

from harness.report.screens.limit_tables import OWN_BOUND, binding_words
from harness.report.screens.result_texts import with_limits
from harness.report.screens.tables import counted, entry_value, level, named_values
from harness.scenario import as_written
from harness.statistics import ENTRIES, Findings, SweepVerdict, Verdict
from harness.studies.runs.comparisons import GroupResult, RunComparison, SweepResult


def allowed_lines(result: SweepResult, error: float) -> list[str]:
    """Return sentences about the allowed values.

    Args:
        result: the judgement of each value of one parameter.
        error: probability that any of the bounds is wrong.
    """
    sweep, found = result.sweep, result.found
    together = f", with {level(1 - error)} confidence for all {len(sweep.values)} values together."
    within = f"μ below {result.limits.mu0:g} and κ below {result.limits.kappa0:g}"
    if found.verdict is SweepVerdict.SOME:
        allowed = _values(result, Verdict.ALLOWED)
        lines = [f"Allowed: {sweep.parameter} = {allowed}: {within}{together}"]
        if Verdict.UNDECIDED in {judgement.verdict for judgement in found.judgements}:
            undecided = f"{sweep.parameter} = {_values(result, Verdict.UNDECIDED)}"
            lines.append(f"Undecided: {undecided}.{_unreliable(result)}")
        return lines
    if found.verdict is SweepVerdict.NONE:
        return [f"No value is allowed: none has {within}{together}"]
    undecided = _values(result, Verdict.UNDECIDED)
    line = f"Too few pairs to tell: {sweep.parameter} = {undecided} undecided."
    line += _unreliable(result)
    if found.pairs_needed is None:
        return [f"{line} The present estimates do not show how many pairs would be enough."]
    what = (
        "that one of them is allowed"
        if found.expected is SweepVerdict.SOME
        else "that none is allowed"
    )
    return [
        f"{line} At the present estimates about {found.pairs_needed:,} pairs would show {what}."
    ]


def best_lines(result: GroupResult) -> list[str]:
    """Return sentences about a group's best allowed cell; empty if no cell is judged."""
    if not result.limits:
        return []
    cells, best = result.group.cells, result.best_allowed
    shared = named_values(result.group.shared)
    where = "Best allowed cell" + (f" at {shared}" if shared else "")
    sure = _sure(result)
    if best is None:
        return [f"{where}: none is shown to be allowed, {sure}. {binding_words(result)}"]
    findings, alike = result.summaries[best].findings, result.untold_from(best)
    times = findings["time_ratio"]
    few = f"; {times.reason}" if times.reason else ""
    text = (
        f"{where}: {cells[best].number} ({cells[best].label}), ratio of times "
        f"{with_limits(ENTRIES['time_ratio'], times)}{few}; {_left_out(findings)}. It is the "
        f"smallest ratio of {counted(len(result.allowed), 'cell')} allowed {sure}."
    )
    if alike:
        names = ", ".join(str(cells[at].number) for at in alike)
        text += f" Not shown to differ from it: cell{'s' * (len(alike) > 1)} {names}."
    return [f"{text} {binding_words(result)}"]


def _sure(result: GroupResult) -> str:
    """Return by which bounds cells are allowed: those of all cells together, own ones, or both."""
    parts = []
    if result.together:
        sure = level(1 - result.level)
        parts.append(f"by bounds of all {len(result.limits)} cells together, {sure}")
    if own := [str(each.limit) for each in result.limits[0][2 * result.together :]]:
        parts.append(f"under {', '.join(own)}, {OWN_BOUND}")
    return ", and ".join(parts)


def _left_out(findings: Findings) -> str:
    """Return how many pairs the ratio of times leaves out, with reason and worst case."""
    count = findings["pairs"].count - findings["time_ratio_pairs"].count
    if not count:
        return "no pair left out"
    worst = entry_value(ENTRIES["time_ratio_worst"], findings["time_ratio_worst"])
    why = "as the AV crashed or an arm failed"
    return f"{counted(count, 'pair')} left out, {why}: worst case {worst}"


def comparison_lines(result: RunComparison) -> list[str]:
    """Return sentences about the tables' findings, and how to read the tables."""
    tests = sum(len(group.comparisons) for group in result.groups)
    error = f"{1 - result.confidence:.2g}"
    notes = [
        line
        for group in result.groups
        for sweep in group.sweeps
        for line in allowed_lines(sweep, group.level)
    ]
    notes += [
        f"Intervals: {level(result.confidence)} each. The interval of a difference excludes 0 only "
        "if the sign-flip test of the pairs rejects. p: exact McNemar test of the crash rates. "
        f"Holm: corrected for all {tests} tests of this comparison.",
        "Ratio of times: sum of the AV's times / sum of the reference's, over the pairs in which "
        "nobody failed and the AV did not crash. Missed: crashed, timed out or strategy failed; "
        "κ with time-outs counts all three.",
        "Front: by ratio of times and κ with time-outs. Two cells differ if p (Holm) of either is "
        f"below {error}, corrected for all {2 * tests} tests of both. A single interval may "
        "contradict that. Two cells are alike if they differ in no pair.",
    ]
    few = any(
        finding.reliable is False
        for group in result.groups
        for summary in group.summaries
        for finding in summary.findings.values()
    )
    few = few or any(item.indicative for group in result.groups for item in group.comparisons)
    few = few or any(
        judgement.swept.unreliable
        for group in result.groups
        for sweep in group.sweeps
        for judgement in sweep.found.judgements
    )
    if few:
        notes.append("* unreliable: too few informative pairs.")
    repeats = sum(group.group.repeats for group in result.groups)
    if repeats:
        notes.append(
            f"{repeats} cells are left out: each repeats the strategy and parameters of another "
            "cell."
        )
    notes += [line for group in result.groups for line in best_lines(group)]
    return notes


def _values(result: SweepResult, verdict: Verdict) -> str:
    judged = zip(result.sweep.values, result.found.judgements, strict=True)
    return ", ".join(
        as_written(value) for value, judgement in judged if judgement.verdict is verdict
    )


def _unreliable(result: SweepResult) -> str:
    """Return a sentence on the undecided values at which the bound of μ is unreliable."""
    values = ", ".join(
        as_written(value)
        for value, judgement in zip(result.sweep.values, result.found.judgements, strict=True)
        if judgement.unreliable
    )
    at = f"{result.sweep.parameter} = {values}"
    return f" The bound of μ at {at} is unreliable: too few informative pairs." if values else ""
