"""Compares strategies pair by pair: cells of one run or of several that differ only in the AV."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from harness.core.errors import InputError
from harness.core.seeding import resampling
from harness.results import estimators
from harness.results.catalogue import ENTRIES, ENTRY_OF, Entry
from harness.results.columns import AV, REFERENCE, Sample
from harness.results.estimators import EQUAL, FEW, Sampling
from harness.results.finding import Finding, Form, Plain
from harness.results.findings import CellFindings
from harness.results.notes import Note, name_of, notes_of, rank_of
from harness.results.result import Column, Entered, Result, Shown, Style, Table, Versus
from harness.results.run import Run
from harness.results.screens import drivers, leaves_out, scope_of, shown, table_of
from harness.scenario import Scenario, as_written, flatten
from harness.scenario.place import place_in_words
from harness.strategies.parameters import parameters_of
from harness.strategies.registry import STRATEGIES
from harness.studies.allowed import allowed_tables

MOST_ROWS = 40
"""Rows of the first screen; JSON, CSV and ``--full`` have all."""

_SAME = 1e-9
_OF_THE_REFERENCE = ("steps", "pedestrians", "pass_time_s", "pedestrian_delay_s")
"""Columns that are equal if the reference met the same people and drove alike."""

SIGNIFICANT = 0.05


class Difference(NamedTuple):
    """A number of cell A minus that of cell B over their common pairs.

    ``reliable_from`` is the least number of pairs that differ for a reliable interval; 0: exact.
    """

    key: str
    heading: str
    style: Style
    reliable_from: int
    of: Callable[[Sample, Sample, Sampling], Finding]


def _time_ratio(a: Sample, b: Sample, sampling: Sampling) -> Finding:
    (a_s, reference_s), (b_s, _) = a.arms("counted_time_s"), b.arms("counted_time_s")
    return estimators.ratio_difference(a_s, b_s, reference_s, sampling)


def _mean(column: str) -> Callable[[Sample, Sample, Sampling], Finding]:
    def of(a: Sample, b: Sample, sampling: Sampling) -> Finding:
        return estimators.mean_difference(a.arms(column)[AV], b.arms(column)[AV], sampling)

    return of


def _mu(a: Sample, b: Sample, sampling: Sampling) -> Finding:
    return estimators.mean_difference(a.pairs("tau"), b.pairs("tau"), sampling)


def _share(column: str, ran: str) -> Callable[[Sample, Sample, Sampling], Finding]:
    def of(a: Sample, b: Sample, _sampling: Sampling) -> Finding:
        marked_a, marked_b = a.arms(column)[AV], b.arms(column)[AV]
        return estimators.share_difference(marked_a, marked_b, a.arms(ran)[AV], b.arms(ran)[AV])

    return of


_SHARE = Style(Form.SHARE, 1)
DIFFERENCES = (
    Difference("time_ratio_difference", "ratio of times", Style(digits=3), 500, _time_ratio),
    Difference("mu_difference", "μ", Style(digits=3), 500, _mu),
    Difference("delay_difference_s", "delay, s", Style(), 500, _mean("delay_s")),
    Difference(
        "delay_worst_difference_s", "delay, worst case, s", Style(), 1_000, _mean("worst_delay_s")
    ),
    Difference("kappa_difference", "crashes", _SHARE, 0, _share("crashed", "ran")),
    Difference(
        "kappa_all_difference", "crashes, time-outs, failures", _SHARE, 0, _share("missed", "tried")
    ),
)
"""What is compared; a test of each has one family (Holm) over all rows of the table."""


@dataclass(frozen=True)
class Candidate:
    """A cell as one of several strategies that met the same people.

    ``label`` tells it from the others of its group; ``shared`` are the swept keys of the group, and
    ``own`` those of its AV but for the strategy.
    """

    run: Run
    cell: CellFindings
    label: str
    shared: Mapping[str, Plain]
    own: tuple[str, ...]

    @property
    def name(self) -> str:
        """Its name among the cells of all groups."""
        group = name_of(self.shared)
        return ", ".join(filter(None, [group, self.label]))

    def sample(self, pairs: int) -> Sample:
        """The columns of its first pairs, without intervals of its own."""
        rows = self.run.rows("episodes", self.cell.number).slice(0, 2 * pairs)
        return Sample(rows, self.cell.scenario, 0.0)


def compare(*runs: Run, mu0: float | None = None, kappa0: float | None = None) -> Result:
    """Compare every two cells that differ only in the AV's strategy, parameters or equipment.

    Args:
        runs: finished runs of encounters: one with several cells, or several of the same people.
        mu0, kappa0: the paper's limits of μ (above 0) and κ (above 0, at most 1); with both, the
            values of a swept parameter are judged.

    Raises:
        InputError: a run is not finished or is named twice, no two cells can be compared, a limit
            is out of range, or the reference met other people in one of the runs.
    """
    for number, run in enumerate(runs):
        if not run.finished:
            raise InputError(str(run.path), "is not finished", "a finished run")
        if run.path.resolve() in [other.path.resolve() for other in runs[:number]]:
            raise InputError(str(run.path), "is named twice", "different runs")
    groups = groups_of(runs)
    compared = [group for group in groups if len(group) > 1]
    if not compared:
        raise _nothing_to_compare(runs)
    for group in compared:
        _refuse_other_people(group)
    confidence = max(run.confidence for run in runs)
    rows = [
        (a, b, _differences(a, b, confidence))
        for group in compared
        for a, b in combinations(group, 2)
    ]
    adjusted = {
        of.key: estimators.holm(
            [1.0 if (p := found[of.key].p) is None else p for *_, found in rows]
        )
        for of in DIFFERENCES
    }
    candidates = [candidate for group in compared for candidate in group]
    members = [candidate.cell for candidate in candidates]
    first = runs[0]
    facts = {"seed": first.manifest["seed"], "confidence": confidence}
    done = sum(cell["pairs"].count for cell in members)
    shown_rows = rows[:MOST_ROWS]
    extra = len(rows) - len(shown_rows)
    return Result(
        command="compare",
        title=f"{first.name}: {len(rows):,} comparison{'s' * (len(rows) != 1)}, pair by pair, of "
        f"{drivers(members)}",
        scope=f"{scope_of(members, done, facts)}; p by Holm over the table",
        about=place_in_words([cell.scenario for cell in members]),
        screen=_screen(shown_rows, adjusted["time_ratio_difference"]),
        full=(
            *(_table_of(of, rows, adjusted[of.key]) for of in DIFFERENCES),
            *allowed_tables(compared, mu0, kappa0, confidence),
        ),
        notes=notes_of(
            members,
            [*_crash_notes(rows, adjusted), *_notes_on_intervals(rows)],
            [candidate.name for candidate in candidates],
        ),
        closing=tuple([f"{extra:,} more rows: --full."] * (extra > 0)),
        facts=facts,
        records=[
            {
                **a.shared,
                "a": a.label,
                "b": b.label,
                **{f"{key}_a": a.cell[key] for key in ("time_ratio", "kappa")},
                **{f"{key}_b": b.cell[key] for key in ("time_ratio", "kappa")},
                **found,
                **{f"{of.key}_p_holm": adjusted[of.key][row] for of in DIFFERENCES},
            }
            for row, (a, b, found) in enumerate(rows)
        ],
    )


def groups_of(runs: Sequence[Run]) -> list[list[Candidate]]:
    """The cells that differ only in the AV, in groups, in the order of their first cells."""
    members: dict[str, list[tuple[Run, CellFindings]]] = {}
    for run in runs:
        for cell in run.cells:
            members.setdefault(_frozen(without_av(cell.scenario)), []).append((run, cell))
    return [_group(cells, several=len(runs) > 1) for cells in members.values()]


def without_av(scenario: Scenario) -> dict[str, Any]:
    """What two cells must share to be compared pair by pair.

    The AV's strategy, its parameters, and perception and actuation that the reference does not have
    are left out, and so are the thresholds of conflicts.
    """
    human = scenario.arms.human
    tree = scenario.model_dump(exclude={"conflicts": True, "arms": {"av"}})
    del tree["experiment"]["pairs"], tree["experiment"]["decide_limit_s"]
    for equipment in ("perception", "actuation"):
        if not tree[equipment]["human"]:
            del tree[equipment]
    tree["strategies"] = {human: _parameters(scenario, human)}
    return tree


def _parameters(scenario: Scenario, strategy: str) -> dict[str, Any]:
    """A strategy's parameters; of a shipped one with its defaults, so that no user code runs."""
    given = dict(scenario.strategies.get(strategy, {}))
    if strategy not in STRATEGIES:
        return given
    return {item.name: item.default for item in parameters_of(STRATEGIES[strategy])} | given


