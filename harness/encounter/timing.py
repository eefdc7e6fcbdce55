"""The wall time of a strategy's decisions, which is measured only where it is asked for."""

from time import perf_counter

from harness.core.encounter import Observation, Strategy


class TimedStrategy:
    """Drives as a strategy does, and adds the wall time of each decision to ``decisions_s``."""

    def __init__(self, strategy: Strategy, decisions_s: list[float]) -> None:
        self._strategy, self._decide, self._note = strategy, strategy.decide, decisions_s.append

    @property
    def fallback(self) -> bool:
        """See ``Strategy``."""
        return bool(getattr(self._strategy, "fallback", False))

    def decide(self, observation: Observation) -> float | None:
        """See ``Strategy.decide``."""
        begin_s = perf_counter()
        command = self._decide(observation)
        self._note(perf_counter() - begin_s)
        return command
