"""Options for executing a run; none of them changes the result of a pair."""

import math
import operator
from numbers import Real
from typing import Literal, get_args

from harness.core.errors import InputError, unknown_name
from harness.scenario.scenario import Scenario

EngineName = Literal["sumo", "plain"]
"""SUMO, or the same kinematics in plain Python."""


def engine_named(name: str, where: str = "engine") -> EngineName:
    """The engine with a given name.

    Raises:
        InputError: there is no such engine; ``where`` names the option.
    """
    for engine in get_args(EngineName):
        if engine == name:
            known: EngineName = engine
            return known
    raise unknown_name(where, "engine", str(name), get_args(EngineName))


HANG_AFTER_S = 120.0
HANG_AFTER_S_PER_STEP = 0.002
"""A worker's time limit for a pair is the first time plus the second one for each step."""


def whole_number(where: str, value: object, least: int) -> int:
    """A whole number of Python or NumPy, at least ``least``, as an ``int``.

    Raises:
        InputError: the value is anything else; ``where`` names the option.
    """
    try:
        if isinstance(value, bool):
            raise TypeError
        number = operator.index(value)  # type: ignore[arg-type]  # raises unless it is an integer
    except TypeError:
        number = least - 1
    if number < least:
        raise InputError(where, f"{value!r} is not accepted", f"a whole number, {least} or more")
    return number


def number_in(where: str, value: object, least: float, most: float) -> float:
    """A number of Python or NumPy, from ``least`` to ``most``, as a ``float``.

    Raises:
        InputError: the value is anything else; ``where`` names the option.
    """
    number = float(value) if isinstance(value, Real) else math.nan
    if not least <= number <= most:
        allowed = f"{least:g} or more" if math.isinf(most) else f"a number, {least:g} to {most:g}"
        raise InputError(where, f"{value!r} is not accepted", allowed)
    return number


def hang_limit_s(hang_after_s: float, scenario: Scenario) -> float:
    """Time limit of a worker for one pair of a scenario, or for one arm of an hour."""
    traffic, experiment = scenario.traffic, scenario.experiment
    simulated_s = 2 * experiment.timeout_s
    if traffic is not None:
        # A road full of vehicles takes about ten times the work of one ego.
        simulated_s = 10 * (traffic.warm_up_s + 2 * traffic.duration_s + 900)
    if scenario.simulation is not None:
        # Nothing bounds the number of vehicles of a user's scenario.
        return math.inf
    return hang_after_s + simulated_s / experiment.step_s * HANG_AFTER_S_PER_STEP
