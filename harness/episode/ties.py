"""Ties of a strategy: it was shown the same by two engines, and asked for something else.

Positions of two engines differ by some 1e-14 m.  A strategy that takes the least of several costs,
or compares with a threshold, may then choose otherwise: no engine is wrong.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from harness.core.encounter import Observation, Strategy
from harness.core.errors import StrategyError
from harness.episode.deciding import limited

SAME = 1e-9
"""Values that differ by no more were shown, or asked for, alike."""


class Asked(NamedTuple):
    """What a strategy was shown at a step, and its command in m/s² (None: the engine's driver)."""

    shown: Observation
    command: float | None


class Witness:
    """Drives as a strategy does, and notes every answer in ``asked``."""

    def __init__(self, strategy: Strategy, asked: list[Asked]) -> None:
        self._strategy, self._decide, self._asked = strategy, strategy.decide, asked

    @property
    def fallback(self) -> bool:
        """See ``Strategy``."""
        return bool(getattr(self._strategy, "fallback", False))

    def decide(self, observation: Observation) -> float | None:
        """See ``Strategy.decide``."""
        command = self._decide(observation)
        self._asked.append(Asked(observation, command))
        return command


def tie_s(one: Sequence[Asked], other: Sequence[Asked]) -> float | None:
    """The time of the first step at which the car is asked for something else, in s.

    None where anything shown until then differs by more than ``SAME``, or no command ever does:
    then the strategy is not why two records differ.  None, too, where all that was shown until then
    is equal to the last bit: such a strategy is not reproducible, and that is no tie.

    Args:
        one: everything that was asked in an episode on one engine, in order.
        other: in the same episode on another engine.
    """
    identical = True
    for mine, theirs in zip(one, other, strict=False):
        if not _same(mine.shown, theirs.shown):
            return None
        identical = identical and mine.shown == theirs.shown
        if not _same(_speed_mps(mine), _speed_mps(theirs)):
            return None if identical else mine.shown.time_s
    return None


def _speed_mps(asked: Asked) -> float | None:
    """The speed at the end of the step, which is all that an engine is told; None where none is."""
    shown, command = asked
    if command is None:
        return None
    try:
        wanted = limited(command, shown.vehicle, shown.time_s)
    except StrategyError:  # the episode ends here
        return None
    return max(0.0, shown.ego.speed_mps + wanted * shown.step_s)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) <= SAME
    return bool(one == other)
