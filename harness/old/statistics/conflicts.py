"""Kinds of conflict."""

from dataclasses import dataclass


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