def _of_av(scenario: Scenario) -> dict[str, Any]:
    """The AV's strategy, parameters and equipment by dotted key."""
    av = scenario.arms.av
    equipment = scenario.model_dump(include={"perception", "actuation"})
    own = flatten({"strategies": {av: _parameters(scenario, av)}, **equipment})
    return {"arms.av": av, **own}


def _group(cells: Sequence[tuple[Run, CellFindings]], *, several: bool) -> list[Candidate]:
    distinct: dict[str, tuple[Run, CellFindings, dict[str, Any]]] = {}
    for run, cell in cells:
        own = _of_av(cell.scenario)
        distinct.setdefault(_frozen([str(run.path), own]), (run, cell, own))
    found = []
    for run, cell, own in distinct.values():
        alike = [other for *_, other in distinct.values() if other["arms.av"] == own["arms.av"]]
        varied = [key for key in own if len({_frozen(other.get(key)) for other in alike}) > 1]
        swept = [key for key in cell.varied if key in own and key != "arms.av"]
        told = dict.fromkeys([*varied, *swept])
        words = [f"{key.rpartition('.')[2]}={as_written(own[key])}" for key in told]
        label = " ".join([own["arms.av"], *words, *([f"({run.path.name})"] if several else [])])
        shared = {key: value for key, value in cell.varied.items() if key not in _of_any(distinct)}
        found.append(Candidate(run, cell, label, shared, tuple(swept)))
    return found


