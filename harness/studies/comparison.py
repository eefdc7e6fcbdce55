"""Compares strategies pair by pair: cells of one run or of several that differ only in the AV."""

from collections.abc import Mapping, Sequence
from itertools import combinations

from harness.core.errors import checked
from harness.core.seeding import resampling
from harness.results.catalogue import ENTRY_OF, Entry
from harness.results.cell_findings import worst_cases
from harness.results.cell_tables import as_shown, drivers, scope_of, table_of
from harness.results.estimators import EQUAL, FEW, Sampling
from harness.results.finding import Finding, Plain, Style
from harness.results.loaded_run import Run, older_code
from harness.results.notes import RULES, Note, notes_of
from harness.results.place import place_in_words
from harness.results.result import Column, Entered, Result, Shown, Table, Versus
from harness.results.student import RELIABLE_PAIRS
from harness.studies.allowed import allowed_in, allowed_table
from harness.studies.candidates import Candidate, common_pairs, comparable
from harness.studies.differences import COMPARED, Compared, ComparedPair, Difference, compared, holm

MOST_ROWS = 40
"""Rows of the first screen; JSON, CSV and ``--full`` have all."""

SIGNIFICANT = 0.05
"""A note says who crashes more often if the adjusted p is below it."""

_LEAST_P = 1e-9
"""A p of 0 is shown as this number, hence as < 0.001."""


_Column = tuple[Column, Sequence[Entered]]


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
    groups, alone = comparable(runs)
    kind = COMPARED[runs[0].kind]
    confidence = max(run.confidence for run in runs)
    # Every difference draws from one generator, which keeps its state, so they share resamples.
    sampling = Sampling(resampling(runs[0].manifest["seed"], "comparison"), confidence)
    rows = [compared(*two, sampling) for group in groups for two in combinations(group, 2)]
    p_holm = {of.key: holm([row.found[of.key].p for row in rows]) for of in kind.differences}
    candidates = [candidate for group in groups for candidate in group]
    cells = [candidate.cell for candidate in candidates]
    judged = allowed_in(groups, mu0, kappa0, confidence)
    facts: dict[str, Plain] = {"seed": runs[0].manifest["seed"], "confidence": confidence}
    facts |= {each.title: each.values for each in judged}
    more = len(rows) - MOST_ROWS
    partners = "; without a partner: " + ", ".join(each.name for each in alone) if alone else ""
    counted = "1 comparison" if len(rows) == 1 else f"{len(rows):,} comparisons"
    return Result(
        command="compare",
        title=f"{runs[0].name}: {counted}, pair by pair, of {drivers(cells)}",
        scope=f"{scope_of(cells, facts)}; p by Holm over the table{partners}",
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
                "pairs": common_pairs(row.a, row.b),
                **row.found,
                **{f"{key}_p_holm": values[place] for key, values in p_holm.items()},
            }
            for place, row in enumerate(rows)
        ],
    )


def _of_cell(side: str, candidate: Candidate, kind: Compared) -> dict[str, Plain | Finding]:
    """What a record says of one of its two cells."""
    said: dict[str, Plain | Finding] = {side: candidate.label}
    said |= {f"cell_{side}": candidate.cell.number, f"folder_{side}": str(candidate.run.path)}
    return said | {f"{key}_{side}": candidate.cell[key] for key in kind.shown}


def _apart(a: Candidate, b: Candidate) -> bool:
    """Whether two cells' own numbers of times may be of different pairs."""
    out = "not_in_time_ratio" if a.run.kind == "encounters" else "failed"
    pairs = {each.cell["pairs"].count for each in (a, b)}
    return len(pairs) > 1 or any(each.cell.total(out) for each in (a, b))


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
    return table_of(title, [(name, tuple(values)) for name, values in (*names, *columns)], legend)


def _screen(rows: Sequence[ComparedPair], p_holm: Sequence[float | None], kind: Compared) -> Table:
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
    rows: Sequence[ComparedPair], p_holm: Mapping[str, Sequence[float | None]], kind: Compared
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
