"""Takes a behaviour and drivers; returns how near they are to people in measured experiments."""

from harness.studies.validation.people.findings import Held, PeopleFindings, Row
from harness.studies.validation.people.running import HOURS, TRIALS, validate_people

__all__ = ["HOURS", "TRIALS", "Held", "PeopleFindings", "Row", "validate_people"]
