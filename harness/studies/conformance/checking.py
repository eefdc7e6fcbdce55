"""Runs every check on a strategy in a limited time."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from time import monotonic
from typing import Any

from harness.core.encounter import Observation
from harness.model.interaction import InteractionModel, load_model
from harness.scenario import Scenario, Setting, load_scenario, validate
from harness.strategies.parameters import check_parameters
from harness.strategies.registry import table_key
from harness.studies.conformance.checks import CHECKS, HAS_DEFAULTS
from harness.studies.conformance.subject import SURVIVES, BrokenRuleError, StoppedError, Subject

LIMIT_S = 60.0
"""How long all checks together may take."""


@dataclass(frozen=True)
class RuleResult:
    """The result of one check; ``problem`` is None where the strategy passed.

    ``observation`` is what the strategy was shown when it broke the rule, None where no single
    one is to blame.  ``checked`` is False where the check could not be made, for a reason that
    another one has found; ``problem`` says which.
    """

    check: str
    problem: str | None
    checked: bool = True
    observation: Observation | None = None


def check_strategy(
    strategy: str | type,
    model: InteractionModel | None = None,
    scenario: Scenario | str | Path = "cctc",
    settings: Mapping[str, Any] | Sequence[Setting] = (),
    limit_s: float = LIMIT_S,
) -> list[RuleResult]:
    """Run every check on a strategy.

    Args:
        strategy: as in ``arms.av``: a built-in name, an entry point, ``package.module:Class``, or
            a class.
        model: the interaction model, for strategies that ask for it; None: the scenario's.
        scenario: says the crosswalk, the ego where a scene says nothing, and the strategy's
            parameters; who comes is the scenes' business.
        settings: changes to it, where it is no ``Scenario``.
        limit_s: of wall time, for all checks together.

    Raises:
        InputError: there is no such strategy, or the scenario, a setting or a parameter is refused.
    """
    name = validate({"arms": {"av": strategy}}, "strategy").arms.av
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario, settings)
    section = scenario.model
    subject = Subject(name, scenario, model or load_model(section.name, section.path))
    check_parameters(subject.factory, subject.parameters, table_key(name))
    found: dict[str, BrokenRuleError | None] = {}
    done: Future[None] = Future()

    def check_all() -> None:
        try:
            _check_all(subject, found)
            done.set_result(None)
        except BaseException as error:
            done.set_exception(error)

    # A thread that hangs can be left behind, whatever it hangs in.
    Thread(target=check_all, daemon=True).start()
    begun_s = monotonic()
    while not wait([done], timeout=min(0.1, subject.decide_limit_s)).done:
        stopped: StoppedError | None = None
        if subject.hangs():
            stopped = subject.stopped(
                f"decide took more than {subject.decide_limit_s:g} s", SURVIVES
            )
        elif monotonic() - begun_s > limit_s:
            stopped = subject.stopped(f"not finished after {limit_s:g} s in all", "")
        if stopped is not None:
            return _verdicts(dict.fromkeys(CHECKS, stopped) | found)
    done.result()
    return _verdicts(found)


def _check_all(subject: Subject, found: dict[str, BrokenRuleError | None]) -> None:
    for check in CHECKS:
        try:
            CHECKS[check](subject)
        except BrokenRuleError as error:
            found[check] = error
        else:
            found[check] = None


def _verdicts(found: Mapping[str, BrokenRuleError | None]) -> list[RuleResult]:
    """One result for each check; where one fault stopped several checks, only one is to blame."""
    stopped = {check: error for check, error in found.items() if isinstance(error, StoppedError)}
    verdicts = []
    for check in CHECKS:
        error = found[check]
        problem = None if error is None else " ".join(str(error).split())
        checked = True
        if isinstance(error, StoppedError):
            same = [other for other in stopped if stopped[other].rule == error.rule]
            owner = error.rule if error.rule in same else same[0]
            if found[HAS_DEFAULTS] not in (None, error):
                owner = HAS_DEFAULTS
            checked = check == owner
        verdicts.append(
            RuleResult(
                check,
                problem if checked else f"not checked: {problem}",
                checked,
                error.observation if error is not None and checked else None,
            )
        )
    return verdicts
