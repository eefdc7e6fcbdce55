"""The verdicts on limits, and which limit binds: sentences, tables and JSON."""

from collections.abc import Iterable, Mapping, Sequence

from harness.report.screens.tables import Table, TableCell, level, sort_key
from harness.statistics import RunFindings
from harness.statistics.limits import JudgedLimit, Shown, binding
from harness.studies.runs.comparisons import GroupResult

OWN_BOUND = f"each by its own one-sided {level(0.95)} bound"

_NAMED = 8
"""Maximum number of cells that a sentence names for each verdict or limit."""

Document = Mapping[str, object]

Judged = tuple[str, Sequence[JudgedLimit]]
"""The number of a cell, or the name of an AV, with its limits."""


def judged_cells(run: RunFindings) -> list[Judged]:
    """Return the limits of each cell, or of each AV of a comparison between AVs."""
    if run.between_avs:
        return list(run.under_limits.items())
    return [(str(cell.cell), cell.limits) for cell in run.cells if cell.limits]


def limit_lines(run: RunFindings) -> list[str]:
    """Return sentences about the limits of a run's cells; empty if there are none."""
    limited = judged_cells(run)
    if not limited:
        return []
    if len(run.cells) == 1 and not run.between_avs:
        limits = limited[0][1]
        texts = "; ".join(map(judged_words, limits))
        binds = binding(limits)
        end = f" Binding: {binds.limit}." if binds is not None and len(limits) > 1 else ""
        return [f"Limits, {OWN_BOUND}: {texts}.{end}"]
    names = ", ".join(dict.fromkeys(str(each.limit) for _, limits in limited for each in limits))
    word = "" if run.between_avs else "cell"
    verdicts, binds_in = _by_verdict(limited, word), _by_limit(limited, word)
    return [f"Limits {names}, {OWN_BOUND}: {verdicts}. {binds_in}"]


def judged_words(each: JudgedLimit) -> str:
    """Return a limit with its verdict, bound and margin.

    >>> from harness.statistics import Finding
    >>> from harness.statistics.limits import Limit, judged
    >>> judged_words(judged(Limit("kappa", 0.01, above=False), Finding(0.0, 0.0, 0.03)))
    'kappa<0.01 not shown (bound 0.03, 200 % above the limit; too few pairs)'
    """
    parts = [*([_bound(each)] if each.bound is not None else []), each.reason]
    more = "; ".join(filter(None, parts))
    return f"{each.limit} {each.shown.value}" + (f" ({more})" if more else "")


def _bound(each: JudgedLimit) -> str:
    text, margin = f"bound {each.bound:.3g}", each.margin
    if margin is None:
        return text
    side, percent = "above" if (margin > 0) is each.limit.above else "below", 100 * abs(margin)
    shown = f"{percent:,.0f}" if percent >= 1000 else f"{percent:.3g}"
    return f"{text}, {shown} % {side} the limit"


def _by_verdict(cells: Sequence[Judged], word: str) -> str:
    """Return which cells satisfy all limits, violate one, or show neither."""
    worst = [(name, binds.shown) for name, binds in _binding(cells)]
    found = [(shown, [name for name, of in worst if of is shown]) for shown in Shown]
    words = {Shown.SATISFIED: "all satisfied", Shown.VIOLATED: "one violated"}
    return "; ".join(
        f"{words.get(shown, shown.value)} in {_named(names, word)}"
        for shown, names in found
        if names
    )


def _by_limit(cells: Sequence[Judged], word: str) -> str:
    """Return which limit binds in which cells."""
    found: dict[str, list[str]] = {}
    for name, binds in _binding(cells):
        found.setdefault(str(binds.limit), []).append(name)
    return f"Binding: {'; '.join(f'{of} in {_named(at, word)}' for of, at in found.items())}."


def _binding(cells: Iterable[Judged]) -> list[tuple[str, JudgedLimit]]:
    found = ((name, binding(limits)) for name, limits in cells)
    return [(name, binds) for name, binds in found if binds is not None]


def _named(names: Sequence[str], word: str) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    before = f"{word}{'s' * (len(names) > 1)} " if word else ""
    return f"{before}{', '.join(names[:_NAMED])}{more}"


def binding_words(result: GroupResult) -> str:
    """Return which limit binds the choice of a group's best allowed cell, or binds each cell."""
    numbers = [str(cell.number) for cell in result.group.cells]
    best, stopped = result.best_allowed, result.stopped
    if best is None:
        return _by_limit(list(zip(numbers, result.limits, strict=True)), "cell")
    if stopped is None:
        binds = binding(result.limits[best])
        nearest = "" if binds is None else f" Its nearest limit: {judged_words(binds)}."
        return f"No limit binds the choice: no cell has a smaller ratio.{nearest}"
    binds = binding(result.limits[stopped])
    assert binds is not None
    return (
        f"Binding: {binds.limit}; it keeps out cell {numbers[stopped]}, which has the next smaller "
        f"ratio: {judged_words(binds)}."
    )


def limits_table(
    cells: Sequence[Judged], name: str, caption: str, heading: str = "cell"
) -> list[Table]:
    """Return a table with a row for each cell and limit; no table if there are no limits."""
    rows = []
    for of, limits in cells:
        binds = binding(limits)
        for each in limits:
            rows.append(
                (
                    TableCell(of, sort=of if of.isdecimal() else None),
                    TableCell(str(each.limit)),
                    _number(each.finding.number),
                    _number(each.bound),
                    TableCell(each.shown.value),
                    _number(None if each.margin is None else 100 * each.margin),
                    TableCell("yes" if each is binds else ""),
                    TableCell(each.reason),
                )
            )
    headings = (heading, "limit", "value", "bound", "verdict", "margin, %", "binds", "remark")
    return [Table(name, caption, headings, tuple(rows), sortable=True)] if rows else []


def _number(value: float | None) -> TableCell:
    return TableCell("–" if value is None else f"{value:.4g}", sort=sort_key(value))


def limits_document(limits: Sequence[JudgedLimit]) -> Document:
    """Return the limits of a cell and the one that binds, for JSON; empty without limits."""
    binds = binding(limits)
    if binds is None:
        return {}
    entries = [
        {
            "limit": str(each.limit),
            "value": each.finding.number,
            "bound": each.bound,
            "verdict": each.shown.value,
            "margin": each.margin,
            "reason": each.reason,
        }
        for each in limits
    ]
    return {"limits": entries, "binding": str(binds.limit)}