def _of_any(distinct: Mapping[str, tuple[Run, CellFindings, dict[str, Any]]]) -> set[str]:
    """The keys of the AVs of a group."""
    return {key for *_, own in distinct.values() for key in own}


def _frozen(value: object) -> str:
    return json.dumps(value, sort_keys=True, default=str)


def _refuse_other_people(group: Sequence[Candidate]) -> None:
    """Refuse cells of several runs whose references differ, which the AV cannot cause."""
    first, *others = group
    for other in others:
        if other.run.path == first.run.path:
            continue
        pairs = _common(first, other)
        a, b = first.sample(pairs), other.sample(pairs)
        endings = (np.array(sample.words("ending")[REFERENCE]) for sample in (a, b))
        same = np.equal(*endings)
        for name in _OF_THE_REFERENCE:
            x, y = a.arms(name)[REFERENCE], b.arms(name)[REFERENCE]
            same &= np.isclose(x, y, rtol=_SAME, atol=_SAME, equal_nan=True)
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


def _common(a: Candidate, b: Candidate) -> int:
    """The number of pairs that both cells have: entry i of each is pair i."""
    return min(a.cell["pairs"].count, b.cell["pairs"].count)


def _differences(a: Candidate, b: Candidate, confidence: float) -> dict[str, Finding]:
    pairs = _common(a, b)
    samples = a.sample(pairs), b.sample(pairs)
    seed = a.cell.scenario.experiment.seed
    found = {}
    for of in DIFFERENCES:
        finding = of.of(*samples, Sampling(resampling(seed, "comparison"), confidence))
        if finding.value is None:
            finding = replace(finding, reason="no pair counts in both")
        elif finding.low is not None and (finding.n or 0) < of.reliable_from:
            few = f"unreliable below {of.reliable_from:,} pairs that differ (has {finding.n:,})"
            finding = replace(finding, reliable=False, reason=few)
        found[of.key] = finding
    return found


_Row = tuple[Candidate, Candidate, dict[str, Finding]]


