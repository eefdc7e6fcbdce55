"""Takes a strategy and returns the result of every check within a limited time."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from time import monotonic
from typing import Any

from harness.core.encounter import Observation
from harness.model.interaction import InteractionModel, load_model
from harness.old.studies.conformance.checks import CHECKS, HAS_DEFAULTS
from harness.old.studies.conformance.subject import SURVIVES, BrokenRuleError, StoppedError, Subject
from harness.scenario import Scenario, Setting, load_scenario, validate
from harness.strategies.parameters import check_parameters
from harness.strategies.registry import table_key

LIMIT_S = 60.0
"""Wall-time limit in s for all checks together."""


@dataclass(frozen=True)
class RuleResult:
    """The result of one check; ``problem`` is None if the strategy passed.

    ``observation`` is the observation at which the strategy broke the rule; None if no single
    observation caused it.  If another check's problem prevented this check, ``checked`` is False
    and ``problem`` repeats that problem.
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
        strategy: a built-in name, an entry point, ``package.module:Class``, or a class, as in
            ``arms.av``.
        model: the interaction model for strategies that use it; None means the scenario's.
        scenario: gives the crosswalk, the ego, its actuation and the strategy's parameters.  The
            scenes give the pedestrians and may change the ego.
        settings: changes to a scenario that is given by name or path.
        limit_s: wall-time limit for all checks together.

    Raises:
        InputError: the strategy does not exist, or the scenario, a setting or a parameter is
            invalid.
    """
    name = validate({"arms": {"av": strategy}}, "strategy").arms.av
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario, settings)
    section = scenario.model
    subject = Subject(name, scenario, model or load_model(section.name, section.path))
    check_parameters(subject.factory, subject.parameters, table_key(name))
    errors: dict[str, BrokenRuleError | None] = {}
    done: Future[None] = Future()

    def check_all() -> None:
        try:
            _check_all(subject, errors)
            done.set_result(None)
        except BaseException as error:
            done.set_exception(error)

    # A daemon thread that hangs does not keep the process alive.
    Thread(target=check_all, daemon=True).start()
    begun_s = monotonic()
    while not wait([done], timeout=min(0.1, subject.decide_limit_s)).done:
        stopped: StoppedError | None = None
        if subject.hangs():
            stopped = subject.stopped(
                f"decide took more than {subject.decide_limit_s:g} s", SURVIVES
            )
        elif monotonic() - begun_s > limit_s:
            stopped = subject.stopped(f"the checks did not finish within {limit_s:g} s", "")
        if stopped is not None:
            return _verdicts(dict.fromkeys(CHECKS, stopped) | errors)
    done.result()
    return _verdicts(errors)


def _check_all(subject: Subject, errors: dict[str, BrokenRuleError | None]) -> None:
    for check in CHECKS:
        try:
            CHECKS[check](subject)
        except BrokenRuleError as error:
            errors[check] = error
        else:
            errors[check] = None


def _verdicts(errors: Mapping[str, BrokenRuleError | None]) -> list[RuleResult]:
    """Return one result for each check.  A fault that stopped several checks is reported once."""
    stopped = {check: error for check, error in errors.items() if isinstance(error, StoppedError)}
    verdicts = []
    for check in CHECKS:
        error = errors[check]
        problem = None if error is None else " ".join(str(error).split())
        checked = True
        if isinstance(error, StoppedError):
            stopped_alike = [other for other in stopped if stopped[other].rule == error.rule]
            reported = error.rule if error.rule in stopped_alike else stopped_alike[0]
            if errors[HAS_DEFAULTS] not in (None, error):
                reported = HAS_DEFAULTS
            checked = check == reported
        verdicts.append(
            RuleResult(
                check,
                problem if checked else f"not checked: {problem}",
                checked,
                error.observation if error is not None and checked else None,
            )
        )
    return verdicts
