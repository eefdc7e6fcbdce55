"""The verdicts on limits, and which limit binds: sentences, tables and JSON."""

from collections.abc import Iterable, Mapping, Sequence

from harness.report.screens.tables import Table, TableCell, level, sort_key
from harness.statistics import CellFindings
from harness.statistics.limits import JudgedLimit, Shown, binding
from harness.studies.runs.comparisons import GroupResult

OWN_BOUND = f"each by its own one-sided {level(0.95)} bound"

_NAMED = 8
"""Maximum number of cells that a sentence names for each verdict or limit."""

Document = Mapping[str, object]


def limit_lines(cells: Sequence[CellFindings]) -> list[str]:
    """Return sentences about the limits of a run's cells; empty if there are none."""
    limited = [cell for cell in cells if cell.limits]
    if not limited:
        return []
    if len(cells) == 1:
        texts = "; ".join(map(judged_words, limited[0].limits))
        binds = binding(limited[0].limits)
        several = len(limited[0].limits) > 1
        end = f" Binding: {binds.limit}." if binds is not None and several else ""
        return [f"Limits, {OWN_BOUND}: {texts}.{end}"]
    names = dict.fromkeys(str(each.limit) for cell in limited for each in cell.limits)
    judged = [(cell.cell, cell.limits) for cell in limited]
    return [f"Limits {', '.join(names)}, {OWN_BOUND}: {_by_verdict(judged)}. {_by_limit(judged)}"]


def judged_words(each: JudgedLimit) -> str:
    """Return a limit with its verdict, bound and margin.

    >>> from harness.statistics import Finding
    >>> from harness.statistics.limits import Limit, judged
    >>> judged_words(judged(Limit("kappa", 0.01, above=False), Finding(0.0, 0.0, 0.03)))
    'kappa<0.01 not shown (bound 0.03, 200 % beyond the limit; too few pairs)'
    """
    parts = [*([_bound(each)] if each.bound is not None else []), each.reason]
    more = "; ".join(filter(None, parts))
    return f"{each.limit} {each.shown.value}" + (f" ({more})" if more else "")


def _bound(each: JudgedLimit) -> str:
    text, margin = f"bound {each.bound:.3g}", each.margin
    if margin is None:
        return text
    side = "inside" if margin > 0 else "beyond"
    return f"{text}, {100 * abs(margin):.3g} % {side} the limit"


def _by_verdict(cells: Sequence[tuple[int, Sequence[JudgedLimit]]]) -> str:
    """Return which cells satisfy all limits, violate one, or show neither."""
    worst = [(number, binds.shown) for number, binds in _binding(cells)]
    found = [(shown, [number for number, of in worst if of is shown]) for shown in Shown]
    words = {Shown.SATISFIED: "all satisfied", Shown.VIOLATED: "one violated"}
    return "; ".join(
        f"{words.get(shown, shown.value)} in {_named(numbers)}"
        for shown, numbers in found
        if numbers
    )


def _by_limit(cells: Sequence[tuple[int, Sequence[JudgedLimit]]]) -> str:
    """Return which limit binds in which cells."""
    found: dict[str, list[int]] = {}
    for number, binds in _binding(cells):
        found.setdefault(str(binds.limit), []).append(number)
    return f"Binding: {'; '.join(f'{of} in {_named(at)}' for of, at in found.items())}."


def _binding(
    cells: Iterable[tuple[int, Sequence[JudgedLimit]]],
) -> list[tuple[int, JudgedLimit]]:
    found = ((number, binding(limits)) for number, limits in cells)
    return [(number, binds) for number, binds in found if binds is not None]


def _named(numbers: Sequence[int]) -> str:
    more = f" and {len(numbers) - _NAMED} more" if len(numbers) > _NAMED else ""
    return f"cell{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers[:_NAMED]))}{more}"


def binding_words(result: GroupResult) -> str:
    """Return which limit binds the choice of a group's best allowed cell, or binds each cell."""
    numbers = [cell.number for cell in result.group.cells]
    best, stopped = result.best_allowed, result.stopped
    if best is None:
        return _by_limit(list(zip(numbers, result.limits, strict=True)))
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
    cells: Sequence[tuple[int, Sequence[JudgedLimit]]], name: str, caption: str
) -> list[Table]:
    """Return a table with a row for each cell and limit; no table if there are no limits."""
    rows = []
    for number, limits in cells:
        binds = binding(limits)
        for each in limits:
            rows.append(
                (
                    TableCell(str(number), sort=str(number)),
                    TableCell(str(each.limit)),
                    _number(each.finding.number),
                    _number(each.bound),
                    TableCell(each.shown.value),
                    _number(None if each.margin is None else 100 * each.margin),
                    TableCell("yes" if each is binds else ""),
                    TableCell(each.reason),
                )
            )
    headings = ("cell", "limit", "value", "bound", "verdict", "margin, %", "binds", "remark")
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
