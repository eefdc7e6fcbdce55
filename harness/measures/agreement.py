"""Whether two records of an episode agree: those of two engines, or of two versions."""

from harness.measures.catalogue import COLUMNS
from harness.measures.record import EpisodeRecord

TOLERANCE = 1e-6
"""Numbers that differ by no more, absolutely and relatively, are equal."""


def difference(one: EpisodeRecord, other: EpisodeRecord) -> str | None:
    """What differs between two records of an episode, None where they are equal.

    Equal means: the same ending and contact, and numbers within ``TOLERANCE``.
    """
    for name in ("ending", "contact", "contact_index"):
        if getattr(one, name) != getattr(other, name):
            return f"{name} {getattr(one, name)} and {getattr(other, name)}"
    for measure, a, b in zip(COLUMNS, one.values, other.values, strict=True):
        if (a is None) != (b is None):
            return f"{measure} {a} and {b}"
        if a is not None and b is not None and abs(a - b) > TOLERANCE * max(1.0, abs(a)):
            return f"{measure} {a} and {b}"
    return None
