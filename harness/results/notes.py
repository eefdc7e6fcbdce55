"""The findings of cells in; notes out, which say what a reader of the numbers has to know.

These are notes on cells.  Those on a run as a whole are made where it is read, and those on
comparisons, risks, validations and fits where these are made.  README.md and docs/simulations.md
quote some notes.

To add a note, add a rule: it says a sentence about a cell from its findings and its scenario, or
None.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from harness.core.vocabulary import BY_SUMO, SPEED_ROUNDING
from harness.results.catalogue import Entry
from harness.results.cell_findings import CellFindings, on_first_screen
from harness.results.estimators import EQUAL, FEW, REPEATED
from harness.results.place import name_of
from harness.results.references import not_validated, opposite
from harness.results.student import RELIABLE_PAIRS
from harness.strategies.registry import fallback_of

GROWTH = 0.05
"""A road fills if its vehicles grow by more than this share of those who come."""

CHANCE, VARIANCE = 2.33, 2.5
"""Chance explains a growth up to the normal quantile of 1 %, if the growth's variance is at most
2.5 for each vehicle that comes: arrivals and departures vary."""

DECIDED, DRIVEN = 0.9, 0.97
"""A note says who drove below these shares of steps that the strategy decided, and of passages."""

FIRST = -10
"""The rank of a note that comes before those of all rules."""


class Note(NamedTuple):
    """Sentences without which the numbers mislead.

    Notes are ordered by ``rank``, the worst first, and at equal rank by ``weight``, the largest
    first.  A first screen has its ``first`` sentence; ``label`` stands for the note where it does
    not fit.  ``cells`` are the cells that it is about: of a run their numbers, of a comparison
    their names.
    """

    key: str
    rank: int
    label: str
    first: str
    more: str = ""
    cells: tuple[int | str, ...] = ()
    weight: float = 0.0

    @property
    def text(self) -> str:
        """All of it."""
        return f"{self.first} {self.more}" if self.more else self.first

    def to_dict(self) -> dict[str, Any]:
        """The note as JSON."""
        names = ("key", "rank", "label", "text", "cells", "weight")
        return {name: getattr(self, name) for name in names}


class Said(NamedTuple):
    """Sentences about a cell, the first of which must do alone on a first screen.

    Of several cells, those about the one of largest ``weight`` are shown.
    """

    first: str
    more: str = ""
    weight: float = 0.0


Say = Callable[[CellFindings], Iterable[Said]]
"""What is to be said about a cell; usually nothing."""


class Rule(NamedTuple):
    """What a note says of encounters and of simulations, if it is to be made; see ``Note``.

    A brace in a label has the weight.
    """

    key: str
    label: str
    say: Say | None
    simulated: Say | None = None


def _failures(cell: CellFindings) -> Iterator[Said]:
    if not (count := cell.total("failed")):
        return
    noun, more = "simulations", "Every number leaves their pairs out."
    if cell.kind == "encounters":
        noun = "episodes"
        more = "Times and crashes leave them out; the worst case counts them against the AV."
    what = f"{_by_arm(cell, 'failed')}; by the strategy {cell.total('failed_strategy'):,}"
    yield Said(f"{count:,} of {2 * cell['pairs'].count:,} {noun} failed ({what}).", more, count)


def _sumo_alone(cell: CellFindings) -> Iterator[Said]:
    if count := cell.total("sumo_alone"):
        text = f"SUMO alone reports {count:,} contacts ({_by_arm(cell, 'sumo_alone')})."
        yield Said(text, "They count nowhere: the harness, with other outlines, finds none.", count)


def _nothing_tested(cell: CellFindings) -> Iterator[Said]:
    if cell["kappa_met_someone"].n:
        return
    why, failed = "Neither driver met a pedestrian", cell["failed"].count
    if failed:
        every = failed == cell["pairs"].count
        why = f"Every {'episode of the AV' if every else 'pair that met a pedestrian'} failed"
    yield Said(f"{why}: nothing was tested.", weight=2 if failed else 1)


def _selected(cell: CellFindings) -> Iterator[Said]:
    if cell.scenario.pedestrians.drawn:
        yield Said("The pairs were selected by their outcome, so no number here is a frequency.")


def _few_pairs(cell: CellFindings) -> Iterator[Said]:
    """The numbers of the first screen whose intervals are unreliable or missing, and why."""
    pairs, doubted, few = cell["pairs"].count, dict[int, list[Entry]](), list[int]()
    sampled = not any(_repeated(cell))
    for entry in on_first_screen(cell):
        for found in (cell[key] for key in entry.keys):
            equal = found.reason == EQUAL and sampled and pairs < entry.estimate.reliable_from
            doubtful = equal or found.reliable is False or found.reason == FEW
            if doubtful and found.n is not None:
                doubted.setdefault(entry.estimate.reliable_from, []).append(entry)
                few.append(pairs if equal else found.n)
    if few:
        names = {n: _series([_name(one.heading) for one in each]) for n, each in doubted.items()}
        least = ", ".join(f"{number:,} ({names[number]})" for number in sorted(names))
        text = f"Too few informative pairs (fewest: {min(few):,}): intervals unreliable (*) or "
        spread = any(entry.key == "cv" for each in doubted.values() for entry in each)
        bias = " From few pairs c_v is too small on average." if spread else ""
        yield Said(f"{text}missing.", f"Needed: {least}.{bias}", -min(few))


def _opposite(cell: CellFindings) -> Iterator[Said]:
    ratio = cell["time_ratio"].value
    if ratio is not None and (text := opposite(cell.scenario, ratio)):
        yield Said(text)


def _left_out(cell: CellFindings) -> Iterator[Said]:
    pairs, used = cell["pairs"].count, cell["mu_pairs"].count
    endings = [
        f"{words} ({_by_arm(cell, key)})"
        for words, key in (("crashes", "kappa"), ("time-outs", "timed_out"), ("failures", "failed"))
        if cell.total(key)
    ]
    if used < pairs:
        text = f"The ratio of times uses {pairs - cell['not_in_time_ratio'].count:,} of {pairs:,} "
        text += f"pairs, μ and c_v use {used:,}."
        yield Said(text, f"The others had {_series(endings)}.", pairs - used)


def _fallback(cell: CellFindings) -> Iterator[Said]:
    parts, weight, arms = [], 0.0, cell.scenario.arms
    for arm, strategy, end in (("AV", arms.av, ""), ("reference", arms.human, "_human")):
        if not (count := cell[f"fallbacks{end}"].value):
            continue
        pairs = cell["pairs" if cell.kind == "encounters" else f"driven{end}"].count
        share = cell[f"fallback_share{end}"].value
        met = "" if share is None else f" ({100 * share:.3g} % of those that met someone)"
        parts.append(f"{fallback_of(strategy)} drove in {count:,} of {pairs:,} {arm} passages{met}")
        weight = max(weight, 100 * count / pairs, 0.0 if share is None else 100 * share)
    if parts:
        more = "The scenario's strategy had no valid plan there."
        yield Said(f"{'; '.join(parts)}.", more, weight)


def _outside_the_model(cell: CellFindings) -> Iterator[Said]:
    shares = [(float(s), who) for who, end in cell.arms if (s := cell[f"clamped_share{end}"].value)]
    if shares:
        used = " and ".join(f"{100 * part:.3g} % ({who})" for part, who in shares)
        more = "It answered as for the nearest vehicle in its data."
        yield Said(f"The model was outside its data in {used} of its uses.", more, max(shares)[0])


def _not_validated(cell: CellFindings) -> Iterator[Said]:
    if sentences := not_validated(cell.scenario):
        yield Said(*sentences)


def _model_fit(cell: CellFindings) -> Iterator[Said]:
    uses = (cell[f"clamped_share{end}"].value for _, end in cell.arms)  # undefined without a use
    if cell.scenario.walks_by_model or any(share is not None for share in uses):
        text = "The error of the model's fit is in no interval, and may be larger."
        yield Said(text, "Compare several models: --vary model.path=….")


def _speeding(cell: CellFindings) -> Iterator[Said]:
    limit_mps = cell.scenario.speed_limit_mps
    speeds = [(cell[f"max_speed_mps{end}"].value, who) for who, end in cell.arms]
    known = [(speed, who) for speed, who in speeds if speed is not None]
    fastest, who = max(known, default=(0.0, ""))
    if fastest > limit_mps * (1 + SPEED_ROUNDING):
        text = f"The {who} drove at up to {fastest:.3g} m/s, above the limit of {limit_mps:g} m/s."
        yield Said(text, weight=fastest - limit_mps)


def _repeated(cell: CellFindings) -> Iterator[Said]:
    if names := [who for who, end in cell.arms if cell[f"kappa{end}"].reason == REPEATED]:
        text = f"All {cell['pairs'].count:,} episodes are equal ({_series(names)})."
        yield Said(text, "More pairs add nothing, and shares have no interval.", len(names))


def _equal(cell: CellFindings) -> Iterator[Said]:
    names, ends = [], (*cell.arms, ("difference", "_difference"))
    for entry in on_first_screen(cell):
        own = ends[: len(entry.keys)]
        if who := [who for who, end in own if cell[f"{entry.key}{end}"].reason == EQUAL]:
            whose = f" ({_series(who)})" if len(own) > 1 else ""
            names.append(_name(entry.heading) + whose)
    if names:
        text = f"The same in every pair, so without an interval: {_series(names)}."
        yield Said(text, weight=len(names))


def _nobody_met(cell: CellFindings) -> Iterator[Said]:
    if cell["avs"].value is None:
        yield Said("A simulation of every pair failed: nothing was tested.")
    elif not cell["avs"].value:
        yield Said("No vehicle was an AV: nothing was tested.")
    elif cell["fallback_share"].value is None:  # a share of those that met somebody
        yield Said("No AV that a strategy drove met a pedestrian: nothing was tested.")


def _collisions(cell: CellFindings) -> Iterator[Said]:
    keys = ("vehicle_collisions", "teleports", "emergency_stops", "overlaps")
    known = [key for key in keys if cell[key].value is not None]
    more = {key: cell[key].count - cell[f"{key}_human"].count for key in known}
    named = (f"{key.replace('_', ' ')} ({_by_arm(cell, key)})" for key in known if more[key] > 0)
    if parts := [*named]:
        text = f"More than with the reference: {_series(parts)}."
        yield Said(text, weight=sum(more.values()))


def _few_simulations(cell: CellFindings) -> Iterator[Said]:
    """The fewest pairs on which a delay or wait of the first screen rests, or shares in doubt."""
    keys = ("av_delay_s", "other_delay_s", "vehicles_delay_s", "people_wait_s", "people_delay_s")
    ran = min((n for key in keys if (n := cell[f"{key}_difference"].n)), default=RELIABLE_PAIRS)
    if ran < RELIABLE_PAIRS:
        rests = f"intervals rest on {ran:,} or more" if ran > 1 else "a number rests on one pair"
        yield Said(f"Few pairs: {rests}.", f"Reliable from {RELIABLE_PAIRS} pairs on.", -ran)
    elif any(cell[key].reliable is False for each in on_first_screen(cell) for key in each.keys):
        least = f"Reliable from {RELIABLE_PAIRS} pairs with the event and as many without it."
        yield Said("Intervals of shares that few pairs decide are unreliable (*).", least, -ran)


def _cut_off(cell: CellFindings) -> Iterator[Said]:
    yield from _counted(cell, {
        "cut_off": "Delays leave out passages that did not end",
        "still_crossing": "People's delays leave out those still crossing at the end",
        "never_went": "People who never went count with their wait until the end",
        "people_left_out": "People seen too briefly are in no number",
    })  # fmt: skip


def _who_drove(cell: CellFindings) -> Iterator[Said]:
    share, by_sumo = cell["share_strategy"].value, [cell[f"share_{each}"].value for each in BY_SUMO]
    driven, among = cell["driven"], cell["driven"].n
    decided = share is None or share > DECIDED
    if not among or (decided and driven.count > DRIVEN * among):
        return
    of_sumo = 1.0 if share is None else sum(each for each in by_sumo if each is not None)
    steps = f"SUMO decided {100 * of_sumo:.0f} % of {cell.scenario.arms.av}'s steps."
    said = [] if share is None else [steps]
    if left := among - driven.count:
        said.append(f"Left to SUMO: {left:,} of {among:,} passages: {cell['not_driven'].reason}.")
    yield Said(said[0], " ".join(said[1:]), of_sumo)


def _fills(cell: CellFindings) -> Iterator[Said]:
    """The number of vehicles grows by more than chance explains (docs/method.md)."""
    growth = {}
    for who, end in cell.arms:
        share, due = cell[f"growth{end}"].value, cell[f"vehicles{end}"].value
        if share and due and share > max(GROWTH, CHANCE * math.sqrt(3 * VARIANCE / max(due, 3))):
            growth[f"{100 * share:.0f} % of those due in a third of the time ({who})"] = share
    if growth:
        text = f"The roads fill: the number of vehicles grows by {_series([*growth])}."
        more = "A longer simulation would have longer delays."
        yield Said(text, more, max(growth.values()))
        return
    late = "Trips last longer than a third of the time, so it is not known whether roads fill"
    jam = "A jam: SUMO teleported vehicles"
    yield from _counted(cell, {"teleports": jam, "long_trips": late})


def _people_of_sumo(cell: CellFindings) -> Iterator[Said]:
    if count := cell.total("sumo_people"):
        text = "SUMO's people without priority wait until the car stands, so slowing down does "
        text += "nothing for them; those with priority do not look."
        yield Said(text, "A strategy knows who will cross and sees nobody who only passes.", count)


RULES: tuple[Rule, ...] = (
    Rule("failures", "failures", _failures, _failures),
    Rule("nothing_tested", "nothing tested", _nothing_tested, _nobody_met),
    Rule("sumo_alone", "contacts that SUMO alone reports", _sumo_alone, _sumo_alone),
    Rule("selected", "selected pairs", _selected),
    Rule("few_pairs", "few pairs", _few_pairs, _few_simulations),
    Rule("opposite", "another reference disagrees", _opposite),
    Rule("collisions", "collisions of vehicles", None, _collisions),
    Rule("fills", "roads fill", None, _fills),
    Rule("who_drove", "SUMO drove", None, _who_drove),
    Rule("people_of_sumo", "SUMO's people", None, _people_of_sumo),
    Rule("fallback", "another strategy drove (up to {:.3g} %)", _fallback, _fallback),
    Rule("left_out", "left out", _left_out, _cut_off),
    Rule("outside_model", "outside the model's data", _outside_the_model, _outside_the_model),
    Rule("not_validated", "reference not validated", _not_validated, _not_validated),
    Rule("model_fit", "model fit", _model_fit, _model_fit),
    Rule("speeding", "speeding", _speeding),
    Rule("repeated", "repeated episodes", _repeated),
    Rule("equal", "equal", _equal, _equal),
)
"""The rules, the worst news first; notes about a run as a whole come before them."""


def notes_of(
    cells: Sequence[CellFindings], about_run: Sequence[Note] = (), names: Sequence[str] = ()
) -> tuple[Note, ...]:
    """The notes of a run, the worst first: one for each rule, about the cell that it concerns most.

    Args:
        cells: the findings of all cells.
        about_run: notes about the run as a whole.
        names: the cells' names if they are compared; then notes have them in place of numbers.
    """
    notes, called = list(about_run), names or [name_of(cell.varied) for cell in cells]
    for rank, rule in enumerate(RULES):
        say = rule.simulated if cells and cells[0].kind == "simulations" else rule.say
        by_cell = enumerate(map(say, cells) if say else ())
        told = [(place, said) for place, each in by_cell for said in each]
        if not told:
            continue
        worst, (first, more, weight) = max(told, key=lambda each: each[1].weight)
        alike, others = len({said[:2] for _, said in told}) == 1, len(told) - 1
        if len(cells) > 1 and not (alike and others):
            first = f"{called[worst]}: {first}"
        if others:
            same = "likewise" if alike else "similar"
            cell = "cell" if others == 1 else "cells"
            first = f"{first.removesuffix('.')} ({same} in {others:,} more {cell})."
        about = tuple(names[place] if names else cells[place].number for place, _ in told)
        label = rule.label.format(weight)
        notes.append(Note(rule.key, rank, label, first, more, about, weight))
    return tuple(sorted(notes, key=lambda note: (note.rank, -note.weight)))


def retries(again: int | None) -> list[Note]:
    """The note that so many tasks ran again because their process had died; None: unknown."""
    number = f"{again:,} in log.jsonl" if again else "unknown how many, if any: no whole log.jsonl"
    text = f"Tasks whose process had died were tried again ({number})."
    return [] if again == 0 else [Note("tried_again", len(RULES), "tried again", text)]


def _counted(cell: CellFindings, sentences: Mapping[str, str]) -> Iterator[Said]:
    """The sentences, by key, on counts above 0; the first of these counts is the weight."""
    keys = [key for key in sentences if cell.total(key)]
    said = [f"{sentences[key]} ({_by_arm(cell, key)})." for key in keys]
    if keys:
        yield Said(said[0], " ".join(said[1:]), cell.total(keys[0]))


def _by_arm(cell: CellFindings, key: str) -> str:
    """The count of each arm in words."""
    return ", ".join(f"{who} {cell[f'{key}{end}'].count:,}" for who, end in cell.arms)


def _name(heading: str) -> str:
    """A heading without its unit and explanation."""
    return heading.partition(", ")[0].partition(" {")[0]


def _series(names: Sequence[str]) -> str:
    """The distinct names as ``a, b and c``."""
    *first, last = dict.fromkeys(names)
    return f"{', '.join(first)} and {last}" if first else last
