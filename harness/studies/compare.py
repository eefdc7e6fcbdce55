"""Compares strategies pair by pair: cells of one run or of several that differ only in the AV."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from harness.core.errors import InputError, Parameter, checked
from harness.core.seeding import resampling
from harness.core.vocabulary import ROUNDING
from harness.results import estimators
from harness.results.catalogue import ENTRY_OF, Entry
from harness.results.cell_findings import worst_cases
from harness.results.cell_tables import as_shown, drivers, scope_of, table_of
from harness.results.columns import AV, REFERENCE, PairSample
from harness.results.estimators import EQUAL, FEW, Sampling
from harness.results.finding import Finding, Form, Plain
from harness.results.loaded_run import Run, older_code
from harness.results.notes import RULES, Note, notes_of
from harness.results.place import place_in_words
from harness.results.result import Column, Entered, Result, Shown, Style, Table, Versus
from harness.results.simulated import SimulationSample
from harness.results.student import RELIABLE_PAIRS
from harness.results.tables import RunKind
from harness.scenario.variation import flatten
from harness.studies.allowed import allowed_in, allowed_table
from harness.studies.candidates import Candidate, groups_of, without_av

MOST_ROWS = 40
"""Rows of the first screen; JSON, CSV and ``--full`` have all."""

SIGNIFICANT = 0.05
"""A note says who crashes more often if the adjusted p is below it."""

_LEAST_P = 1e-9
"""A p of 0 is shown as this number, hence as < 0.001."""


class Difference(NamedTuple):
    """A number of cell A minus that of cell B over their common pairs.

    ``reliable_from`` is the least number of pairs that differ for a reliable interval; 0: exact.
    """

    key: str
    heading: str
    style: Style
    reliable_from: int
    of: Callable[[Any, Any, Sampling], Finding]


def _time_ratio(a: PairSample, b: PairSample, sampling: Sampling) -> Finding:
    (a_s, reference_s), (b_s, _) = a["counted_time_s"], b["counted_time_s"]
    return estimators.difference(a_s, b_s, sampling, reference_s)


def _mean(a: PairSample, b: PairSample, sampling: Sampling, column: str) -> Finding:
    """Of a column of both arms, or of the pairs."""
    a_of_av, b_of_av = (np.atleast_2d(each[column])[AV] for each in (a, b))
    return estimators.difference(a_of_av, b_of_av, sampling)


def _share(a: PairSample, b: PairSample, _sampling: Sampling, column: str, ran: str) -> Finding:
    marked, trials = ([each[name][AV] for each in (a, b)] for name in (column, ran))
    return estimators.share_difference(*marked, *trials)


_SHARE = Style(Form.SHARE, 1)
# fmt: off
DIFFERENCES = (
    Difference("time_ratio_difference", "ratio of times", Style(digits=3), 500, _time_ratio),
    Difference("mu_difference", "μ", Style(digits=3), 500, partial(_mean, column="tau")),
    Difference("delay_difference_s", "delay, s", Style(), 500, partial(_mean, column="delay_s")),
    Difference("delay_worst_difference_s", "delay, worst case, s", Style(), 1_000,
               partial(_mean, column="worst_delay_s")),
    Difference("kappa_difference", "crashes", _SHARE, 0,
               partial(_share, column="crashed", ran="ran")),
    Difference("kappa_all_difference", "crashes, time-outs, failures", _SHARE, 0,
               partial(_share, column="missed", ran="tried")),
)
# fmt: on
"""What is compared; a test of each has one family (Holm) over all rows of the table."""


def _of_simulations(entry: Entry) -> Difference:
    """The difference of an entry between the AVs' arms of two cells, with its t test."""

    def of(a: SimulationSample, b: SimulationSample, sampling: Sampling) -> Finding:
        both = (np.array([a[name][AV], b[name][AV]]) for name in entry.columns)
        return entry.of_columns(*both, sampling)

    form = Form.SHARE if entry.form is Form.EVENTS else entry.form
    heading = f"{entry.heading}{entry.unit and f', {entry.unit}'}"
    return Difference(f"{entry.key}_a_minus_b", heading, Style(form, entry.digits), 0, of)


_SHOWN = ("av_delay_s", "contacts", "conflicts_pet", "share_strategy")
_OTHERS = ("vehicles_delay_s", "other_delay_s", "av_contacts", "people_delay_s", "people_wait_s",
           "queue_p95", "av_time_loss_s")  # fmt: skip


class _Kind(NamedTuple):
    """What is compared of a kind of run.

    Attributes:
        differences: the differences; that of the first is on the screen.
        shown: the entries on the screen.
        worse: the difference that a note is made of, and what the worse one does more often.
        reference: columns that are equal if the reference met the same people and drove alike.
    """

    differences: tuple[Difference, ...]
    shown: tuple[str, ...]
    worse: tuple[str, str]
    reference: tuple[Any, ...]


