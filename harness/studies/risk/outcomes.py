"""The outcomes of episodes that the sampling needs."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import FloatArray


class Outcomes(NamedTuple):
    """The outcomes of some states.

    ``score`` (n, gradings) is at most 0 in the event and increases with the distance from it.  It
    is +∞ if the distance is unknown and NaN if the episode failed.  ``passed_s`` (n,) is the time
    at which the ego's front reached the centre line of the crosswalk; NaN if it did not.
    ``numbers`` (n,) are the keys of all randomness outside the state, so equal states with equal
    numbers have equal outcomes.
    """

    score: FloatArray
    passed_s: FloatArray
    numbers: NDArray[np.int64]

    @property
    def event(self) -> NDArray[np.bool_]:
        """Whether each state is in the event, shape (n,)."""
        event: NDArray[np.bool_] = self.score[:, 0] <= 0
        return event

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether each episode failed, shape (n,)."""
        return np.isnan(self.score[:, 0])

    def where(self, chosen: NDArray[np.bool_]) -> "Outcomes":
        """Return the outcomes of the chosen states."""
        return Outcomes(self.score[chosen], self.passed_s[chosen], self.numbers[chosen])


class Evaluate(Protocol):
    """Runs episodes."""

    def __call__(
        self, z: FloatArray, what: str, numbers: NDArray[np.int64] | None = None
    ) -> Outcomes:
        """Run states of shape (n, width).

        Args:
            z: the states.
            what: purpose of the episodes, for the progress bar.
            numbers: numbers of the episodes; None for new numbers.
        """
        ...


class Counted:
    """Counts the episodes of an evaluation and the events among them."""

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
