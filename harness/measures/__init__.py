"""Traces in; measures of safety and delay out.

All traces of a chunk are measured together, because numpy's cost is per call.  To the last bit, a
value of an episode does not depend on the other episodes of the chunk.  The measures are listed in
``measured.MEASURES`` and docs/measures.md.
"""

from harness.measures.ego import crossing_time_s
from harness.measures.measured import MEASURES, Measure
from harness.measures.record import EpisodeRecord, Outcome, has_contact, measure

__all__ = [
    "MEASURES",
    "EpisodeRecord",
    "Measure",
    "Outcome",
    "crossing_time_s",
    "has_contact",
    "measure",
]
