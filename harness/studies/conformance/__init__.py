"""Takes a strategy and returns the result of every rule, checked in small scenes.

The scenes run on the plain engine.  Built-in strategies (tests/conformance) and a user's own
strategy (``harness strategies --check``) are checked alike.
"""

from harness.studies.conformance.checking import RuleResult, check_strategy
from harness.studies.conformance.checks import CHECKS
from harness.studies.conformance.subject import Subject

__all__ = ["CHECKS", "RuleResult", "Subject", "check_strategy"]
