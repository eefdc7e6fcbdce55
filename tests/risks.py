"""Events whose probability is known in closed form, in standard normal space."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from harness.results.finding import Finding
from harness.results.tables import DRAWS
from harness.studies.risk.draws import (
    DrawInputs,
    DrawOutcome,
    Proposal,
    RunDraws,
    Units,
    draw_units,
)
from harness.studies.risk.estimate import MOST_DRAWS, risk_findings
from harness.studies.risk.learning import rounds_of
from harness.studies.risk.space import GRADINGS, Space

DIMENSIONS = 6

FLAT = Space(tuple("quantile" for _ in range(DIMENSIONS)))
CROWD = Space(("quantile",), ("quantile",), rate_per_s=0.5, window_s=8.0)

Case = tuple[RunDraws, float]


def drawn(proposal: Proposal, space: Space, round_: int, count: int, run: RunDraws) -> Units:
    """Units without a folder, drawn and run in this process."""
    return Units.of(DRAWS.of(draw_units(proposal, space, round_, range(count), run)))


def rounds(run: RunDraws, space: Space, seed: int, target_cv: float = 0.1) -> list[Units]:
    """All rounds of a risk with a seed."""
    seeded = space._replace(seed=seed)

    def draw(proposal: Proposal, round_: int, count: int) -> Units:
        return drawn(proposal, seeded, round_, count, run)

    return rounds_of(draw, seeded, np.random.default_rng(seed), target_cv, MOST_DRAWS)


def found(run: RunDraws, space: Space, seed: int, target_cv: float = 0.1) -> dict[str, Finding]:
    """The numbers of a risk with a seed."""
    return risk_findings(rounds(run, space, seed, target_cv))


def gain(numbers: dict[str, Finding]) -> float:
    """How many times more episodes brute force takes for the same coefficient of variation."""
    return numbers["brute_force_episodes"].count / numbers["episodes"].count


def holds(numbers: dict[str, Finding], truth: float) -> bool:
    """Whether the interval holds the truth."""
    of = numbers["probability"]
    return of.low is not None and of.high is not None and of.low <= truth <= of.high


def is_true(numbers: dict[str, Finding], truth: float) -> bool:
    """Whether what is said holds: the interval's lower end, and the bound of all ways."""
    low, high = numbers["probability"].low or 0.0, numbers["all_ways_high"].value
    assert high is not None
    return low <= truth <= high


def scored(score: Callable[[np.ndarray], np.ndarray]) -> RunDraws:
    """Episodes that are nothing but their score, shape (n,), a function of the fixed numbers."""

    def run(episodes: Sequence[DrawInputs]) -> list[DrawOutcome]:
        if not episodes:
            return []
        scores = score(np.array([each.fixed for each in episodes])).tolist()
        return [DrawOutcome(of <= 0, scores=(of,) * GRADINGS) for of in scores]

    return run


def half_space(p: float) -> Case:
    """Beyond a plane at distance Φ⁻¹(1 − p) from the origin, oblique to every axis."""
    return scored(lambda z: stats.norm.isf(p) - z.sum(axis=1) / math.sqrt(DIMENSIONS)), p


def union(p: float) -> Case:
    """Beyond either of two planes at right angles: 1 − (1 − p₁)(1 − p₂)."""
    one, two = 0.7 * p, 0.3 * p
    far = np.array(stats.norm.isf([one, two]))

    def score(z: np.ndarray) -> np.ndarray:
        return np.minimum(far[0] - z[:, 0], far[1] - (0.8 * z[:, 2] - 0.6 * z[:, 1]))

    return scored(score), 1 - (1 - one) * (1 - two)


def fault(share: float) -> Case:
    """A half-space of 1e-5, and a fault to which no score leads: in a share of all states 0.2 more.

    The half-space lies in the first coordinate, the fault in the last two: they are independent.
    """
    half, hit = 1e-5, 0.2

    def score(z: np.ndarray) -> np.ndarray:
        dead = (z[:, -1] < stats.norm.ppf(share)) & (z[:, -2] < stats.norm.ppf(hit))
        return np.where(dead, -1.0, stats.norm.isf(half) - z[:, 0])

    return scored(score), 1 - (1 - half) * (1 - share * hit)


def crowd(p: float) -> Case:
    """Hit are the slow who come within h of the ego's passage: 4 s + z/10, 1 s more for each early.

    Early is who comes before 3 s, slow whose mark is above c.  Those who come near the passage are
    Poisson, and independent of the early ones: p = E[1 − exp(−λ P(slow) length)], where the length
    is that of [T − h, T + h] within the window.
    """
    half_s, rate, window_s = 0.1, CROWD.rate_per_s, CROWD.window_s
    slow = p / rate / (2 * half_s)
    limit = float(stats.norm.isf(slow))
    early = np.arange(12)
    z, weight = np.polynomial.hermite_e.hermegauss(200)
    length_s = np.clip(window_s + half_s - (4.0 + z[:, None] / 10 + early), 0.0, 2 * half_s)
    hit = 1 - np.exp(-rate * slow * length_s)
    truth = float(weight / weight.sum() @ hit @ stats.poisson.pmf(early, 3.0 * rate))

    def outcome(episode: DrawInputs) -> DrawOutcome:
        arrivals_s, marks = episode.people.T
        passed_s = 4.0 + episode.fixed[0] / 10 + (arrivals_s < 3.0).sum()
        away = np.maximum(np.abs(arrivals_s - passed_s) - half_s, 0.0)
        away += np.maximum(limit - marks, 0.0)
        (met,) = np.nonzero(away <= 0)
        asked = episode.asked
        own = math.inf if asked is None else float(away[asked])
        first = int(met[0]) if len(met) else None  # whoever of them comes first is the culprit
        return DrawOutcome(len(met) > 0, first, (own,) * GRADINGS, float(passed_s), 1.0)

    return lambda episodes: [*map(outcome, episodes)], truth
