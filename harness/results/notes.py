"""Notes: the sentences without which the numbers mislead, the worst news first.

To add a note, add a rule: it says a sentence about a cell from its findings and its scenario, or
None.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from harness.core.encounter import SPEED_ROUNDING
from harness.results.catalogue import ENTRIES
from harness.results.estimators import EQUAL, FEW, REPEATED
from harness.results.finding import Plain
from harness.results.findings import CellFindings
from harness.scenario import as_written
from harness.strategies.references import not_validated, opposite
from harness.strategies.registry import fallback_of

MOSTLY = 0.5
"""From this share on, a fallback is said to have driven most passages."""


class Note(NamedTuple):
    """Sentences without which the numbers mislead.

    ``rank`` orders notes, the worst first; ``label`` stands for the note where it does not fit;
    ``cells`` are the cells that it is about: of a run their numbers, of a comparison their names.
    """

    key: str
    rank: int
    label: str
    text: str
    cells: tuple[int | str, ...] = ()

    @property
    def short(self) -> str:
        """The first sentence, which a first screen shows."""
        first, more, _ = self.text.partition(". ")
        return f"{first}." if more else first


class Said(NamedTuple):
    """Sentences about a cell, the first of which must do alone on a first screen.

    Of several cells, those about the one of largest ``weight`` are shown.
    """

    text: str
    weight: float = 0.0


class Rule(NamedTuple):
    """When a note is made, and what it says; see ``Note``."""

    key: str
    label: str
    say: Callable[[CellFindings], Said | None]


def _failures(cell: CellFindings) -> Said | None:
    av, human = cell["failed"].count, cell["failed_human"].count
    own = cell["failed_strategy"].count + cell["failed_strategy_human"].count
    text = (
        f"{av + human:,} of {2 * cell['pairs'].count:,} episodes failed (AV {av:,}, "
        f"{cell.scenario.arms.human} {human:,}; by the strategy {own:,}). Times and crashes leave "
        "them out, the worst case counts them against the AV."
    )
    return Said(text, av + human) if av + human else None


def _nothing_tested(cell: CellFindings) -> Said | None:
    if cell["kappa_met_someone"].n:
        return None
    if cell["failed"].count == cell["pairs"].count:
        return Said("Every episode of the AV failed: nothing was tested.", 2)
    if cell["failed"].count:
        return Said("Every pair that met a pedestrian failed: nothing was tested.", 2)
    return Said("Neither driver met a pedestrian: nothing was tested.", 1)


def _selected(cell: CellFindings) -> Said | None:
    if not cell.scenario.pedestrians.drawn:
        return None
    return Said("The pairs were selected by their outcome, so no number here is a frequency.")


def _few_pairs(cell: CellFindings) -> Said | None:
    names, few = dict[int, list[str]](), []
    for entry in (each for each in ENTRIES if each.screen):
        found = [cell[key] for key in entry.keys]
        if unsure := [each for each in found if each.reliable is False or each.reason == FEW]:
            names.setdefault(entry.reliable_from, []).append(entry.heading.partition(", ")[0])
            few += unsure
    if not few:
        return None
    fewest = min(finding.n or 0 for finding in few)
    missing = " or missing" if any(finding.low is None for finding in few) else ""
    first, *others = sorted(names)
    parts = [f"{first:,} informative pairs ({_listed(names[first])})"]
    parts += [f"{least:,} ({_listed(names[least])})" for least in others]
    text = f"Few informative pairs: intervals are unreliable (*){missing}; the fewest here: "
    return Said(f"{text}{fewest:,}. They are so below {', '.join(parts)}.", -fewest)


def _time_outs(cell: CellFindings) -> Said | None:
    av, human = cell["timed_out"].count, cell["timed_out_human"].count
    text = (
        f"{av + human:,} of {2 * cell['pairs'].count:,} episodes timed out (AV {av:,}, "
        f"{cell.scenario.arms.human} {human:,}). The times to cross and their ratio count them "
        f"with {cell.scenario.experiment.timeout_s:g} s, delays, μ and c_v leave them out."
    )
    return Said(text, av + human) if av + human else None


def _left_out(cell: CellFindings) -> Said | None:
    pairs, used = cell["pairs"].count, cell["mu_pairs"].count
    if used == pairs:
        return None
    av, human = cell["kappa"].events or 0, cell["kappa_human"].events or 0
    crashes = f"crashes (AV {av:,}, {cell.scenario.arms.human} {human:,})" if av or human else ""
    both = {"failures": ("failed", "failed_human"), "time-outs": ("timed_out", "timed_out_human")}
    others = [words for words, keys in both.items() if any(cell[key].count for key in keys)]
    text = (
        f"The ratio of times uses {cell['time_ratio_pairs'].count:,} of {pairs:,} pairs, μ and c_v "
        f"use {used:,}. The others had {_listed([*filter(None, [crashes]), *others])}."
    )
    if human:
        text += " A reference that crashed counts as driving on in the times and their ratio, and "
        text += "in the difference of delays."
    return Said(text, pairs - used)


def _biased(cell: CellFindings) -> Said | None:
    mu, over_all = cell["mu"].value, cell["mu_all"]
    if mu is None or over_all.low is None or over_all.includes(mu):
        return None
    way = "slower" if over_all.high is not None and mu > over_all.high else "faster"
    text = (
        f"μ makes the AV look {way} than it is: {over_all.value:.3f} "
        f"({over_all.low:.3f} … {over_all.high:.3f}) over all pairs."
    )
    return Said(text, abs(mu - (over_all.value or 0.0)))


def _undefined(cell: CellFindings) -> Said | None:
    reasons: dict[str, list[str]] = {}
    for entry in ENTRIES:
        for finding in (cell[key] for key in entry.keys if entry.screen):
            if finding.value is None and finding.reason:
                heading = entry.title(cell.scenario.conflicts.model_dump()).partition(", ")[0]
                reasons.setdefault(finding.reason, []).append(heading)
    parts = [f"{_listed(names)} ({reason})" for reason, names in reasons.items()]
    return Said(f"Undefined: {'; '.join(parts)}.", len(parts)) if parts else None


def _fallback(cell: CellFindings) -> Said | None:
    count, share, strategy = (
        cell["fallbacks"].count,
        cell["fallback_share"].value,
        cell.scenario.arms.av,
    )
    if not count:
        return None
    met = "" if share is None else f" ({100 * share:.2g} % of those that met someone)"
    text = (
        f"{fallback_of(strategy)} drove in {count:,} of {cell['pairs'].count:,} passages{met}. "
        f"For these {strategy} had no valid plan."
    )
    return Said(text, count / cell["pairs"].count)


def _speeding(cell: CellFindings) -> Said | None:
    scenario = cell.scenario
    limit_mps, over = scenario.speed_limit_mps, []
    for driver, key in (("The AV", "max_speed_mps"), (scenario.arms.human, "max_speed_mps_human")):
        fastest = cell[key].value
        if fastest is not None and fastest > limit_mps * (1 + SPEED_ROUNDING):
            over.append((driver, float(fastest)))
    if not over:
        return None
    driver, fastest = max(over, key=lambda each: each[1])
    limit = "v0" if scenario.crossing.road_speed_limit_mps is None else "the road's limit"
    text = f"{driver} drove at up to {fastest:.3g} m/s, above {limit} of {limit_mps:g} m/s."
    return Said(text, fastest - limit_mps)


def _outside_the_model(cell: CellFindings) -> Said | None:
    arms = (("", "AV"), ("_human", cell.scenario.arms.human))
    shares = [(float(s), who) for end, who in arms if (s := cell[f"clamped_share{end}"].value)]
    if not shares:
        return None
    beyond = []
    for key, words in (("speed_excess_mps", "m/s too fast"), ("range_excess_m", "m too far away")):
        if known := [v for end, _ in arms if (v := cell[f"clamped_{key}{end}"].value)]:
            beyond.append(f"{max(known):.3g} {words}")
    used = " and ".join(f"{100 * part:.3g} % ({who})" for part, who in shares)
    text = (
        f"The model was used outside its data, in {used} of its uses. The vehicle was up to "
        f"{' and '.join(beyond)}; the model answered for the nearest one in its data."
    )
    return Said(text, max(part for part, _ in shares))


def _opposite(cell: CellFindings) -> Said | None:
    ratio = cell["time_ratio"].value
    text = None if ratio is None else opposite(cell.scenario, ratio)
    return Said(text) if text else None


def _not_validated(cell: CellFindings) -> Said | None:
    text = not_validated(cell.scenario)
    return Said(text) if text else None


def _repeated(cell: CellFindings) -> Said | None:
    arms = (("the AV", "kappa"), (cell.scenario.arms.human, "kappa_human"))
    names = [who for who, key in arms if cell[key].reason == REPEATED]
    if not names:
        return None
    text = f"All {cell['pairs'].count:,} episodes of {' and of '.join(names)} are the same one"
    more = "More pairs add nothing about it, and its shares have no interval."
    return Said(f"{text}. {more}", len(names))


def _equal(cell: CellFindings) -> Said | None:
    headings = [
        entry.heading.partition(", ")[0]
        for entry in ENTRIES
        if entry.screen and entry.of == "pair" and cell[entry.key].reason == EQUAL
    ]
    if not headings:
        return None
    return Said(
        f"The same in every pair, so without an interval: {_listed(headings)}.", len(headings)
    )


def _no_difference(cell: CellFindings) -> Said | None:
    if not cell["time_ratio"].includes(1):
        return None
    return Said("The interval of the ratio of times includes 1: neither is shown to be faster.")


RULES: tuple[Rule, ...] = (
    Rule("failures", "failures", _failures),
    Rule("nothing_tested", "nothing tested", _nothing_tested),
    Rule("selected", "selected pairs", _selected),
    Rule("few_pairs", "few pairs", _few_pairs),
    Rule("time_outs", "time-outs", _time_outs),
    Rule("left_out", "pairs left out", _left_out),
    Rule("biased", "μ is biased", _biased),
    Rule("undefined", "undefined numbers", _undefined),
    Rule("fallback", "another strategy drove", _fallback),
    Rule("opposite", "another reference disagrees", _opposite),
    Rule("outside_model", "outside the model's data", _outside_the_model),
    Rule("not_validated", "reference not validated", _not_validated),
    Rule("speeding", "speeding", _speeding),
    Rule("repeated", "repeated episodes", _repeated),
    Rule("equal", "equal in every pair", _equal),
    Rule("no_difference", "no difference shown", _no_difference),
)
"""The rules, the worst news first; notes about a run as a whole come before them."""


def rank_of(key: str) -> int:
    """The rank of a rule's notes."""
    return [rule.key for rule in RULES].index(key)


