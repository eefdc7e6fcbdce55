"""The result of a search: the best candidate, the verdict on fresh pairs, and the Pareto front."""

import shlex
from collections.abc import Iterator

from harness.report.screens.limit_tables import judged_words
from harness.report.screens.tables import counted, entry_heading, entry_limits, entry_value
from harness.scenario import as_written
from harness.statistics import Form
from harness.statistics.limits import Shown, binding
from harness.store.reading import BEST
from harness.studies.tuning.folder import Judged, Search, entry_of
from harness.studies.tuning.search import Trial

_MOST_OF_FRONT = 10


def tune_lines(search: Search, judged: Judged) -> Iterator[str]:
    """The lines of the screen."""
    goal, kept = search.goal, sum(map(search.goal.keeps, judged.trials))
    verb = "minimise" if goal.direction == "minimize" else "maximise"
    limits = ", ".join(map(str, goal.limits)) or "nothing"
    yield f"{search.file.name}: {verb} {goal.objective}, subject to {limits}"
    tried = f"{counted(len(judged.trials), 'trial')} on pairs 0 to {search.pairs - 1:,}"
    yield f"{tried}; {kept:,} keep every limit by their estimates."
    if refused := [trial.refused for trial in judged.trials if trial.refused]:
        yield f"! {counted(len(refused), 'trial')} refused, the first: {refused[0]}"
    if judged.best is None:
        yield "! No trial keeps every limit: there is no best candidate and no verdict."
    else:
        yield from _best(search, judged, judged.best)
    shown = sorted(judged.front, key=goal.cost)[:_MOST_OF_FRONT]
    yield (
        f"Pareto front of the search, {counted(len(judged.front), 'trial')}. These are search "
        "data: the best of many estimates flatter themselves."
    )
    for trial in shown:
        numbers = ", ".join(
            f"{name} {value:.4g}" for name, value in trial.numbers.items() if value is not None
        )
        yield f"  trial {trial.number}: {_written(trial)}: {numbers}"
    yield f"All trials: {judged.folder / 'trials.jsonl'}"


def _best(search: Search, judged: Judged, best: Trial) -> Iterator[str]:
    first, last = search.pairs, search.pairs + search.fresh - 1
    yield f"Best: trial {best.number}, {_written(best)}"
    yield f"On fresh pairs {first:,} to {last:,}, with one-sided 95 % bounds of each number:"
    thresholds = search.file.scenario().conflicts.model_dump()
    for name in search.goal.names:
        entry, found = entry_of(name), judged.findings[name]
        value, limits = entry_value(entry, found, entry.digits + 1), entry_limits(entry, found, 3)
        percent = " %" if entry.form in (Form.EVENTS, Form.SHARE) else ""
        bounds = f" ({limits}{percent})" if limits else ""
        estimate = f"in the search {best.numbers[name]:.4g}"
        yield f"  {name}, {entry_heading(entry, thresholds)}: {value}{bounds}; {estimate}"
    for limit in judged.verdicts:
        yield f"  {judged_words(limit)}"
    binds = binding(judged.verdicts)
    if binds is not None and len(judged.verdicts) > 1:
        yield f"  Binding: {binds.limit}"
    if failed := judged.findings["failed"].count:
        yield f"! {counted(failed, 'fresh pair')} failed and are left out."
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
    if open_rates:
        needed = ", ".join(f"{3 / of.limit:,.0f} for {of}" for of in open_rates if of.limit > 0)
        words = f"Fresh pairs that are needed without a crash: about {needed}. " if needed else ""
        yield f"! {words}harness risk {path} can check this candidate."
    yield f"To run it: harness run {path}"


def _written(trial: Trial) -> str:
    return ", ".join(f"{key} = {as_written(value)}" for key, value in trial.candidate.items())
