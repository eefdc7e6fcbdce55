"""Notes that qualify the numbers of a cell, derived from its scenario and findings.

Each note is one sentence.  A note does not repeat a number from the rows of the first screen.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from harness.core.encounter import SPEED_ROUNDING
from harness.episode.traffic.saturation import GROWTH
from harness.scenario import Scenario
from harness.statistics.entries import Entry, Finding
from harness.statistics.findings import Note, Rank
from harness.statistics.over_model import OverModel
from harness.strategies.registry import fallback_of
from harness.studies.runs.references import disagreement

Findings = Mapping[str, Finding]
Catalogue = Sequence[Entry[Any]]

MOSTLY = 0.5
"""If the share of fallbacks is at least this, the AV's label names the fallback strategy too."""

FEW_HOURS = 5
"""A note gives the number of pairs of hours if it is below this.

No number of hours makes the intervals of Student's t reliable.  Their coverage reaches its level
if hours are normally distributed; it is lower if they are skewed (docs/method.md, up to 20 hours).
"""

_ENDS = ("", "_human")


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
        *_failures(scenario, findings),
        *_time_outs(scenario, findings),
        *_crashes_left_out(scenario, findings),
        *_direction(scenario, findings),
        *undefined_notes(findings, catalogue),
        *_fallback(scenario, findings),
        *_speeding(scenario, findings),
        *_outside_the_model(scenario, findings),
        *_reference(scenario, findings),
        *few_pairs_notes(findings, catalogue),
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


def undefined_notes(findings: Findings, catalogue: Catalogue) -> list[Note]:
    """Return notes with the reasons for undefined numbers on the first screen."""
    reasons: dict[str, list[str]] = {}
    for entry in catalogue:
        if not entry.first_screen or entry.may_be_absent:
            continue
        for name in filter(None, entry.names):
            finding = findings[name]
            if finding.value is None and finding.reason:
                reasons.setdefault(finding.reason, []).append(short_name(entry))
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
    arms = zip(("AV", scenario.arms.human), _ENDS, strict=True)
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


def hour_notes(scenario: Scenario, findings: Findings, catalogue: Catalogue) -> tuple[Note, ...]:
    """Return the notes of a cell of hours, sorted by rank."""
    notes, traffic = [], scenario.known_traffic
    failed = findings["failed"].count
    if failed:
        pairs = counted(findings["pairs"].count, "pair")
        notes.append(Note(Rank.FAILURES, f"{failed:,} of {pairs} failed; no row counts them."))
    if traffic.saturated:
        text = "The queue was permanent: the throughput is the capacity, and delays are undefined."
        notes.append(Note(Rank.SATURATION, text))
    notes += undefined_notes(findings, catalogue)
    if findings["pairs"].count - failed == 1:
        text = "One pair of hours has no intervals: it does not show how much hours differ."
        notes.append(Note(Rank.FEW_PAIRS, text))
    elif 1 < (ran := findings["pairs"].count - failed) < FEW_HOURS:
        notes.append(
            Note(Rank.FEW_PAIRS, f"Few pairs: each interval rests on {ran} pairs of hours.")
        )
    for who, end in zip((f"{scenario.arms.av}'s arm", scenario.arms.human), _ENDS, strict=True):
        strategy = scenario.arms.human if end else scenario.arms.av
        notes += _hour_notes_of_arm(scenario, findings, who, end, strategy)
    return tuple(sorted(notes, key=lambda note: note.rank))


def _hour_notes_of_arm(
    scenario: Scenario, findings: Findings, who: str, end: str, strategy: str
) -> list[Note]:
    """Return the notes of one arm; ``end`` is the suffix of its findings' keys."""
    notes = []

    def note(rank: Rank, text: str) -> None:
        notes.append(Note(rank, f"{who}: {text}"))

    if findings[f"kappa{end}"].events:
        note(
            Rank.LEFT_OUT,
            "after a crash traffic continued as if nobody had been hit, so the delays do not "
            "include the cost of a crash.",
        )
    if count := findings[f"not_through{end}"].count:
        note(
            Rank.LEFT_OUT,
            f"{counted(count, 'vehicle')} never passed. Their time until the end of the hour "
            "counts as their delay, which would have been longer.",
        )
    if count := findings[f"never_went{end}"].count:
        note(Rank.LEFT_OUT, f"{counted(count, 'pedestrian')} never started to cross.")
    growth, bound = (findings[f"{name}{end}"].number for name in ("growth", "growth_bound"))
    rising = findings[f"rising_s{end}"]
    why = "the flows change." if scenario.flows_change else "--settle finds a longer warm-up."
    if findings[f"saturated{end}"].value and not scenario.known_traffic.saturated:
        note(
            Rank.SATURATION,
            "the road was saturated. The number of vehicles on it grew by "
            f"{100 * (growth or 0):.0f} % of the arrivals (limit {100 * GROWTH:.0f} %; chance "
            f"explains up to {100 * (bound or 0):.0f} %). A longer hour would have longer delays.",
        )
    elif rising.low is not None and rising.low > 0:
        note(
            Rank.SATURATION,
            "the delay grew from the first third of the hour to the last by "
            f"{rising.number:.1f} ({rising.low:.1f} … {rising.high:.1f}) s; {why}",
        )
    share = findings[f"fallback_share{end}"].number
    if share:
        note(
            Rank.FALLBACK,
            f"{fallback_of(strategy)} drove {100 * share:.0f} % of the passages that met someone, "
            f"for which {strategy} has no valid plan.",
        )
    return notes


def counted(count: int, noun: str) -> str:
    """Return a number and its noun, in the plural unless the number is 1."""
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def _listed(names: Sequence[str]) -> str:
    """Join the distinct names as ``a, b and c``."""
    *first, last = dict.fromkeys(names)
    return f"{', '.join(first)} and {last}" if first else last
