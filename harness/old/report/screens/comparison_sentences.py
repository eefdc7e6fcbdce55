"""The sentences below the tables of a comparison, for the terminal and the page."""

from harness.old.report.screens.tables import level
from harness.old.statistics import CONFIDENCE, SweepVerdict, Verdict
from harness.old.studies.runs.comparisons import LEVEL, RunComparison, SweepResult
from harness.scenario import as_written


def allowed_lines(result: SweepResult) -> list[str]:
    """Return sentences about the allowed values of one parameter."""
    sweep, found = result.sweep, result.found
    together = f", with {level(CONFIDENCE)} confidence for all {len(sweep.values)} values together."
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


def comparison_lines(result: RunComparison) -> list[str]:
    """Return sentences about the tables' findings, and how to read the tables."""
    tests = sum(len(group.comparisons) for group in result.groups)
    error = f"{LEVEL:.2g}"
    notes = [
        line for group in result.groups for sweep in group.sweeps for line in allowed_lines(sweep)
    ]
    notes += [
        f"Intervals: {level(CONFIDENCE)} each. The interval of a difference excludes 0 only "
        "if the sign-flip test of the pairs rejects. p: exact McNemar test of the crash rates. "
        f"Holm: corrected for all {tests} tests of this comparison.",
        "Ratio of times: sum of the AV's times / sum of the reference's, over the pairs in which "
        "nobody failed and the AV did not crash. Missed: crashed, timed out or strategy failed; "
        "κ with time-outs counts all three.",
        "Less time, fewer crashes or time-outs: p (Holm) of the ratio of times, or of κ with "
        f"time-outs, is below {error}, corrected for all {2 * tests} tests of both. A single "
        "interval may contradict that.",
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