def notes_of(
    cells: Sequence[CellFindings], about_run: Sequence[Note] = (), names: Sequence[str] = ()
) -> tuple[Note, ...]:
    """The notes of a run, the worst first: one for each rule, about the cell that it concerns most.

    Args:
        cells: the findings of all cells.
        about_run: notes about the run as a whole.
        names: the cells' names if they are compared; then notes have them in place of numbers.
    """
    notes = list(about_run)
    called = names or [name_of(cell.varied) for cell in cells]
    for rank, rule in enumerate(RULES):
        said = [
            (name, cell.number, words)
            for name, cell in zip(called, cells, strict=True)
            if (words := rule.say(cell)) is not None
        ]
        if not said:
            continue
        worst, _, words = max(said, key=lambda each: each[2].weight)
        alike, others = len({each.text for *_, each in said}) == 1, len(said) - 1
        first, stop, more = words.text.removesuffix(".").partition(". ")
        if len(cells) > 1 and not (alike and others):
            first = f"{worst}: {first}"
        if others:
            same = "likewise" if alike else "similar"
            first += f" ({same} in {others:,} more {'cell' if others == 1 else 'cells'})"
        text = f"{first}{stop}{more}."
        about = tuple(name if names else number for name, number, _ in said)
        notes.append(Note(rule.key, rank, rule.label, text, about))
    return tuple(sorted(notes, key=lambda note: note.rank))


def name_of(varied: Mapping[str, Plain]) -> str:
    """A cell of a sweep by its varied keys, for example ``flow_per_hour 250, soft_yield``."""
    parts = []
    for key, value in varied.items():
        if value is not None:
            name = "" if isinstance(value, str) else f"{key.rpartition('.')[2]} "
            parts.append(f"{name}{as_written(value)}")
    return ", ".join(parts)


def _listed(names: Sequence[str]) -> str:
    """The distinct names as ``a, b and c``."""
    *first, last = dict.fromkeys(names)
    return f"{', '.join(first)} and {last}" if first else last