_KINDS: Mapping[RunKind, _Kind] = {
    "encounters": _Kind(
        DIFFERENCES,
        ("time_ratio", "kappa"),
        ("kappa_all_difference", "crashes, times out or fails"),
        ("crashed", "steps", "pedestrians", "pass_time_s", "pedestrian_delay_s"),
    ),
    "simulations": _Kind(
        tuple(_of_simulations(ENTRY_OF[key]) for key in (*_SHOWN, *_OTHERS)),
        _SHOWN,
        ("contacts_a_minus_b", "touches people"),
        tuple(ENTRY_OF[key].column for key in ("passages", "people", "people_wait_s")),
    ),
}


_Column = tuple[Column, Sequence[Entered]]


class ComparedPair(NamedTuple):
    """Two strategies with their differences by key."""

    a: Candidate
    b: Candidate
    found: Mapping[str, Finding]


@checked
def compare(*runs: Run, mu0: float | None = None, kappa0: float | None = None) -> Result:
    """Compare every two cells that differ only in the AV's strategy, parameters or equipment.

    Args:
        runs: finished runs of one kind: one with several cells, or several of the same people.
        mu0, kappa0: the paper's limits of μ (above 0) and κ (above 0, at most 1); with both, the
            values of a swept parameter are judged.

    Returns:
        The result: a row for each comparison, with the differences and their p.

    Raises:
        InputError: there is no run; one is not finished, of another kind or named twice; no two
            cells can be compared, a limit is out of range, or the reference met other people in one
            of the runs.
    """
    _refuse_runs(runs)
    every = groups_of(runs)
    groups = [group for group in every if len(group) > 1]
    _refuse_unrelated(runs, groups)
    for group in groups:
        _refuse_other_people(group)
    kind = _KINDS[runs[0].kind]
    confidence = max(run.confidence for run in runs)
    pairs = [pair for group in groups for pair in combinations(group, 2)]
    rows = [ComparedPair(a, b, _differences(a, b, confidence)) for a, b in pairs]
    p_holm = {of.key: holm([row.found[of.key].p for row in rows]) for of in kind.differences}
    candidates = [candidate for group in groups for candidate in group]
    cells = [candidate.cell for candidate in candidates]
    judged = allowed_in(groups, mu0, kappa0, confidence)
    facts: dict[str, Plain] = {"seed": runs[0].manifest["seed"], "confidence": confidence}
    facts |= {each.title: each.values for each in judged}
    more = len(rows) - MOST_ROWS
    counted = "1 comparison" if len(rows) == 1 else f"{len(rows):,} comparisons"
    return Result(
        command="compare",
        title=f"{runs[0].name}: {counted}, pair by pair, of {drivers(cells)}",
        scope=f"{scope_of(cells, facts)}; p by Holm over the table{_alone(every)}",
        about=place_in_words([cell.scenario for cell in cells]),
        screen=_screen(rows[:MOST_ROWS], p_holm[kind.differences[0].key], kind),
        full=(
            *(_of_all(of, rows, p_holm[of.key]) for of in kind.differences),
            *map(allowed_table, judged),
        ),
        notes=notes_of(
            cells,
            [*older_code(runs[0].manifest), *_notes(rows, p_holm, kind)],
            [candidate.name for candidate in candidates],
        ),
        closing=(
            *(f"{each.title}: {each.values}." for each in judged),
            *([f"{more:,} more rows: --full."] if more > 0 else []),
        ),
        facts=facts,
        records=[
            {
                **row.a.shared,
                **_of_cell("a", row.a, kind),
                **_of_cell("b", row.b, kind),
                "pairs": _common(row.a, row.b),
                **row.found,
                **{f"{key}_p_holm": values[place] for key, values in p_holm.items()},
            }
            for place, row in enumerate(rows)
        ],
    )


def _refuse_runs(runs: Sequence[Run]) -> None:
    """Refuse no run, and runs that are not finished, of different kinds or code, or the same."""
    if not runs:
        raise InputError(Parameter("runs"), "there is none", "one or more")
    for number, run in enumerate(runs):
        run.refuse_unfinished()
        if run.kind != runs[0].kind:
            allowed = f"runs of {runs[0].kind}, as {runs[0].path}"
            raise InputError(str(run.path), f"is a run of {run.kind}", allowed)
        if run.manifest["simulated_with"]["code"] != runs[0].manifest["simulated_with"]["code"]:
            problem = f"has rows of other code than {runs[0].path}"
            allowed = "runs of the same code; `harness run` of a run's folder simulates it again"
            raise InputError(str(run.path), problem, allowed)
        if run.path.resolve() in [other.path.resolve() for other in runs[:number]]:
            raise InputError(str(run.path), "is named twice", "different runs")


