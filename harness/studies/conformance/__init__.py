"""The rules that every strategy must keep to, checked in small scenes on the plain engine.

The same checks hold the built-in strategies (tests/conformance) and a user's own
(``harness strategies --check``).
"""

from harness.studies.conformance.checking import RuleResult, check_strategy
from harness.studies.conformance.checks import CHECKS
from harness.studies.conformance.subject import Subject

__all__ = ["CHECKS", "RuleResult", "Subject", "check_strategy"]
