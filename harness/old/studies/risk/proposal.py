"""Returns weighted draws from a mixture of normal densities around the explored events.

A component draws the normal scores of the fixed uniforms.  The nominal density has the share
``NOMINAL_SHARE`` of the proposal, so no weight exceeds 1/``NOMINAL_SHARE``, even if the exploration
missed a way to the event.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.core.encounter import FloatArray
from harness.old.studies.risk.interval import Tally
from harness.old.studies.risk.layout import Layout
from harness.old.studies.risk.outcomes import Evaluate, Outcomes

NOMINAL_SHARE = 0.1
"""Share of the draws that come from the nominal density."""


@dataclass(frozen=True, slots=True)
class Component:
    """A normal density over the fixed uniforms.

    ``mean`` has shape (d,).  ``factor`` (d, d) is the lower Cholesky factor of the covariance.
    """

    share: float
    mean: FloatArray
    factor: FloatArray

    def log_ratio(self, z: FloatArray) -> FloatArray:
        """Return ln(component's density / nominal density) at z (n, d), shape (n,)."""
        scaled = (z - self.mean) @ np.linalg.inv(self.factor).T
        ratio: FloatArray = (_squares(z) - _squares(scaled)) / 2
        ratio -= np.log(np.diag(self.factor)).sum()
        return ratio


def _squares(y: FloatArray) -> FloatArray:
    squares: FloatArray = np.einsum("ij,ij->i", y, y)
    return squares


@dataclass(frozen=True, slots=True)
class Proposal:
    """A mixture of ``components`` and the nominal density, which has the remaining share.

    With a crowd there are no components: the proposal is the nominal density, for brute force.
    """

    layout: Layout
    components: tuple[Component, ...]

    @property
    def nominal_share(self) -> float:
        """Share of the draws that come from the nominal density."""
        return NOMINAL_SHARE if self.components else 1.0

    def draw(
        self, count: int, evaluate: Evaluate, rng: np.random.Generator, what: str
    ) -> tuple[FloatArray, Outcomes, NDArray[np.bool_]]:
        """Draw independent states and run them.

        Args:
            count: number of states.
            evaluate: runs the states.
            rng: generator for the states.
            what: purpose of the episodes, for the progress bar.

        Returns:
            The states (n, width), their outcomes, and whether each is a nominal draw (n,).
        """
        z = self.layout.draw(count, rng)
        ends = np.cumsum([self.nominal_share, *(part.share for part in self.components)])
        chosen = np.searchsorted(ends, rng.random(count), side="right")
        chosen = np.minimum(chosen, len(self.components))
        for k, part in enumerate(self.components, 1):
            rows = np.flatnonzero(chosen == k)
            z[rows] = part.mean + rng.standard_normal((len(rows), len(part.mean))) @ part.factor.T
        return z, evaluate(z, what), chosen == 0

    def log_weight(self, z: FloatArray) -> FloatArray:
        """Return ln(nominal density / proposal density), (n,), at most −ln ``NOMINAL_SHARE``."""
        ratio = np.full(len(z), self.nominal_share)
        for part in self.components:
            ratio += part.share * np.exp(part.log_ratio(z))
        weight: FloatArray = -np.log(ratio)
        return weight


def nominal(layout: Layout) -> Proposal:
    """Return the nominal density alone, for brute force."""
    return Proposal(layout, ())


class Draws(NamedTuple):
    """Independent draws from a proposal.

    ``event`` and ``failed`` (n,) are the draws' outcomes.  ``weight`` (n,) is φ/q for draws in the
    event and for failed draws, and 0 for all others; if the proposal is the nominal density, it is
    1 for all draws.  ``nominal`` counts the draws from the nominal density.
    """

    z: FloatArray
    outcomes: Outcomes
    weight: FloatArray
    nominal: Tally

    @property
    def event(self) -> NDArray[np.bool_]:
        """Whether each draw is in the event, shape (n,)."""
        return self.outcomes.event


def draws_from(
    proposal: Proposal, evaluate: Evaluate, count: int, rng: np.random.Generator, what: str
) -> Draws:
    """Draw from a proposal, run the episodes and weight them."""
    z, outcomes, nominal = proposal.draw(count, evaluate, rng, what)
    weight = np.zeros(count) if proposal.components else np.ones(count)
    for kind in (outcomes.event, outcomes.failed):
        weight[kind] = np.exp(proposal.log_weight(z[kind]))
    tally = Tally(int(nominal.sum()), int(outcomes.event[nominal].sum()))
    return Draws(z, outcomes, weight, tally)