def _refuse_unrelated(runs: Sequence[Run], groups: Sequence[Sequence[Candidate]]) -> None:
    """Refuse runs none of whose cells can be compared, if there are several with another run's."""
    least = min(len(runs), 2)
    joint = [group for group in groups if len({each.origin for each in group}) >= least]
    met = {each.run.path for group in joint for each in group}
    for alone in (run for run in reversed(runs) if run.path not in met):
        raise _nothing_to_compare([*[run for run in runs if run is not alone][:1], alone])


def _alone(groups: Sequence[Sequence[Candidate]]) -> str:
    """The cells that no other cell can be compared with, in words."""
    alone = [group[0].name for group in groups if len(group) == 1]
    return f"; without a partner: {', '.join(alone)}" if alone else ""


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Adjusted p of each test of a family (Holm 1979), in the given order.

    The j-th smallest of m values is multiplied by m − j + 1; the results are monotone, at most 1.
    None is the p of an undefined difference: a test of the family that was not made.
    """
    p = np.array([1.0 if p is None else p for p in p_values])
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted[order] = np.minimum(steps, 1.0)
    tested = zip(p_values, adjusted.tolist(), strict=True)
    return [None if given is None else value for given, value in tested]


def _of_cell(side: str, candidate: Candidate, kind: _Kind) -> dict[str, Plain | Finding]:
    """What a record says of one of its two cells."""
    said: dict[str, Plain | Finding] = {side: candidate.label}
    said |= {f"cell_{side}": candidate.cell.number, f"folder_{side}": str(candidate.run.path)}
    return said | {f"{key}_{side}": candidate.cell[key] for key in kind.shown}


def _refuse_other_people(group: Sequence[Candidate]) -> None:
    """Refuse cells of several runs whose references differ, which the AV cannot cause."""
    first, *others = group
    for other in (each for each in others if each.origin != first.origin):
        pairs = _common(first, other)
        a, b = (
            [each.sample(pairs)[name][REFERENCE] for name in _KINDS[each.run.kind].reference]
            for each in (first, other)
        )
        same = np.isclose(a, b, rtol=ROUNDING, atol=ROUNDING, equal_nan=True).all(axis=0)
        same |= np.isnan(a).all(axis=0) | np.isnan(b).all(axis=0)  # a simulation failed
        if not same.all():
            raise InputError(
                str(other.run.path),
                f"its reference drove otherwise than {first.run.path} in pair {same.argmin()}",
                "runs of the same version and model, or one sweep over both strategies",
            )


def _nothing_to_compare(runs: Sequence[Run]) -> InputError:
    if len(runs) == 1:
        allowed = "a sweep over arms.av or its parameters, or a second run"
        return InputError(str(runs[0].path), "has no two cells that differ only in the AV", allowed)
    trees = [flatten(without_av(run.cells[0].scenario)) for run in runs[:2]]
    keys = [key for key in {**trees[0], **trees[1]} if trees[0].get(key) != trees[1].get(key)]
    problem = f"differs from {runs[0].path} in more than the AV: {', '.join(keys[:5])}"
    return InputError(str(runs[1].path), problem, "the same seed, people, ego and reference")


def _apart(a: Candidate, b: Candidate) -> bool:
    """Whether two cells' own numbers of times may be of different pairs."""
    out = "not_in_time_ratio" if a.run.kind == "encounters" else "failed"
    pairs = {each.cell["pairs"].count for each in (a, b)}
    return len(pairs) > 1 or any(each.cell.total(out) for each in (a, b))


def _common(a: Candidate, b: Candidate) -> int:
    """The number of pairs that both cells have: entry i of each is pair i."""
    return min(a.cell["pairs"].count, b.cell["pairs"].count)


def _differences(a: Candidate, b: Candidate, confidence: float) -> dict[str, Finding]:
    pairs = _common(a, b)
    samples = a.sample(pairs), b.sample(pairs)
    seed = a.cell.scenario.experiment.seed
    found = {}
    for gap in _KINDS[a.run.kind].differences:
        finding = gap.of(*samples, Sampling(resampling(seed, "comparison"), confidence))
        if finding.value is None:
            finding = replace(finding, reason="no pair counts in both")
        found[gap.key] = finding.reliable_above(gap.reliable_from, "pairs that differ")
    return found


