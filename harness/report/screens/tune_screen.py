"""The result of a search: the best candidate, the verdict on fresh pairs, and the Pareto front."""

import shlex
from collections.abc import Iterator, Sequence

from harness.report.screens.limit_tables import judged_words
from harness.report.screens.screen import KEPT, WIDEST, wrapped
from harness.report.screens.tables import counted, entry_heading, entry_limits, entry_value
from harness.scenario import as_written
from harness.statistics import Form
from harness.statistics.limits import Shown, binding
from harness.store.reading import BEST
from harness.studies.tuning.folder import Judged, Search, entry_of
from harness.studies.tuning.search import Trial

_MOST_OF_FRONT = 10


def tune_lines(search: Search, judged: Judged, width: int = WIDEST) -> Iterator[str]:
    """The lines of the screen.  Only commands and paths may be longer than ``width``."""
    width = min(width, WIDEST)
    for text in _texts(search, judged):
        indent = "    " if text.startswith("  ") else "  "
        yield from wrapped(text, width, indent, break_long_words=False)


def _texts(search: Search, judged: Judged) -> Iterator[str]:
    """The sentences of the screen, one each."""
    goal, kept = search.goal, sum(map(search.goal.keeps, judged.trials))
    verb = "minimise" if goal.direction == "minimize" else "maximise"
    limits = ", ".join(map(str, goal.limits)) or "nothing"
    yield f"{search.file.name}: {verb} {goal.objective}, subject to {limits}"
    tried = f"{counted(len(judged.trials), 'trial')} on pairs 0 to {search.pairs - 1:,}"
    keep = "keep every limit by their estimates" if goal.limits else "have a value and no failure"
    yield f"{tried}; {kept:,} {keep}."
    if refused := [trial.refused for trial in judged.trials if trial.refused]:
        yield f"! {counted(len(refused), 'trial')} refused, the first: {refused[0]}"
    if failed := [trial for trial in judged.trials if trial.failure]:
        yield (
            f"! Episodes failed in {counted(len(failed), 'trial')}, the first: "
            f"trial {failed[0].number}, {failed[0].failure}"
        )
    if any(trial.failed_av for trial in judged.trials):
        yield "! A trial in which the AV failed cannot be the best, whatever its numbers are."
    if judged.best is None and goal.limits:
        yield "! No trial keeps every limit: there is no best candidate and no verdict."
    elif judged.best is None:
        yield f"! No trial has {goal.objective} without a failure: there is no best candidate."
    else:
        yield from _best(search, judged, judged.best)
    yield from _front(judged)
    yield _whole(f"All trials: {judged.folder / 'trials.jsonl'}")


def _front(judged: Judged) -> Iterator[str]:
    shown = sorted(judged.front, key=judged.goal.cost)[:_MOST_OF_FRONT]
    if not shown:
        return
    yield (
        f"Pareto front of the search, {counted(len(judged.front), 'trial')}. These are search "
        "data: the best of many estimates flatter themselves."
    )
    for trial in shown:
        numbers = ", ".join(
            _whole(f"{name} {value:.4g}")
            for name, value in trial.numbers.items()
            if value is not None
        )
        yield f"  trial {trial.number}: {_written(trial)}: {numbers}"


def _best(search: Search, judged: Judged, best: Trial) -> Iterator[str]:
    first, last = search.pairs, search.pairs + search.fresh - 1
    cost = judged.goal.cost(best)
    yield f"Best: trial {best.number}, {_written(best)}"
    tied = [t for t in judged.trials if judged.goal.keeps(t) and judged.goal.cost(t) == cost]
    if len(tied) > 1:
        yield f"{len(tied):,} trials tie, with the same {judged.goal.objective}: {_ranges(tied)}"
    yield f"On fresh pairs {first:,} to {last:,}, with one-sided 95 % bounds of each number:"
    thresholds = search.file.scenario().conflicts.model_dump()
    for name in search.goal.names:
        entry, found = entry_of(name), judged.findings[name]
        share = entry.form in (Form.EVENTS, Form.SHARE)
        value = entry_value(entry, found, entry.digits + 1)
        limits = entry_limits(entry, found, 3 if share else entry.digits + 1)
        bounds = _whole(f" ({limits}{' %' if share else ''})") if limits else ""
        estimate = f"in the search {best.numbers[name]:.4g}"
        yield f"  {name}, {entry_heading(entry, thresholds)}: {_whole(value)}{bounds}; {estimate}"
    for limit in judged.verdicts:
        yield f"  {judged_words(limit)}"
    binds = binding(judged.verdicts)
    if binds is not None and len(judged.verdicts) > 1:
        yield f"  Binding: {binds.limit}"
    if failed := judged.findings["failed"].count:
        pairs = counted(failed, "fresh pair")
        yield f"! {pairs} failed and are left out. The first: {judged.failure}"
    if late := judged.findings["timed_out_av"].count:
        yield (
            f"! The AV timed out in {counted(late, 'fresh pair')}. Delay and μ leave these out; "
            "delay_worst_s and kappa_all count them."
        )
    open_rates = [
        each.limit
        for each in judged.verdicts
        if each.limit.name.startswith("kappa") and each.shown is Shown.NOT_SHOWN
    ]
    path = shlex.quote(str(judged.folder / BEST))
    if open_rates and not judged.failed_av:
        needed = ", ".join(f"{3 / of.limit:,.0f} for {of}" for of in open_rates if of.limit > 0)
        if needed:
            yield f"! Fresh pairs that are needed without a crash: about {needed}."
        yield _whole(f"To check it: harness risk {path}")
    yield _whole(f"To run it: harness run {path}")


def _written(trial: Trial) -> str:
    values = trial.candidate.items()
    return ", ".join(_whole(f"{key} = {as_written(value)}") for key, value in values)


def _ranges(trials: Sequence[Trial]) -> str:
    """The least and the greatest value of each parameter in these trials."""
    values = {key: [trial.candidate[key] for trial in trials] for key in trials[0].candidate}
    return ", ".join(
        _whole(f"{key} from {as_written(min(found))} to {as_written(max(found))}")
        for key, found in values.items()
    )


def _whole(text: str) -> str:
    return text.replace(" ", KEPT)
