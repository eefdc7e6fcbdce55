"""What the sampling needs to know of the episodes that it has run."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import FloatArray


class Outcomes(NamedTuple):
    """The outcomes of some states.

    ``score`` (n, gradings) is at most 0 in the event and the greater the farther from it; +∞ where
    nothing says how far, NaN where the episode failed.  ``passed_s`` (n,) is when the ego's front
    reached the crosswalk's centre line, NaN where it did not.  ``numbers`` (n,) key everything that
    a state does not hold: the same state with the same number has the same outcome.
    """

    score: FloatArray
    passed_s: FloatArray
    numbers: NDArray[np.int64]

    @property
    def event(self) -> NDArray[np.bool_]:
        """Which states are in the event, shape (n,)."""
        event: NDArray[np.bool_] = self.score[:, 0] <= 0
        return event

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Which episodes failed, shape (n,)."""
        return np.isnan(self.score[:, 0])

    def where(self, chosen: NDArray[np.bool_]) -> "Outcomes":
        """The outcomes of the chosen states."""
        return Outcomes(self.score[chosen], self.passed_s[chosen], self.numbers[chosen])


class Evaluate(Protocol):
    """Runs episodes."""

    def __call__(
        self, z: FloatArray, what: str, numbers: NDArray[np.int64] | None = None
    ) -> Outcomes:
        """Run states of shape (n, width).

        Args:
            z: the states.
            what: their purpose, for the progress bar.
            numbers: of the episodes; None for new ones.
        """
        ...


class Counted:
    """Counts the episodes of an evaluation, and those in the event."""

    def __init__(self, evaluate: Evaluate) -> None:
        self._evaluate = evaluate
        self.episodes, self.events = 0, 0

    def __call__(
        self, z: FloatArray, what: str, numbers: NDArray[np.int64] | None = None
    ) -> Outcomes:
        """See ``Evaluate``."""
        outcomes = self._evaluate(z, what, numbers)
        self.episodes += len(z)
        self.events += int(outcomes.event.sum())
        return outcomes
