"""Ties of a strategy: on two engines it sees equal observations and returns different commands.

Positions on two engines differ by about 1e-14 m.  A strategy that minimises over several costs or
compares with a threshold may then decide differently, although neither engine is wrong.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from harness.core.encounter import Observation, Strategy
from harness.core.errors import StrategyError
from harness.episode.deciding import limited

SAME = 1e-9
"""Values that differ by at most this are equal."""


class Decision(NamedTuple):
    """The observation of a step and the command in m/s² (None: the engine's own driver)."""

    shown: Observation
    command: float | None


class RecordingStrategy:
    """Drives as a strategy does, and records each observation and command in ``decisions``."""

    def __init__(self, strategy: Strategy, decisions: list[Decision]) -> None:
        self._strategy, self._decide, self._decisions = strategy, strategy.decide, decisions

    @property
    def fallback(self) -> bool:
        """See ``Strategy``."""
        return bool(getattr(self._strategy, "fallback", False))

    def decide(self, observation: Observation) -> float | None:
        """See ``Strategy.decide``."""
        command = self._decide(observation)
        self._decisions.append(Decision(observation, command))
        return command


def tie_s(steps: Sequence[Decision], other_steps: Sequence[Decision]) -> float | None:
    """The time in s of the first step at which the commands on two engines differ.

    It is None if an earlier observation differs by more than ``SAME``, or if no command differs:
    then the strategy is not the reason why two records differ.  It is also None if all observations
    until then are equal to the last bit: such a strategy is not reproducible, which is not a tie.

    Args:
        steps: the steps of an episode on one engine, in order.
        other_steps: the steps of the same episode on another engine.
    """
    identical = True
    for step, other in zip(steps, other_steps, strict=False):
        if not _same(step.shown, other.shown):
            return None
        identical = identical and step.shown == other.shown
        if not _same(_speed_mps(step), _speed_mps(other)):
            return None if identical else step.shown.time_s
    return None


def _speed_mps(step: Decision) -> float | None:
    """The commanded speed at the end of a step; None if there is no valid command."""
    shown, command = step
    if command is None:
        return None
    try:
        wanted = limited(command, shown.vehicle, shown.time_s)
    except StrategyError:  # the episode ends here
        return None
    return max(0.0, shown.ego.speed_mps + wanted * shown.step_s)


def _same(value: Any, other: Any) -> bool:
    if isinstance(value, tuple) and isinstance(other, tuple):
        return len(value) == len(other) and all(map(_same, value, other))
    if isinstance(value, float) and isinstance(other, float):
        return abs(value - other) <= SAME
    return bool(value == other)
