"""Notes that qualify the numbers of a cell, derived from its scenario and findings.

Each note is one sentence.  A note does not repeat a number from the rows of the first screen.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from harness.core.encounter import SPEED_ROUNDING
from harness.old.statistics.entries import Entry, Finding
from harness.old.statistics.findings import Note, Rank
from harness.old.statistics.over_model import OverModel
from harness.old.studies.runs.references import disagreement
from harness.scenario import Scenario
from harness.strategies.registry import fallback_of

Findings = Mapping[str, Finding]
Catalogue = Sequence[Entry[Any]]

MOSTLY = 0.5
"""If the share of fallbacks is at least this, the AV's label names the fallback strategy too."""

ENDS = ("", "_human")
"""The ends of the keys of both arms."""


def av_label(strategy: str, findings: Findings) -> str:
    """Return the AV's strategy, and the fallback strategy if it drove most passages.

    >>> av_label("soft_yield", {"fallback_share": Finding(1.0)})
    'soft_yield (hard_yield in 100 %)'
    """
    share = findings["fallback_share"].number
    if share is None or share < MOSTLY:
        return strategy
    return f"{strategy} ({fallback_of(strategy.split()[0])} in {100 * share:.0f} %)"


def model_notes(
    over: Mapping[str, OverModel],
    findings: Findings,
    catalogue: Catalogue,
    thresholds: Mapping[str, float],
) -> list[Note]:
    """Note what the model's fit leaves open: the sign of the AV's gain, and what more pairs do."""
    notes, ratio = [], over.get("time_ratio")
    if ratio is not None and _includes_1(ratio) and not _includes_1(findings["time_ratio"]):
        text = (
            "With the model's fit, the interval of the ratio of times includes 1: neither is shown "
            "to be faster."
        )
        notes.append(Note(Rank.OVER_MODEL, text))
    mostly = [
        (entry.title_of(name, thresholds).split(", ")[0], over[name])
        for entry in catalogue
        for name in filter(None, entry.names[2:])
        if entry.first_screen and name in over and over[name].mostly_model
    ]
    if not mostly:
        return notes
    (title, found), *others = mostly
    share, low, high = (
        100 * (part or 0.0) for part in (found.share, found.share_low, found.share_high)
    )
    also = f", and more than half for {', '.join(title for title, _ in others)}" if others else ""
    whether = "will" if found.surely_model else "may"
    text = (
        f"The model's fit makes {share:.0f} % ({low:.0f} … {high:.0f}) of the variance of the "
        f"{title}{also}: more pairs {whether} not help."
    )
    return [*notes, Note(Rank.OVER_MODEL, text)]


def _includes_1(ratio: Finding | OverModel) -> bool:
    low, high = ratio.low, ratio.high
    return low is not None and high is not None and low <= 1 <= high > low


def sentence(words: str) -> str:
    """Return the words with a capital letter and a full stop."""
    return f"{words[0].upper()}{words[1:]}."


def encounter_notes(
    scenario: Scenario, findings: Findings, catalogue: Catalogue
) -> tuple[Note, ...]:
    """Return the notes of a cell of encounters, sorted by rank."""
    notes = [
        *_nothing_tested(scenario, findings),
        *_all_the_same(scenario, findings),
        *_failures(scenario, findings),
        *_time_outs(scenario, findings),
        *_crashes_left_out(scenario, findings),
        *_direction(scenario, findings),
        *_delays_of_crashed(scenario, findings),
        *undefined_notes(findings, catalogue, scenario),
        *_fallback(scenario, findings),
        *_speeding(scenario, findings),
        *_outside_the_model(scenario, findings),
        *_reference(scenario, findings),
        *([] if len(_repeated(scenario, findings)) == 2 else few_pairs_notes(findings, catalogue)),
    ]
    return tuple(sorted(notes, key=lambda note: note.rank))


def _nothing_tested(scenario: Scenario, findings: Findings) -> list[Note]:
    notes = []
    if scenario.pedestrians.drawn:
        notes.append(
            "The pairs were selected by their outcome (pedestrians.drawn), so no number here is a "
            "frequency."
        )
    pairs = findings["pairs"].count
    if findings["failed_av"].count == pairs:
        notes.append("Every episode of the AV failed: nothing was tested.")
    elif findings["met_nobody"].count == pairs:
        notes.append("Neither driver met a pedestrian: nothing was tested.")
    return [Note(Rank.NOTHING_TESTED, text) for text in notes]


