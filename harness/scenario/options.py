"""How a run is carried out; nothing of it changes what one pair gives."""

from dataclasses import dataclass
from typing import Literal, get_args

from harness.errors import unknown_name
from harness.scenario.scenario import Scenario

EngineName = Literal["sumo", "plain"]
"""SUMO, or the same kinematics in plain Python."""


def engine_named(name: str, where: str = "engine") -> EngineName:
    """The engine of that name.

    Raises:
        InputError: there is none; ``where`` says what was given.
    """
    for engine in get_args(EngineName):
        if engine == name:
            found: EngineName = engine
            return found
    raise unknown_name(where, "engine", str(name), get_args(EngineName))


AUDIT_SHARE = 0.01
"""Share of the pairs that the plain engine's runs repeat in SUMO."""

TASK_PAIRS = 50
"""Pairs in a task."""

HANG_AFTER_S = 120.0
HANG_AFTER_S_PER_STEP = 0.002
"""A worker that finishes no pair for so long, and so long for each of its steps, is ended."""


@dataclass(frozen=True)
class Precision:
    """``--until``: go on until the half-width of every cell's interval is this small.

    ``measure`` is ``mu`` or ``kappa``.
    """

    measure: str
    half_width: float


@dataclass(frozen=True)
class Options:
    """Options of a run beside the study.

    ``workers`` None means all cores, 0 this process, without time limits.  ``sumo_outputs`` says
    whose SUMO outputs are written.  With the plain ``engine`` that share of the pairs
    (``audit``), and every crash, is repeated in SUMO.
    """

    traces: bool = False
    until: Precision | None = None
    workers: int | None = None
    hang_after_s: float = HANG_AFTER_S
    task_pairs: int = TASK_PAIRS
    sumo_outputs: Literal["all", "crashed"] | None = None
    engine: EngineName = "sumo"
    audit: float = AUDIT_SHARE


def hang_limit_s(hang_after_s: float, scenario: Scenario) -> float:
    """How long a worker may take for one pair of a scenario, or for one arm of an hour."""
    traffic, experiment = scenario.traffic, scenario.experiment
    simulated_s = 2 * experiment.timeout_s
    if traffic is not None:
        # A road full of vehicles: some ten times an ego's work.
        simulated_s = 10 * (traffic.warm_up_s + 2 * traffic.duration_s + 900)
    return hang_after_s + simulated_s / experiment.step_s * HANG_AFTER_S_PER_STEP
