"""The notes of a cell of users' own simulations."""

from collections.abc import Callable

from harness.scenario import Scenario
from harness.statistics import Catalogue, Findings, Note, Rank
from harness.studies.runs.notes import FEW_HOURS, counted, undefined_notes

CUT_SHARE = 0.05
"""Above this share a note says how many commands SUMO did not follow."""


def simulation_notes(
    scenario: Scenario, findings: Findings, catalogue: Catalogue
) -> tuple[Note, ...]:
    """Return the notes of a cell, sorted by rank."""
    notes: list[Note] = []

    def note(rank: Rank, text: str) -> None:
        notes.append(Note(rank, text))

    failed, pairs = findings["failed"].count, findings["pairs"].count
    if failed:
        note(
            Rank.FAILURES,
            f"{failed:,} of {counted(pairs, 'pair')} failed; no row counts them.",
        )
    if findings["automated"].count == 0:
        note(Rank.NOTHING_TESTED, "No vehicle was an AV: check simulation.av_types and av_share.")
    elif findings["driven"].count == 0 and scenario.arms.av != "sumo_driver":
        note(Rank.NOTHING_TESTED, f"{scenario.arms.av} drove no passage.")
    for who, end in ((f"{scenario.arms.av}'s arm", ""), (scenario.arms.human, "_human")):
        _left_out(findings, who, end, note)
    cut = findings["cut_share"].number
    if cut is not None and cut > CUT_SHARE:
        note(
            Rank.LEFT_OUT,
            f"SUMO did not follow {100 * cut:.0f} % of {scenario.arms.av}'s commands, because of "
            "other vehicles, lights or the junction: those speeds are SUMO's.",
        )
    notes += undefined_notes(findings, catalogue)
    if added := _added(scenario):
        text = f"{', '.join(added)} lie within R0 of a chosen crosswalk and were chosen with it."
        note(Rank.REFERENCE, text)
    if 0 < (ran := pairs - failed) < FEW_HOURS:
        text = "One pair has no intervals." if ran == 1 else f"Each interval rests on {ran} pairs."
        note(Rank.FEW_PAIRS, f"Few pairs: {text}")
    return tuple(sorted(notes, key=lambda each: each.rank))


def _added(scenario: Scenario) -> list[str]:
    simulation = scenario.known_simulation
    chosen = () if simulation.read is None else simulation.read.crossings
    return [name for name in chosen if name not in simulation.crossings]


def _left_out(findings: Findings, who: str, end: str, note: Callable[[Rank, str], None]) -> None:
    """Note what no number of an arm counts, and what SUMO says of it."""
    measured = findings[f"passages{end}"].count
    if count := findings[f"not_measured{end}"].count:
        note(
            Rank.LEFT_OUT,
            f"{who}: {counted(count, 'vehicle')} turned at the junction of a chosen crosswalk or "
            f"bent there; measured are {counted(measured, 'passage')} straight over.",
        )
    if count := findings[f"not_driven{end}"].count:
        text = f"{who}: {counted(count, 'passage')} no strategy may drive; SUMO drove them."
        note(Rank.LEFT_OUT, text)
    if count := findings[f"unfinished{end}"].count:
        note(
            Rank.LEFT_OUT,
            f"{who}: {counted(count, 'trip')} did not end; they count with the time until the end.",
        )
    if count := findings[f"teleports{end}"].count:
        text = f"{who}: SUMO teleported {counted(count, 'vehicle')}; their passages are not whole."
        note(Rank.SATURATION, text)
    if count := findings[f"sumo_collisions{end}"].count:
        text = f"{who}: SUMO reports {counted(count, 'collision')} between vehicles."
        note(Rank.SATURATION, text)