def _repeated(scenario: Scenario, findings: Findings) -> list[str]:
    """Return the arms whose episodes repeat the same one: their shares have no interval."""
    arms = zip(("the AV", scenario.arms.human), ENDS, strict=True)
    crashes = [(who, findings[f"kappa{end}"]) for who, end in arms]
    return [who for who, found in crashes if found.value is not None and found.low is None]


def _all_the_same(scenario: Scenario, findings: Findings) -> list[Note]:
    names, pairs = _repeated(scenario, findings), findings["pairs"].count
    text = (
        f"All {pairs:,} episodes of {' and of '.join(names)} are the same: more pairs add nothing"
    )
    text += " about it." if len(names) == 1 else "."
    return [Note(Rank.VERY_FEW_PAIRS, text)] if names else []


def _failures(scenario: Scenario, findings: Findings) -> list[Note]:
    failed, pairs = findings["failed"].count, findings["pairs"].count
    if not failed:
        return []
    av, human, strategy, engine = (
        findings[f"failed_{name}"].count for name in ("av", "human", "strategy", "engine")
    )
    text = (
        f"{failed:,} of {counted(pairs, 'pair')} failed (AV {av:,}, {scenario.arms.human} "
        f"{human:,}; strategy {strategy:,}, engine {engine:,}); only the worst case counts them."
    )
    return [Note(Rank.FAILURES, text)]


def _time_outs(scenario: Scenario, findings: Findings) -> list[Note]:
    timed_out, pairs = findings["timed_out"].count, findings["pairs"].count
    if not timed_out:
        return []
    av, human = findings["timed_out_av"].count, findings["timed_out_human"].count
    text = (
        f"{timed_out:,} of {counted(pairs, 'pair')} timed out (AV {av:,}, "
        f"{scenario.arms.human} {human:,}): only the ratio of times uses them, as "
        f"{scenario.experiment.timeout_s:g} s."
    )
    return [Note(Rank.TIME_OUTS, text)]


def _crashes_left_out(scenario: Scenario, findings: Findings) -> list[Note]:
    av, human = findings["kappa"].events, findings["kappa_human"].events
    if not av and not human:
        return []
    with_time, defined = findings["time_ratio_pairs"].count, findings["defined_pairs"].count
    pairs = counted(findings["pairs"].count, "pair")
    uses = f"The ratio of times uses {with_time:,} of {pairs}, μ and c_v use {defined:,}"
    if with_time == defined:
        uses = f"The ratio of times, μ and c_v use {with_time:,} of {pairs}"
    text = f"{uses} (crashes: AV {av:,}, {scenario.arms.human} {human:,})."
    return [Note(Rank.LEFT_OUT, text)]


def _direction(scenario: Scenario, findings: Findings) -> list[Note]:
    """Return a note on the direction of bias if μ lies outside the interval of μ over all pairs."""
    mu, over_all = findings["mu"].number, findings["mu_all"]
    if mu is None or over_all.low is None or over_all.high is None:
        return []
    if over_all.low <= mu <= over_all.high:
        return []
    way = "slower" if mu > over_all.high else "faster"
    text = (
        f"μ makes the AV look {way} than it is: over all pairs μ is {over_all.number:.3f} "
        f"({over_all.low:.3f} … {over_all.high:.3f}), if {scenario.arms.human} counts as driving "
        "on after a crash."
    )
    return [Note(Rank.LEFT_OUT, text)]


def _delays_of_crashed(scenario: Scenario, findings: Findings) -> list[Note]:
    if not findings["kappa_human"].events:
        return []
    text = f"The difference of delays counts a crashed {scenario.arms.human} as driving on."
    return [Note(Rank.LEFT_OUT, text)]


def undefined_notes(findings: Findings, catalogue: Catalogue, scenario: Scenario) -> list[Note]:
    """Return notes with the reasons for undefined numbers on the first screen."""
    reasons: dict[str, list[str]] = {}
    for entry in catalogue:
        if not entry.first_screen or entry.may_be_absent:
            continue
        for name in filter(None, entry.names):
            finding = findings[name]
            if finding.value is None and finding.reason:
                named = short_name(entry).format(**scenario.conflicts.model_dump())
                reasons.setdefault(finding.reason, []).append(named)
    parts = [f"{_listed(names)} ({reason})" for reason, names in reasons.items()]
    return [Note(Rank.UNDEFINED, f"Undefined: {', '.join(parts)}.")] if parts else []


