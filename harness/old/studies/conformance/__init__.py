"""Takes a strategy, checks every rule in small scenes, and returns the results.

The scenes run on the plain engine.  Built-in strategies (tests/conformance) and a user's own
strategy (``harness strategies --check``) undergo the same checks.
"""

from harness.old.studies.conformance.checking import RuleResult, check_strategy
from harness.old.studies.conformance.checks import CHECKS
from harness.old.studies.conformance.subject import Subject

__all__ = ["CHECKS", "RuleResult", "Subject", "check_strategy"]
