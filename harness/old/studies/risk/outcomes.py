"""The outcomes of episodes that the sampling needs."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import FloatArray


class Outcomes(NamedTuple):
    """The outcomes of some states.

    ``score`` (n, gradings) is at most 0 in the event and increases with the distance from it.  It
    is +∞ if the distance is unknown and NaN if the episode failed.  ``numbers`` (n,) are the keys
    of all randomness outside the state, so equal states with equal numbers have equal outcomes.

    The others describe a crowd.  ``passed_s`` and ``passed_mps`` (n,) are the time at which the
    ego's front reached the centre line of the crosswalk and its speed then; NaN if it did not.
    ``culprit`` (n,) is the place of the pedestrian to whom the event is due; −1 without an event,
    and if it is due to nobody in the crowd.  ``own`` (n, gradings) is the score that the episode
    would have if only the pedestrian whom the caller asked for were there.
    """

    score: FloatArray
    numbers: NDArray[np.int64]
    passed_s: FloatArray
    passed_mps: FloatArray
    culprit: NDArray[np.int64]
    own: FloatArray

    @property
    def event(self) -> NDArray[np.bool_]:
        """Whether each state is in the event, shape (n,)."""
        event: NDArray[np.bool_] = self.score[:, 0] <= 0
        return event

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether each episode failed, shape (n,)."""
        return np.isnan(self.score[:, 0])


class Evaluate(Protocol):
    """Runs episodes."""

    def __call__(
        self,
        z: FloatArray,
        what: str,
        numbers: NDArray[np.int64] | None = None,
        asked: NDArray[np.int64] | None = None,
    ) -> Outcomes:
        """Run states of shape (n, width).

        Args:
            z: the states.
            what: purpose of the episodes, for the progress bar.
            numbers: numbers of the episodes; None for new numbers.
            asked: place in the crowd of each state's pedestrian whose own score is wanted; −1 for
                everybody who is not in the crowd.  None: own scores are not wanted and are +∞.
        """
        ...


class Counted:
    """Counts the episodes of an evaluation and the events among them."""

    def __init__(self, evaluate: Evaluate) -> None:
        self._evaluate = evaluate
        self.episodes, self.events = 0, 0

    def __call__(
        self,
        z: FloatArray,
        what: str,
        numbers: NDArray[np.int64] | None = None,
        asked: NDArray[np.int64] | None = None,
    ) -> Outcomes:
        """See ``Evaluate``."""
        outcomes = self._evaluate(z, what, numbers, asked)
        self.episodes += len(z)
        self.events += int(outcomes.event.sum())
        return outcomes
