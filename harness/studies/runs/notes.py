"""What has to be read with the numbers of a cell: from its scenario and findings to notes.

Each note is one sentence, and repeats no number of the first screen's rows.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from harness.core.encounter import SPEED_ROUNDING
from harness.episode.traffic.saturation import GROWTH
from harness.scenario import Scenario
from harness.statistics.findings import Entry, Finding, Note, Rank
from harness.strategies.registry import fallback_of
from harness.studies.runs.references import disagreement, is_measured

Findings = Mapping[str, Finding]
Catalogue = Sequence[Entry[Any]]

MOSTLY = 0.5
"""A share of fallbacks from which on the AV's name says who drove."""

_ENDS = ("", "_human")


def av_label(strategy: str, findings: Findings) -> str:
    """The AV's strategy; with what drove in its place, where it mostly fell back on that.

    >>> av_label("soft_yield", {"fallback_share": Finding(1.0)})
    'soft_yield (hard_yield in 100 %)'
    """
    share = findings["fallback_share"].number
    if share is None or share < MOSTLY:
        return strategy
    return f"{strategy} ({fallback_of(strategy.split()[0])} in {100 * share:.0f} %)"


def sentence(words: str) -> str:
    """Words with a capital and a full stop."""
    return f"{words[0].upper()}{words[1:]}."


def encounter_notes(
    scenario: Scenario, findings: Findings, catalogue: Catalogue
) -> tuple[Note, ...]:
    """The notes of a cell of encounters, in the order of their ranks."""
    notes = [
        *_nothing_tested(scenario, findings),
        *_failures(findings),
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
            "The pairs were chosen for what happens in them (pedestrians.drawn), so no number here "
            "says how often anything happens."
        )
    pairs = findings["pairs"].count
    if findings["failed_av"].count == pairs:
        notes.append("No episode of the AV ran to its end: nothing was tested.")
    elif findings["met_nobody"].count == pairs:
        notes.append("No pedestrian was met: nothing was tested.")
    return [Note(Rank.NOTHING_TESTED, text) for text in notes]


def _failures(findings: Findings) -> list[Note]:
    failed, pairs = findings["failed"].count, findings["pairs"].count
    if not failed:
        return []
    strategy, engine = (findings[f"failed_{name}"].count for name in ("strategy", "engine"))
    text = (
        f"{failed:,} of {_counted(pairs, 'pair')} failed (strategy {strategy:,}, engine "
        f"{engine:,}); of the rows only the worst case counts them."
    )
    return [Note(Rank.FAILURES, text)]


def _time_outs(scenario: Scenario, findings: Findings) -> list[Note]:
    timed_out, pairs = findings["timed_out"].count, findings["pairs"].count
    if not timed_out:
        return []
    av, human = findings["timed_out_av"].count, findings["timed_out_human"].count
    text = (
        f"{timed_out:,} of {_counted(pairs, 'pair')} timed out (AV {av:,}, "
        f"{scenario.arms.human} {human:,}): the ratio of times counts them with the time-out, μ, "
        "c_v and the delays leave them out."
    )
    return [Note(Rank.TIME_OUTS, text)]


def _crashes_left_out(scenario: Scenario, findings: Findings) -> list[Note]:
    av, human = findings["kappa"].events, findings["kappa_human"].events
    if not av and not human:
        return []
    counted, defined = findings["time_ratio_pairs"].count, findings["defined_pairs"].count
    text = (
        f"Crashes (AV {av:,}, {scenario.arms.human} {human:,}) leave pairs out: the ratio of times "
        f"holds for {counted:,} of {_counted(findings['pairs'].count, 'pair')}, μ and c_v for "
        f"{defined:,}."
    )
    return [Note(Rank.LEFT_OUT, text)]


