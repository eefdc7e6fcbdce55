"""The notes of a cell of hours of traffic."""

from harness.encounter.traffic.saturation import GROWTH
from harness.old.statistics.findings import Note, Rank
from harness.old.studies.runs.notes import ENDS, Catalogue, Findings, counted, undefined_notes
from harness.scenario import Scenario
from harness.strategies.registry import fallback_of

FEW_HOURS = 5
"""A note gives the number of pairs of hours if it is below this.

No number of hours makes the intervals of Student's t reliable.  Their coverage reaches its level
if hours are normally distributed; it is lower if they are skewed (docs/method.md, up to 20 hours).
"""


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
    notes += undefined_notes(findings, catalogue, scenario)
    if findings["pairs"].count - failed == 1:
        text = "One pair of hours has no intervals: it does not show how much hours differ."
        notes.append(Note(Rank.FEW_PAIRS, text))
    elif 1 < (ran := findings["pairs"].count - failed) < FEW_HOURS:
        notes.append(
            Note(Rank.FEW_PAIRS, f"Few pairs: each interval rests on {ran} pairs of hours.")
        )
    for who, end in zip((f"{scenario.arms.av}'s arm", scenario.arms.human), ENDS, strict=True):
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
    why = "the flows change." if scenario.flows_change else "traffic.warm_up_s may be too short."
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
