"""Kinds of conflict, and the entries of their rates."""

from dataclasses import dataclass

from harness.old.statistics.encounter_columns import EncounterColumns
from harness.old.statistics.entries import Entry, Form
from harness.old.statistics.intervals import Proportion

MET = "Only pairs in which someone stepped off count."
ALL_FAILED = "every episode failed"
NOBODY = "nobody was met"


@dataclass(frozen=True, slots=True)
class Conflict:
    """A kind of conflict: a measure beyond a threshold.

    ``threshold`` is a key of ``[conflicts]``.  A value is a conflict above the threshold if
    ``above`` is set, otherwise below it.  ``heading`` holds the threshold's key in braces, see
    ``Entry.title``.
    """

    name: str
    column: str
    threshold: str
    above: bool
    heading: str


CONFLICTS = (
    Conflict("ttc", "min_ttc_s", "ttc_s", above=False, heading="TTC below {ttc_s:g} s"),
    Conflict(
        "time_advantage",
        "min_time_advantage_s",
        "time_advantage_s",
        above=False,
        heading="time advantage below {time_advantage_s:g} s",
    ),
    Conflict("pet", "pet_s", "pet_s", above=False, heading="PET below {pet_s:g} s"),
    Conflict(
        "drac",
        "max_drac_mps2",
        "drac_mps2",
        above=True,
        heading="DRAC above {drac_mps2:g} m/s²",
    ),
)


def conflict_entries(conflict: Conflict) -> tuple[Entry[EncounterColumns], Entry[EncounterColumns]]:
    """The rate of a kind of conflict over all pairs, and over pairs that met someone."""
    name = conflict.name
    return (
        Entry(
            f"conflict_{name}",
            conflict.heading,
            f"Share of episodes with a conflict, by the threshold "
            f"`conflicts.{conflict.threshold}`; a crash counts as a conflict of every kind.",
            form=Form.SHARE,
            digits=0,
            interval=Proportion,
            of_arm=lambda c, arm: c.conflict_rate(name, arm),
            undefined=ALL_FAILED,
            first_screen=name == "pet",
        ),
        Entry(
            f"conflict_{name}_met_someone",
            f"{conflict.heading}, pairs that met someone",
            f"Share of episodes with such a conflict. {MET}",
            form=Form.SHARE,
            interval=Proportion,
            of_arm=lambda c, arm: c.met.conflict_rate(name, arm),
            undefined=NOBODY,
        ),
    )
