"""Compares the records of one episode by two engines or two versions."""

from harness.measures.catalogue import COLUMNS
from harness.measures.record import EpisodeRecord

TOLERANCE = 1e-6
"""Numbers are equal if they differ by at most this, absolutely or relatively."""


def difference(first: EpisodeRecord, second: EpisodeRecord) -> str | None:
    """The first difference between two records of an episode; None if they are equal.

    Records are equal if ending and contact are the same and all numbers agree within ``TOLERANCE``.
    """
    for name in ("ending", "contact", "contact_index"):
        if getattr(first, name) != getattr(second, name):
            return f"{name} {getattr(first, name)} and {getattr(second, name)}"
    for measure, a, b in zip(COLUMNS, first.values, second.values, strict=True):
        if (a is None) != (b is None):
            return f"{measure} {a} and {b}"
        if a is not None and b is not None and abs(a - b) > TOLERANCE * max(1.0, abs(a)):
            return f"{measure} {a} and {b}"
    return None
