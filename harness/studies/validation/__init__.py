"""Takes recorded passages and driver models and returns how close each model is to the record."""

from harness.studies.validation.figures import ENTRIES
from harness.studies.validation.finding import find_passages
from harness.studies.validation.findings import DriverFindings, ValidationFindings
from harness.studies.validation.outcomes import DriverOutcome
from harness.studies.validation.passages import LEFT_OUT, Passage, Passages
from harness.studies.validation.validate import Validation, validate

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