def _direction(scenario: Scenario, findings: Findings) -> list[Note]:
    """Which way μ errs where it lies outside its interval over all pairs."""
    mu, over_all = findings["mu"].number, findings["mu_all"]
    if mu is None or over_all.low is None or over_all.high is None:
        return []
    if over_all.low <= mu <= over_all.high:
        return []
    way = "slower" if mu > over_all.high else "faster"
    text = (
        f"μ makes the AV look {way} than it is: over all pairs, where a {scenario.arms.human} who "
        f"crashed counts as if they had driven on, it is {over_all.number:.3f} "
        f"({over_all.low:.3f} … {over_all.high:.3f})."
    )
    return [Note(Rank.LEFT_OUT, text)]


def undefined_notes(findings: Findings, catalogue: Catalogue) -> list[Note]:
    """Why numbers of the first screen are undefined."""
    reasons: dict[str, list[str]] = {}
    for entry in catalogue:
        for name in filter(None, entry.names if entry.first_screen else ()):
            finding = findings[name]
            if finding.value is None and finding.reason:
                reasons.setdefault(finding.reason, []).append(short_name(entry))
    parts = [f"{_listed(names)} ({reason})" for reason, names in reasons.items()]
    return [Note(Rank.UNDEFINED, f"Undefined: {', '.join(parts)}.")] if parts else []


def few_pairs_notes(findings: Findings, catalogue: Catalogue) -> list[Note]:
    """Which intervals of the first screen cover less than they say, and which tells nothing."""
    names: dict[int, list[str]] = {}
    for entry in catalogue:
        if not entry.first_screen:
            continue
        av, reference, both = entry.names
        for name in (both,) if both else (av, reference):
            least = None if name is None else entry.least(name)
            if name is not None and least is not None and not findings[name].reliable:
                names.setdefault(least, []).append(short_name(entry))
    notes = []
    if names:
        first, *others = sorted(names)
        parts = [f"{first:,} informative pairs ({_listed(names[first])})"]
        parts += [f"{least:,} ({_listed(names[least])})" for least in others]
        text = f"Few pairs: intervals are unreliable below {', '.join(parts)}."
        notes.append(Note(Rank.FEW_PAIRS, text))
    ratio = findings["time_ratio"]
    low, high = ratio.low, ratio.high
    if low is not None and high is not None and low <= 1 <= high > low:
        text = "The interval of the ratio of times includes 1: neither is shown to be faster."
        notes.append(Note(Rank.FEW_PAIRS, text))
    return notes


def short_name(entry: Entry[Any]) -> str:
    """A heading up to its first comma."""
    return entry.heading.partition(",")[0]


def _fallback(scenario: Scenario, findings: Findings) -> list[Note]:
    count, pairs = findings["fallbacks"].count, findings["pairs"].count
    if not count:
        return []
    strategy, share = scenario.arms.av, findings["fallback_share"].number or 0.0
    met = f" ({100 * share:.0f} % of those that met someone)" if share >= MOSTLY else ""
    text = (
        f"{fallback_of(strategy)} drove {count:,} of {_counted(pairs, 'passage')}{met}, for which "
        f"{strategy} has no answer."
    )
    return [Note(Rank.FALLBACK, text)]


def _speeding(scenario: Scenario, findings: Findings) -> list[Note]:
    """Who drove above the road's limit, or above v0 where there is none; commands are not cut."""
    limit_mps = scenario.speed_limit_mps
    what = "v0" if scenario.crossing.road_speed_limit_mps is None else "the road's limit"
    notes = []
    for who, name in (("The AV", "max_speed_mps"), (scenario.arms.human, "max_speed_human_mps")):
        fastest = findings[name].number
        if fastest is not None and fastest > limit_mps * (1 + SPEED_ROUNDING):
            text = (
                f"{who} drove at up to {fastest:.3g} m/s, above {what} of {limit_mps:g} m/s, and "
                "saves time by speeding."
            )
            notes.append(Note(Rank.SPEEDING, text))
    return notes


