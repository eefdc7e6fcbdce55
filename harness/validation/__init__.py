"""Driver models held against recorded passages of vehicles through groups of pedestrians."""

from harness.validation.figures import ENTRIES
from harness.validation.finding import find_passages
from harness.validation.findings import DriverFindings, ValidationFindings
from harness.validation.outcomes import DriverOutcome
from harness.validation.passages import LEFT_OUT, Passage, Passages
from harness.validation.validate import Validation, validate

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
