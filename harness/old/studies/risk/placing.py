"""Returns weighted draws in which a pedestrian is placed into a flow where the ego is in danger.

A *unit* is an independent draw.  It begins with a nominal flow ξ and fixed uniforms f, and its
episode is run.  The time T at which the ego passes and its speed s then say where a pedestrian
would be in its way.  A number of pedestrians, K(s) in the mean, are drawn from a density
g(x | f, s) of their arrival after T and their other uniforms, and the episode is run again with
each of them.

Every event is due to one pedestrian (the *culprit*), who is a function of the episode.  So by
Mecke's formula (Last & Penrose, Lectures on the Poisson process, theorem 4.1) the events whose
culprit is x = (t, m) have in the units, relative to the nominal density, the frequency

    q₀(f)/φ(f) (1 + K(s) g(x | f, s)/(λ φ(m))),

where T and s are those of the flow without x.  The first term is of the unit's first episode, the
second of the placed pedestrians.  The weight of an event is the inverse (the balance heuristic,
Veach & Guibas 1995).  An event that is due to nobody in the flow has the first term alone.  So the
mean weight of a unit is the probability, and without fixed uniforms no weight exceeds 1.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from harness.core.encounter import FloatArray
from harness.old.studies.risk.interval import Tally
from harness.old.studies.risk.layout import Layout
from harness.old.studies.risk.normals import Normals
from harness.old.studies.risk.outcomes import Evaluate, Outcomes
from harness.old.studies.risk.proposal import NOMINAL_SHARE

_FARTHEST = 8.0
"""Standard normal numbers beyond it have a probability of 1e-15, and are not drawn."""


class Units(NamedTuple):
    """Draws of a proposal.

    ``value`` and ``failed`` (n,) are the sums of the weights of each unit's events and failed
    episodes.  ``z``, ``numbers`` and ``weight`` describe the events, and ``points`` (events,
    fixed + 1 + m) their fixed uniforms, s, t − T and m; NaN if nobody of the flow is the culprit.
    ``missed`` says of each event whether the placed pedestrians reach it less often than chance.

    ``first`` are the outcomes of the n first episodes, ``fixed`` (n, fixed) their fixed uniforms,
    and ``fixed_weight`` (n,) φ/q₀ of the latter.  ``tried`` (k, fixed + 1 + m) are the points
    of the k placed pedestrians, ``own`` (k, gradings) their own scores, ``hit`` whether they are
    the culprits, and ``likely`` (k,) the inverse of the density from which they were drawn,
    relative to the nominal one.
    """

    value: FloatArray
    failed: FloatArray
    z: FloatArray
    numbers: NDArray[np.int64]
    weight: FloatArray
    points: FloatArray
    missed: NDArray[np.bool_]
    nominal: Tally
    fixed: FloatArray
    fixed_weight: FloatArray
    first: Outcomes
    tried: FloatArray
    own: FloatArray
    hit: NDArray[np.bool_]
    likely: FloatArray


@dataclass(frozen=True, slots=True)
class Placing:
    """The densities of the fixed uniforms and of the placed pedestrians.

    ``fixed`` is the density of the fixed uniforms, beside the nominal one; None: the nominal one
    alone.  ``placed`` is the density of f, s, t − T and m; None: a placed pedestrian is like all
    others, and arrives at any time.  ``counts`` are the mean numbers of placed pedestrians between
    the speeds ``edges_mps``.
    """

    layout: Layout
    fixed: Normals | None
    placed: Normals | None
    edges_mps: FloatArray
    counts: FloatArray

    def draw(self, count: int, evaluate: Evaluate, rng: np.random.Generator, what: str) -> Units:
        """Draw independent units and run their episodes.

        Args:
            count: number of units.
            evaluate: runs the episodes.
            rng: generator for the units.
            what: purpose of the episodes, for the progress bar.
        """
        layout = self.layout
        z = layout.draw(count, rng)
        nominal = np.ones(count, dtype=bool)
        if self.fixed is not None:
            nominal = rng.random(count) < NOMINAL_SHARE
            drawn = self.fixed.draw(count, rng)
            z[:, : layout.fixed] = np.where(nominal[:, None], z[:, : layout.fixed], drawn)
        asked = np.full(count, -1) if layout.fixed else None
        first = evaluate(z, what, None, asked)
        known = np.column_stack([z[:, : layout.fixed], first.passed_mps])
        places = np.floor(self._count(known) + rng.random(count)).astype(int)
        row = np.repeat(np.arange(count), places)
        who = self._pedestrians(known[row], rng, first.passed_s[row])
        arrival_s = first.passed_s[row] + who[:, 0]
        inside = (arrival_s > 0) & (arrival_s < layout.window_s)
        inside &= (np.abs(who[:, 1:]) < _FARTHEST).all(axis=1)
        row, who, arrival_s = row[inside], who[inside], arrival_s[inside]
        crowds, place = layout.joined(z[row], arrival_s, who[:, 1:])
        placed = evaluate(crowds, f"{what}, with a placed pedestrian", first.numbers[row], place)
        hit = placed.event & (placed.culprit == place)
        tried = np.column_stack([known[row], who])
        rates = self._rates(tried)
        base, own_weight = self._without_culprits(z, first, evaluate, what)
        weights = [own_weight, 1 / (self._fixed_ratio(tried) * (1 + rates))]
        value, failed = np.zeros(count), np.zeros(count)
        value[first.event], failed[first.failed] = own_weight[first.event], own_weight[first.failed]
        value += np.bincount(row[hit], weights[1][hit], count)
        failed += np.bincount(row[placed.failed], weights[1][placed.failed], count)
        reached = np.concatenate([self._rates(base)[first.event], rates[hit]])
        return Units(
            value,
            failed,
            np.concatenate([z[first.event], crowds[hit]]),
            np.concatenate([first.numbers[first.event], placed.numbers[hit]]),
            np.concatenate([own_weight[first.event], weights[1][hit]]),
            np.concatenate([base[first.event], tried[hit]]),
            reached < 1,
            Tally(int(nominal.sum()), int(first.event[nominal].sum())),
            z[:, : layout.fixed],
            1 / self._fixed_ratio(z[:, : layout.fixed]),
            first,
            tried,
            placed.own,
            hit,
            1 / (self._fixed_ratio(tried) * rates),
        )

    def _without_culprits(
        self, z: FloatArray, first: Outcomes, evaluate: Evaluate, what: str
    ) -> tuple[FloatArray, FloatArray]:
        """Return the points of the first episodes' culprits, and the weights of the episodes.

        Each event runs again without its culprit.  The point is NaN if there is no culprit, or if
        the ego does not pass without them: such an event cannot come from a placed pedestrian.
        """
        layout = self.layout
        points = np.full((len(z), layout.fixed + 1 + layout.marks), np.nan)
        points[:, : layout.fixed] = z[:, : layout.fixed]
        (row,) = np.nonzero(first.culprit >= 0)
        place = first.culprit[row]
        if len(row):
            fewer = evaluate(
                layout.without(z[row], place), f"{what}, without the culprit", first.numbers[row]
            )
            points[row, layout.fixed] = fewer.passed_mps
            points[row, layout.fixed + 1] = layout.arrivals_s(z)[row, place] - fewer.passed_s
            points[row, layout.fixed + 2 :] = layout.people(z)[row, place, 1:]
        return points, 1 / (self._fixed_ratio(points) * (1 + self._rates(points)))

    def _count(self, known: FloatArray) -> FloatArray:
        """Return K(s) for fixed uniforms and speeds (n, fixed + 1); 0 if the ego did not pass."""
        speed = known[:, -1]
        counts = self.counts[np.searchsorted(self.edges_mps, speed)]
        return np.where(np.isnan(speed), 0.0, counts)

    def _pedestrians(
        self, known: FloatArray, rng: np.random.Generator, passed_s: FloatArray
    ) -> FloatArray:
        """Return t − T and m of one pedestrian for each of the passages, (n, marks)."""
        if self.placed is not None:
            return self.placed.given(known).draw(rng)
        who = rng.standard_normal((len(known), self.layout.marks))
        who[:, 0] = self.layout.window_s * ndtr(who[:, 0]) - passed_s
        return who

    def _rates(self, points: FloatArray) -> FloatArray:
        """Return K(s) g(x | f, s)/(λ φ(m)) at points, (n,); 0 at points with NaN."""
        layout, rates = self.layout, np.zeros(len(points))
        known = ~np.isnan(points).any(axis=1)
        y = points[known]
        count, who = self._count(y[:, : layout.fixed + 1]), y[:, layout.fixed + 1 :]
        if self.placed is None:
            rates[known] = count / layout.mean_count
        else:
            density = self.placed.given(y[:, : layout.fixed + 1]).density(who)
            rates[known] = count * density / (layout.rate_per_s * _standard(who[:, 1:]))
        return rates

    def _fixed_ratio(self, points: FloatArray) -> FloatArray:
        """Return q₀(f)/φ(f) at points, (n,)."""
        if self.fixed is None:
            return np.ones(len(points))
        f = points[:, : self.layout.fixed]
        return NOMINAL_SHARE + (1 - NOMINAL_SHARE) * self.fixed.density(f) / _standard(f)


def _standard(z: FloatArray) -> FloatArray:
    """Return the standard normal density at z (n, d), shape (n,)."""
    return np.asarray(np.exp(-np.einsum("ij,ij->i", z, z) / 2) / (2 * np.pi) ** (z.shape[1] / 2))
