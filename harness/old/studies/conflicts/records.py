"""The findings in a recording: its passages, its crosswalks, and how it was read."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.core.encounter import Ending, StepMotion, Trace
from harness.measures import EpisodeRecord, crossing_time
from harness.measures.catalogue import COLUMNS
from harness.old.statistics.conflicts import CONFLICTS
from harness.scenario.sections import ConflictsSection
from harness.site import Crosswalk


@dataclass(frozen=True)
class ConflictPassage:
    """A passage straight over a crosswalk: its row in ``passages.parquet`` and its trace.

    ``begin_s`` is the simulation's time in s at which the trace begins.
    """

    crosswalk: str
    vehicle: str
    type: str
    approach: str
    begin_s: float
    record: EpisodeRecord
    trace: Trace
    people: tuple[str, ...]
    """Ids of the people who are on the crosswalk during the passage, in order of arrival."""

    def row(self) -> dict[str, Any]:
        """Return the passage as a row of the table."""
        record, edge_s = self.record, crossing_time(self.trace, -self.trace.crossing.width_m / 2)
        index, contact_s = record.contact_index, record.contact_time_s
        return {
            "crosswalk": self.crosswalk,
            "approach": self.approach,
            "vehicle": self.vehicle,
            "type": self.type,
            "begin_s": self.begin_s,
            "edge_s": None if edge_s is None else self.begin_s + edge_s,
            "range_m": self.trace.vehicle.trigger_range_m,
            "length_m": self.trace.vehicle.length_m,
            "width_m": self.trace.vehicle.width_m,
            "speed_mps": float(self.trace.speed_mps[0]),
            "people": record.pedestrians,
            "ending": record.ending.value,
            "contact": None if record.contact is None else record.contact.value,
            "contact_person": None if index is None else self.people[index],
            "contact_s": None if contact_s is None else self.begin_s + contact_s,
            **{name: getattr(record, name) for name in COLUMNS},
        }

    def is_conflict(self, name: str, thresholds: ConflictsSection) -> bool:
        """Return whether it is a conflict of this kind of ``CONFLICTS``; a contact always is."""
        kind = next(each for each in CONFLICTS if each.name == name)
        value, limit = getattr(self.record, kind.column), getattr(thresholds, kind.threshold)
        if self.record.ending is Ending.CRASHED:
            return True
        return value is not None and bool(value > limit if kind.above else value < limit)


@dataclass(frozen=True)
class CrosswalkConflicts:
    """The findings at one crosswalk.

    ``not_measured`` counts the passages that are not measured, by reason.
    """

    crosswalk: Crosswalk
    walks: int
    passages: tuple[ConflictPassage, ...]
    not_measured: Mapping[str, int]

    def row(self, thresholds: ConflictsSection) -> dict[str, Any]:
        """Return the crosswalk as a row of the summary."""
        met = [each for each in self.passages if each.record.pedestrians]
        records = [each.record for each in met]
        return {
            "crosswalk": self.crosswalk.id,
            "length_m": self.crosswalk.length_m,
            "width_m": self.crosswalk.width_m,
            "signalled": self.crosswalk.signalled,
            "people": self.walks,
            "passages": len(self.passages),
            "with_people": len(met),
            "contacts": sum(record.ending is Ending.CRASHED for record in records),
            **{
                f"conflicts_{kind.name}": sum(
                    each.is_conflict(kind.name, thresholds) for each in met
                )
                for kind in CONFLICTS
            },
            "min_pet_s": _extreme(min, [record.pet_s for record in records]),
            "min_ttc_s": _extreme(min, [record.min_ttc_s for record in records]),
            "max_drac_mps2": _extreme(max, [record.max_drac_mps2 for record in records]),
            **{reason: self.not_measured.get(reason, 0) for reason in REASONS},
        }


TURN_DEG = 20.0
"""A way whose turn at a junction is smaller than this angle leads straight on."""

REASONS = {
    "turning": f"the way turns by {TURN_DEG:g}° or more at the junction",
    "bending": "the way leads straight on, but is not straight within 1° from 10 m before the "
    "crosswalk until the rear has left it",
    "oblique": "the way meets the crosswalk at more than 20° from a right angle",
}
"""Reasons why a passage is counted but not measured."""


@dataclass(frozen=True)
class ConflictFindings:
    """The conflicts of a recording.

    ``undefined_types`` counts the passages of each vehicle type without a definition; they are
    measured as passenger cars.  If ``by_places``, the recorded speeds contradict the recorded
    positions, so vehicles are assumed to move between positions at constant speed.  ``unusable``
    has the reason for each crosswalk at which nothing can be measured.
    """

    files: tuple[Path, ...]
    net: Path
    step_s: float
    motion: StepMotion
    by_places: bool
    rounding_m: float
    geo: bool
    crosswalks: tuple[CrosswalkConflicts, ...]
    undefined_types: Mapping[str, int]
    unusable: Mapping[str, str]
    vehicle_records: int
    person_records: int
    thresholds: ConflictsSection

    @property
    def passages(self) -> list[ConflictPassage]:
        """The passages of all crosswalks."""
        return [each for crosswalk in self.crosswalks for each in crosswalk.passages]


def _extreme(best: Callable[..., float], values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return best(known) if known else None