def _outside_the_model(scenario: Scenario, findings: Findings) -> list[Note]:
    """How often the interaction model answered for another vehicle than the one at hand."""
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
        "The interaction model was asked about vehicles outside its data in "
        f"{' and '.join(shares)} of the cases, up to {' and '.join(beyond)}, and answered for the "
        "nearest it knows."
    )
    return [Note(Rank.OUTSIDE_MODEL, text)]


def _reference(scenario: Scenario, findings: Findings) -> list[Note]:
    notes, ratio = [], findings["time_ratio"].number
    if ratio is not None and (text := disagreement(scenario, ratio)):
        notes.append(text)
    if not is_measured(scenario):
        notes.append(f"How human {scenario.arms.human} drives was not measured (harness validate).")
    return [Note(Rank.REFERENCE, text) for text in notes]


def hour_notes(scenario: Scenario, findings: Findings, catalogue: Catalogue) -> tuple[Note, ...]:
    """The notes of a cell of hours, in the order of their ranks."""
    notes, traffic = [], scenario.known_traffic
    if failed := findings["failed"].count:
        pairs = _counted(findings["pairs"].count, "pair")
        notes.append(Note(Rank.FAILURES, f"{failed:,} of {pairs} failed; no row counts them."))
    if traffic.saturated:
        text = (
            "There was a permanent queue: the throughput is the capacity, and no delay is defined."
        )
        notes.append(Note(Rank.SATURATION, text))
    notes += undefined_notes(findings, catalogue)
    for who, end in zip(("AV's arm", scenario.arms.human), _ENDS, strict=True):
        strategy = scenario.arms.human if end else scenario.arms.av
        notes += _hour_notes_of_arm(scenario, findings, who, end, strategy)
    return tuple(sorted(notes, key=lambda note: note.rank))


def _hour_notes_of_arm(
    scenario: Scenario, findings: Findings, who: str, end: str, strategy: str
) -> list[Note]:
    """The notes of one arm, the names of whose findings end so."""
    notes = []

    def note(rank: Rank, text: str) -> None:
        notes.append(Note(rank, f"{who}: {text}"))

    if crashes := findings[f"kappa{end}"].events:
        note(
            Rank.LEFT_OUT,
            f"{crashes:,} of {_counted(findings[f'kappa{end}'].n or 0, 'vehicle')} crashed, and "
            "traffic went on as if nobody had been hit, so no delay has what a crash costs.",
        )
    if count := findings[f"not_through{end}"].count:
        note(
            Rank.LEFT_OUT,
            f"{_counted(count, 'vehicle')} never got through, and count with the time until the "
            "end, which is less than their delay.",
        )
    if count := findings[f"never_went{end}"].count:
        note(Rank.LEFT_OUT, f"{_counted(count, 'pedestrian')} never got to go.")
    growth, bound = (findings[f"{name}{end}"].number for name in ("growth", "growth_bound"))
    rising = findings[f"rising_s{end}"]
    if findings[f"saturated{end}"].value and not scenario.known_traffic.saturated:
        note(
            Rank.SATURATION,
            "the road was saturated. The number of vehicles on it grew by "
            f"{100 * (growth or 0):.0f} % of the arrivals (limit {100 * GROWTH:.0f} %, chance up "
            f"to {100 * (bound or 0):.0f} %), and delays would grow with a longer hour.",
        )
    elif rising.low is not None and rising.low > 0:
        note(
            Rank.SATURATION,
            "the delay still grew from the first third of the hour to the last, by "
            f"{rising.number:.1f} ({rising.low:.1f} … {rising.high:.1f}) s; --settle finds a "
            "longer warm-up.",
        )
    share = findings[f"fallback_share{end}"].number
    if share:
        note(
            Rank.FALLBACK,
            f"{fallback_of(strategy)} drove {100 * share:.0f} % of the passages that met someone, "
            f"for which {strategy} has no answer.",
        )
    return notes


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def _listed(names: Sequence[str]) -> str:
    """Names, each once: ``a, b and c``."""
    *first, last = dict.fromkeys(names)
    return f"{', '.join(first)} and {last}" if first else last
