"""Driver models held against recorded passages of vehicles through groups of pedestrians."""

from harness.validation.figures import FIGURES, DriverFigures
from harness.validation.finding import find_passages
from harness.validation.outcomes import DriverOutcome
from harness.validation.passages import LEFT_OUT, Passage, Passages
from harness.validation.ranking import Ranked
from harness.validation.validate import Validation, validate

__all__ = [
    "FIGURES",
    "LEFT_OUT",
    "DriverFigures",
    "DriverOutcome",
    "Passage",
    "Passages",
    "Ranked",
    "Validation",
    "find_passages",
    "validate",
]
