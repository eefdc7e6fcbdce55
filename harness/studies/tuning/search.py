"""The next trial of a search, from the finished ones: Optuna's sampler, seeded for each trial."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from harness.core.errors import InputError
from harness.core.seeding import stream
from harness.statistics.limits import Limit
from harness.studies.candidates.evaluation import refuse_other_people

Direction = Literal["minimize", "maximize"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A key of the scenario and its range; ``whole`` numbers only, or on a ``log`` scale."""

    key: str
    low: float
    high: float
    whole: bool = False
    log: bool = False


@dataclass(frozen=True, slots=True)
class Trial:
    """A finished trial: the candidate, its numbers on the search's pairs, and why it has none.

    ``numbers`` has the objective and the limited numbers.  Most of them leave out episodes that
    failed: ``failed_av`` counts those of the AV, and ``failure`` is the first failure of an arm.
    """

    number: int
    candidate: Mapping[str, float]
    numbers: Mapping[str, float | None]
    refused: str | None = None
    failed_av: int = 0
    failure: str | None = None


@dataclass(frozen=True, slots=True)
class Goal:
    """What is searched: a number to minimise or maximise, and limits."""

    objective: str
    direction: Direction
    limits: tuple[Limit, ...]

    @property
    def names(self) -> list[str]:
        """The numbers on which the search depends."""
        return list(dict.fromkeys([self.objective, *(limit.name for limit in self.limits)]))

    def excesses(self, trial: Trial) -> dict[str, float] | None:
        """The excess over each limit; None if the objective or a limited number is undefined.

        Failures of the AV are an excess of their own, which steers the search away from them.
        """
        values = {name: trial.numbers.get(name) for name in self.names}
        if any(value is None for value in values.values()):
            return None
        found = {str(limit): limit.excess(values[limit.name] or 0.0) for limit in self.limits}
        return found | ({"failed_av": float(trial.failed_av)} if trial.failed_av else {})

    def keeps(self, trial: Trial) -> bool:
        """Whether the AV failed in no episode of a trial, and its estimates keep every limit."""
        excesses = self.excesses(trial)
        return excesses is not None and all(excess <= 0 for excess in excesses.values())

    def cost(self, trial: Trial) -> float:
        """The objective of a trial, smaller is better."""
        value = trial.numbers[self.objective]
        assert value is not None
        return value if self.direction == "minimize" else -value


def parse_parameter(text: str) -> Parameter:
    """Parse ``KEY=LOW:HIGH``, with ``:int`` or ``:log`` behind it.

    Raises:
        InputError: the text has another form, the key chooses the people, or the range is empty
            or reversed.
    """
    where, form = f"--parameter {text}", "KEY=LOW:HIGH, KEY=LOW:HIGH:int or KEY=LOW:HIGH:log"
    key, _, ends = text.partition("=")
    low_text, _, rest = ends.partition(":")
    high_text, _, scale = rest.partition(":")
    try:
        low, high = float(low_text), float(high_text)
    except ValueError:
        raise InputError(where, "is not accepted", form) from None
    if not key.strip() or scale not in ("", "int", "log") or not math.isfinite(high - low):
        raise InputError(where, "is not accepted", form)
    refuse_other_people("--parameter", key.strip(), "--seed and --pairs choose the people")
    if low >= high:
        raise InputError(where, f"the range begins at {low:g} and ends at {high:g}", "LOW < HIGH")
    if scale == "log" and low <= 0:
        raise InputError(where, f"{low:g} has no logarithm", "LOW above 0")
    if scale == "int" and not (low.is_integer() and high.is_integer()):
        raise InputError(where, "is not accepted", "whole numbers")
    return Parameter(key.strip(), low, high, scale == "int", scale == "log")


def import_optuna() -> Any:
    """Return Optuna without its log on the terminal.

    Raises:
        InputError: it is not installed.
    """
    try:
        import optuna
    except ImportError:
        problem = "needs Optuna, which is not installed"
        raise InputError("harness tune", problem, 'pip install "crosswalk-harness[tune]"') from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


def next_candidate(
    parameters: Sequence[Parameter], goal: Goal, trials: Sequence[Trial], seed: int
) -> dict[str, float]:
    """The candidate of the next trial: a function of the finished trials and the seed alone.

    Args:
        parameters: what is searched.
        goal: the objective and the limits, whose excesses steer the search.
        trials: all finished trials, in order.
        seed: the experiment's seed; the sampler is seeded by it and the trial's number.
    """
    optuna = import_optuna()
    known = {parameter.key: _distribution(optuna, parameter) for parameter in parameters}
    seeded = int(stream(seed, "search", len(trials)).integers(2**32))
    study = optuna.create_study(
        sampler=optuna.samplers.TPESampler(seed=seeded), direction=goal.direction
    )
    for trial in trials:
        excesses = goal.excesses(trial)
        done = {"params": dict(trial.candidate), "distributions": known}
        if excesses is None:
            failed = optuna.trial.TrialState.FAIL
            study.add_trial(optuna.trial.create_trial(state=failed, **done))
        else:
            value = trial.numbers[goal.objective]
            study.add_trial(
                optuna.trial.create_trial(value=value, constraints=excesses or None, **done)
            )
    return dict(study.ask(known).params)


def best_of(goal: Goal, trials: Sequence[Trial]) -> Trial | None:
    """The best trial whose estimates keep every limit, the first of equals; None without one."""
    return min(filter(goal.keeps, trials), key=goal.cost, default=None)


def front_of(goal: Goal, trials: Sequence[Trial]) -> list[Trial]:
    """The trials that no other one beats in the objective and in every limited number.

    Trials in which the AV failed are left out, because their numbers are.
    """
    points = {}
    for trial in trials:
        excesses = goal.excesses(trial)
        if excesses is not None and not trial.failed_av:
            points[trial.number] = (goal.cost(trial), *excesses.values())
    return [
        trial
        for trial in trials
        if trial.number in points
        and not any(
            other != points[trial.number]
            and all(a <= b for a, b in zip(other, points[trial.number], strict=True))
            for other in points.values()
        )
    ]


def _distribution(optuna: Any, parameter: Parameter) -> Any:
    distributions = optuna.distributions
    if parameter.whole:
        return distributions.IntDistribution(int(parameter.low), int(parameter.high))
    return distributions.FloatDistribution(parameter.low, parameter.high, log=parameter.log)
