"""Traces in; measures of safety and delay out.

All traces of a chunk are measured together, because numpy's cost is per call.  Every value of an
episode depends on that episode alone, to the last bit, whatever else is in the chunk.  The measures
are listed in ``catalogue.MEASURES`` and docs/measures.md.
"""

from harness.measures.catalogue import MEASURES, Measure
from harness.measures.ego import crossing_time
from harness.measures.record import EpisodeRecord, Outcome, has_contact, measure

__all__ = [
    "MEASURES",
    "EpisodeRecord",
    "Measure",
    "Outcome",
    "crossing_time",
    "has_contact",
    "measure",
]
