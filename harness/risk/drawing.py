"""Independent draws from a proposal, with their weights."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.encounter import FloatArray
from harness.risk.interval import Tally
from harness.risk.outcomes import Evaluate, Outcomes
from harness.risk.proposal import Cases, Proposal, cases_of


@dataclass(frozen=True, slots=True)
class Draws:
    """Draws from a proposal.

    ``event`` and ``failed`` (n,) tell what became of them; ``weight`` (n,) is that of both kinds, 0
    of the others, or 1 where the proposal is the nominal density.  ``cases`` are of the event,
    ``nominal`` counts those draws that came from the nominal density.
    """

    z: FloatArray
    numbers: NDArray[np.int64]
    event: NDArray[np.bool_]
    failed: NDArray[np.bool_]
    weight: FloatArray
    cases: Cases
    nominal: Tally


def draws_from(
    proposal: Proposal, evaluate: Evaluate, count: int, rng: np.random.Generator, what: str
) -> Draws:
    """Independent draws from a proposal, with their weights."""
    z, outcomes, nominal = proposal.draw(count, evaluate, rng, what)
    event, failed = outcomes.event, outcomes.failed
    again = evaluate if proposal.components else None
    weight = np.zeros(count) if proposal.components else np.ones(count)
    kinds = []
    for kind in (event, failed):
        own = Outcomes(outcomes.score[kind], outcomes.passed_s[kind], outcomes.numbers[kind])
        cases, _ = cases_of(proposal.layout, z[kind], own, again)
        weight[kind] = np.exp(proposal.log_weight(cases))
        kinds.append(cases)
    tally = Tally(int(nominal.sum()), int(event[nominal].sum()))
    return Draws(z, outcomes.numbers, event, failed, weight, kinds[0], tally)
