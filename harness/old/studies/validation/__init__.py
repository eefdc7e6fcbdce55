"""Takes recorded passages and driver models and returns how close each model is to the record."""

from harness.old.studies.validation.figures import ENTRIES
from harness.old.studies.validation.finding import find_passages
from harness.old.studies.validation.findings import DriverFindings, ValidationFindings
from harness.old.studies.validation.outcomes import DriverOutcome
from harness.old.studies.validation.passages import LEFT_OUT, Passage, Passages
from harness.old.studies.validation.validate import Validation, validate

__all__ = [
    "ENTRIES",
    "LEFT_OUT",
    "DriverFindings",
    "DriverOutcome",
    "Passage",
    "Passages",
    "Validation",
    "ValidationFindings",
    "find_passages",
    "validate",
]
