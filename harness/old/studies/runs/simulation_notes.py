"""The notes of a cell of users' own simulations."""

from collections.abc import Callable

from harness.old.statistics import Catalogue, Findings, Note, Rank
from harness.old.store.simulations.simulation_catalogue import AVS_NOT_DRIVEN
from harness.old.studies.runs.hour_notes import FEW_HOURS
from harness.old.studies.runs.notes import counted, undefined_notes
from harness.scenario import Scenario

CUT_SHARE = 0.05
"""Above this share a note gives the number of commands that SUMO did not follow."""

_LONGEST = ("stood_longest_s", "stood_longest_s_human")


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
    if failed == pairs:
        note(Rank.NOTHING_TESTED, "Every pair failed: nothing was tested.")
    elif findings["automated"].count == 0:
        note(Rank.NOTHING_TESTED, "No vehicle was an AV: check simulation.av_types and av_share.")
    elif scenario.arms.av != "sumo_driver":
        _not_driven(scenario.arms.av, findings, note)
    read = scenario.known_simulation.read
    if read is not None and read.bent:
        where = f"{', '.join(read.bent)}: every lane bends within R0 before or just beyond"
        note(Rank.NOTHING_TESTED, f"{where}, so no strategy drives there.")
    cut = findings["cut_share"].number
    if cut is not None and cut > CUT_SHARE:
        note(
            Rank.LEFT_OUT,
            f"SUMO cut {100 * cut:.0f} % of {scenario.arms.av}'s commands: that driving is SUMO's.",
        )
    _left_out(findings, note)
    notes += undefined_notes(findings, catalogue, scenario)
    if added := _added(scenario):
        verb = "lie" if len(added) > 1 else "lies"
        text = f"{', '.join(added)} {verb} within R0 of a chosen crosswalk: also chosen."
        note(Rank.REFERENCE, text)
    if 0 < (ran := pairs - failed) < FEW_HOURS:
        text = "One pair has no intervals." if ran == 1 else f"Each interval rests on {ran} pairs."
        note(Rank.VERY_FEW_PAIRS, f"Few pairs: {text}")
    return tuple(sorted(notes, key=lambda each: each.rank))


def _added(scenario: Scenario) -> list[str]:
    simulation = scenario.known_simulation
    chosen = () if simulation.read is None else simulation.read.crossings
    return [name for name in chosen if name not in simulation.crossings]


def _not_driven(strategy: str, findings: Findings, note: Callable[[Rank, str], None]) -> None:
    """Note how many passages of AVs the strategy did not drive, and why."""
    words = {column: each for column, (_, each) in AVS_NOT_DRIVEN.items()}
    words["avs_uncommanded"] = "got no command"
    others = {column: count for column in words if (count := findings[column].count)}
    passages = findings["av_passages"].count or 0
    driven = passages - sum(others.values())
    if driven and not others:
        return
    text = f"{strategy} drove {driven:,} of {counted(passages, 'passage')} of AVs"
    if others:
        whys = ", ".join(f"{count:,} {words[column]}" for column, count in others.items())
        text += f"; the others: {whys}"
    note(Rank.LEFT_OUT if driven else Rank.NOTHING_TESTED, f"{text}.")


def _left_out(findings: Findings, note: Callable[[Rank, str], None]) -> None:
    """Note what the numbers leave out, and what SUMO reports; the AV's count comes first."""

    def both(name: str) -> str:
        """Return the counts of both arms; empty if both are 0."""
        counts = [findings[f"{name}{end}"].count for end in ("", "_human")]
        return " / ".join(f"{count:,}" for count in counts) if any(counts) else ""

    # One note for each, so that the cells of a sweep share those that are equal.
    if counts := both("not_measured"):
        why = "turned at a crosswalk or met it on a bend: not measured."
        note(Rank.LEFT_OUT, f"In the two arms {counts} vehicles {why}")
    if counts := both("unfinished"):
        text = f"In the two arms {counts} trips did not end; they count until the end."
        note(Rank.UNENDED, text)
    if counts := both("teleports"):
        note(Rank.SATURATION, f"SUMO teleported {counts} vehicles: their passages are not whole.")
    longest = " / ".join(f"{findings[name].number or 0:,.0f}" for name in _LONGEST)
    if counts := both("deadlocked"):
        text = f"{counts} vehicles stood for over 60 s at a crosswalk where people stood too"
        note(Rank.TIME_OUTS, f"{text}, up to {longest} s: the differences contain these deadlocks.")
    elif counts := both("stuck"):
        text = f"{counts} vehicles stood at a chosen crosswalk for over 60 s, up to {longest} s."
        note(Rank.SATURATION, text)
    if counts := both("sumo_collisions"):
        note(Rank.SATURATION, f"SUMO reports {counts} collisions between vehicles.")