def _table(title: str, rows: Sequence[ComparedPair], *columns: _Column, legend: str = "") -> Table:
    """A table whose rows are named by the keys that the group shares, and the two strategies."""
    shared = dict.fromkeys(key for row in rows for key in row.a.shared)
    names: list[_Column] = [
        *(
            (Column(key, key.rpartition(".")[2]), [row.a.shared.get(key) for row in rows])
            for key in shared
        ),
        (Column("a", "A"), [row.a.driven for row in rows]),
        (Column("b", "B"), [row.b.driven for row in rows]),
    ]
    filled = [(name, tuple(values)) for name, values in (*names, *columns)]
    return table_of(title, filled, legend)


def _screen(rows: Sequence[ComparedPair], p_holm: Sequence[float | None], kind: _Kind) -> Table:
    """The first screen: each cell's own number, their paired difference, and one p."""

    def both(entry: Entry) -> _Column:
        numbers = [Versus(as_shown(entry, row.a.cell), as_shown(entry, row.b.cell)) for row in rows]
        heading = entry.title(rows[0].a.cell.scenario.conflicts.model_dump())
        return Column(entry.key, heading), numbers

    first, *others = (ENTRY_OF[key] for key in kind.shown)
    worst = worst_cases([each.cell for row in rows for each in (row.a, row.b)])
    return _table(
        "",
        rows,
        both(first),
        _difference(kind.differences[0], rows),
        _p_values("p", p_holm[: len(rows)]),
        *map(both, [*others, *worst]),
        legend="Two numbers in a cell: A / B.",
    )


def _difference(gap: Difference, rows: Sequence[ComparedPair]) -> _Column:
    return Column(gap.key, "A − B", True), [Shown(row.found[gap.key], gap.style) for row in rows]


def _p_values(heading: str, values: Sequence[float | None]) -> _Column:
    """A column of p; one of 0, with no resample beyond, is shown as below 0.001."""
    found = [Finding(p if p is None else max(p, _LEAST_P)) for p in values]
    return Column("p_holm", heading), [Shown(each, Style(digits=3)) for each in found]


def _of_all(of: Difference, rows: Sequence[ComparedPair], p_holm: Sequence[float | None]) -> Table:
    found = [row.found[of.key] for row in rows]
    differ = [each.n if each.events is None else each.events for each in found]
    return _table(
        f"Difference of {of.heading}".format(**rows[0].a.cell.scenario.conflicts.model_dump()),
        rows,
        _difference(of, rows),
        (Column("n", "pairs that differ"), differ),
        _p_values("p (Holm)", p_holm),
    )


def _notes(
    rows: Sequence[ComparedPair], p_holm: Mapping[str, Sequence[float | None]], kind: _Kind
) -> list[Note]:
    """The notes on rows; each ranks with the rule of runs whose news are as bad."""
    worse, (key, does) = [], kind.worse
    for (a, b, found), p in zip(rows, p_holm[key], strict=True):
        value = found[key].value
        if value and p is not None and p < SIGNIFICANT:
            one, other = (a, b) if value > 0 else (b, a)
            worse.append(f"{one.name} {does} more often than {other.label}")
    others, among = len(worse) - 1, f"of {len(rows):,} rows"
    similar = f" (similar in {others:,} more row{'s' * (others > 1)})" if others > 0 else ""
    of_times = [row.found[kind.differences[0].key] for row in rows]
    unsure = [each for each in of_times if each.reliable is False or each.reason == FEW]
    few = [each.n for each in unsure if each.n is not None]
    least = kind.differences[0].reliable_from or RELIABLE_PAIRS
    shares = sum(row.a.av_share != row.b.av_share for row in rows)
    cut, equal = sum(_apart(*row[:2]) for row in rows), sum(f.reason == EQUAL for f in of_times)
    rank_of = {rule.key: rank for rank, rule in enumerate(RULES)}
    said = (
        ("more_crashes", "more crashes", rank_of["collisions"], worse,
         f"{''.join(worse[:1])}{similar}.", ""),
        ("few_differ", "few pairs differ", rank_of["few_pairs"], few,
         f"In {len(few):,} {among} A − B is unreliable (*): few pairs differ (fewest: "
         f"{min(few, default=0):,}).", f"It is reliable from {least:,} on."),
        ("other_avs", "other vehicles are AVs", rank_of["few_pairs"], shares,
         f"In {shares:,} {among} A and B have different shares of AVs, so numbers of AVs and of "
         "others are of different vehicles.", "Compare those of all vehicles (--full)."),
        ("common_pairs", "A − B over common pairs", rank_of["left_out"], cut,
         f"In {cut:,} {among} A − B is over the pairs that count in both cells, and a cell's own "
         "number over all that count in it, so A − B may differ from them.", ""),
        ("equal_rows", "equal in every pair", rank_of["equal"], equal,
         f"In {equal:,} {among} A − B is the same in every pair, so it has no interval.", ""),
    )  # fmt: skip
    return [
        Note(key, rank, label, first, more)
        for key, label, rank, holds, first, more in said
        if holds
    ]