def few_pairs_notes(findings: Findings, catalogue: Catalogue) -> list[Note]:
    """Note unreliable intervals of the first screen, and a ratio whose interval includes 1."""
    names: dict[int, list[str]] = {}
    for entry in catalogue:
        if not entry.first_screen:
            continue
        av, reference, both = entry.names
        for name in (both,) if both else (av, reference):
            least = None if name is None else entry.least(name)
            if name is not None and least is not None and findings[name].reliable is False:
                heading = entry.paired_heading if name == both else ""
                names.setdefault(least, []).append(heading or short_name(entry))
    notes = []
    if names:
        first, *others = sorted(names)
        parts = [f"{first:,} informative pairs ({_listed(names[first])})"]
        parts += [f"{least:,} ({_listed(names[least])})" for least in others]
        text = f"Few pairs: intervals are unreliable below {', '.join(parts)}."
        notes.append(Note(Rank.FEW_PAIRS, text))
    if _includes_1(findings["time_ratio"]):
        text = "The interval of the ratio of times includes 1: neither is shown to be faster."
        notes.append(Note(Rank.FEW_PAIRS, text))
    return notes


def short_name(entry: Entry[Any]) -> str:
    """Return a heading up to its first comma."""
    return entry.heading.partition(", ")[0]


def _fallback(scenario: Scenario, findings: Findings) -> list[Note]:
    count, pairs = findings["fallbacks"].count, findings["pairs"].count
    if not count:
        return []
    strategy, share = scenario.arms.av, findings["fallback_share"].number or 0.0
    met = f" ({100 * share:.0f} % of those that met someone)" if share >= MOSTLY else ""
    text = (
        f"{fallback_of(strategy)} drove {count:,} of {counted(pairs, 'passage')}{met}, for which "
        f"{strategy} has no valid plan."
    )
    return [Note(Rank.FALLBACK, text)]


def _speeding(scenario: Scenario, findings: Findings) -> list[Note]:
    """Note the drivers who exceed the speed limit, or v0 if the road has no limit."""
    limit_mps = scenario.speed_limit_mps
    limit = "v0" if scenario.crossing.road_speed_limit_mps is None else "the road's limit"
    notes = []
    for driver, name in (
        ("The AV", "max_speed_mps"),
        (scenario.arms.human, "max_speed_human_mps"),
    ):
        fastest = findings[name].number
        if fastest is not None and fastest > limit_mps * (1 + SPEED_ROUNDING):
            text = (
                f"{driver} drove at up to {fastest:.3g} m/s, above {limit} of {limit_mps:g} m/s, "
                "and saves time by speeding."
            )
            notes.append(Note(Rank.SPEEDING, text))
    return notes


def _outside_the_model(scenario: Scenario, findings: Findings) -> list[Note]:
    """Note how often the model was evaluated outside the range of its data."""
    arms = zip(("AV", scenario.arms.human), ENDS, strict=True)
    shares = [
        f"{100 * share:.3g} % ({who})"
        for who, end in arms
        if (share := findings[f"clamped_share{end}"].number)
    ]
    if not shares:
        return []
    beyond = [
        f"{value:.3g} {unit}"
        for name, unit in (
            ("clamped_speed_excess_mps", "m/s too fast"),
            ("clamped_range_excess_m", "m too far away"),
        )
        if (value := findings[name].number)
    ]
    text = (
        f"In {' and '.join(shares)} of the cases the vehicle was outside the data of the "
        f"interaction model, up to {' and '.join(beyond)}; the model used the nearest state in "
        "its data."
    )
    return [Note(Rank.OUTSIDE_MODEL, text)]


def _reference(scenario: Scenario, findings: Findings) -> list[Note]:
    ratio = findings["time_ratio"].number
    text = "" if ratio is None else disagreement(scenario, ratio)
    return [Note(Rank.REFERENCE, text)] if text else []


def counted(count: int, noun: str) -> str:
    """Return a number and its noun, in the plural unless the number is 1."""
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def _listed(names: Sequence[str]) -> str:
    """Join the distinct names as ``a, b and c``."""
    *first, last = dict.fromkeys(names)
    return f"{', '.join(first)} and {last}" if first else last