def _names(rows: Sequence[_Row]) -> list[tuple[Column, tuple[Entered, ...]]]:
    """The columns that name a row: the keys that the group shares, and the two strategies."""
    keys = dict.fromkeys(key for a, *_ in rows for key in a.shared)
    return [
        *(
            (Column(key, key.rpartition(".")[2]), tuple(a.shared.get(key) for a, *_ in rows))
            for key in keys
        ),
        (Column("a", "A"), tuple(a.label for a, *_ in rows)),
        (Column("b", "B"), tuple(b.label for _, b, _ in rows)),
    ]


def _screen(rows: Sequence[_Row], p_holm: Sequence[float]) -> Table:
    """The first screen: each cell's own number, their paired difference, and one p."""
    difference, style = "time_ratio_difference", DIFFERENCES[0].style
    columns = {
        Column("time_ratio", "ratio of times"): _both(ENTRY_OF["time_ratio"], rows),
        Column(difference, "A − B"): tuple(Shown(found[difference], style) for *_, found in rows),
        Column("p_holm", "p"): _p_values(p_holm[: len(rows)]),
        Column("kappa", "crashes"): _both(ENTRY_OF["kappa"], rows),
    }
    if leaves_out([each.cell for a, b, _ in rows for each in (a, b)]):
        for entry in (entry for entry in ENTRIES if entry.worst_case):
            columns[Column(entry.key, entry.heading)] = _both(entry, rows)
    legend = "Two numbers in a cell: A / B."
    return table_of("", [*_names(rows), *columns.items()], legend=legend)


def _both(entry: Entry, rows: Sequence[_Row]) -> tuple[Entered, ...]:
    return tuple(Versus(shown(entry, a.cell), shown(entry, b.cell)) for a, b, _ in rows)


def _p_values(values: Sequence[float]) -> tuple[Entered, ...]:
    return tuple(Shown(Finding(p), Style(digits=3)) for p in values)


def _table_of(of: Difference, rows: Sequence[_Row], p_holm: Sequence[float]) -> Table:
    found = [findings[of.key] for *_, findings in rows]
    columns = {
        Column(of.key, "A − B"): tuple(Shown(each, of.style) for each in found),
        Column("n", "pairs that differ"): tuple(
            each.n if each.events is None else each.events for each in found
        ),
        Column("p_holm", "p (Holm)"): _p_values(p_holm),
    }
    return table_of(f"Difference of {of.heading}", [*_names(rows), *columns.items()])


def _crash_notes(rows: Sequence[_Row], adjusted: Mapping[str, Sequence[float]]) -> list[Note]:
    """A note on strategies that crash, time out or fail significantly more often than another."""
    worse = []
    for row, (a, b, found) in enumerate(rows):
        value = found["kappa_all_difference"].value
        if value and adjusted["kappa_all_difference"][row] < SIGNIFICANT:
            worse.append((a.label, b.label) if value > 0 else (b.label, a.label))
    if not worse:
        return []
    more, less = worse[0]
    text = f"{more} crashes, times out or fails more often than {less}"
    text += f", and likewise in {len(worse) - 1:,} more rows." if len(worse) > 1 else "."
    return [Note("more_crashes", -2, "more crashes", text)]


def _notes_on_intervals(rows: Sequence[_Row]) -> list[Note]:
    """Notes on rows whose A − B has an unreliable interval, or none."""
    found, least = (
        [each["time_ratio_difference"] for *_, each in rows],
        DIFFERENCES[0].reliable_from,
    )
    few = [each.n or 0 for each in found if each.reliable is False or each.reason == FEW]
    equal, notes = sum(each.reason == EQUAL for each in found), []
    if few:
        text = (
            f"In {len(few):,} of {len(rows):,} rows too few pairs differ for a reliable interval "
        )
        text += f"of A − B: {least:,} are needed, the fewest here: {min(few):,}."
        notes.append(Note("few_differ", rank_of("few_pairs"), "few pairs differ", text))
    if equal:
        text = f"In {equal:,} of {len(rows):,} rows A − B is the same in every pair, so it has no "
        notes.append(
            Note("equal_rows", rank_of("equal"), "equal in every pair", f"{text}interval.")
        )
    return notes
