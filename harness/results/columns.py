"""The columns that numbers are made of: the tables' own, and derived ones."""

from collections.abc import Callable, Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
import pyarrow as pa

from harness.core.seeding import resampling
from harness.core.vocabulary import Ending, FloatArray
from harness.results.estimators import Sampling
from harness.scenario import Scenario
from harness.strategies.parameters import needs
from harness.strategies.registry import STRATEGIES

AV, REFERENCE = 0, 1


class PairSample(dict[str, np.ndarray]):
    """The episodes of one cell: columns of ``episodes`` or ``DERIVED``, made when asked for.

    A column is of both arms, shape (2, n) with the AV's first, or of the pairs,
    shape (n,).  Numbers are floats, NaN where undefined.

    Args:
        episodes: rows of ``episodes`` by pair, the AV's first.
        scenario: the cell's scenario.
        confidence: two-sided confidence of intervals; 0: there are none.
    """

    def __init__(self, episodes: pa.Table, scenario: Scenario, confidence: float) -> None:
        super().__init__()
        self.scenario, self.confidence, self._episodes = scenario, confidence, episodes
        self.n, self.limits = episodes.num_rows // 2, scenario.conflicts

    def __missing__(self, name: str) -> np.ndarray:
        if name in DERIVED:
            found = np.asarray(DERIVED[name](self))
        else:
            values = self._episodes[name]
            words = pa.types.is_string(values.type)
            found = np.reshape(values if words else values.cast(pa.float64()), (-1, 2)).T
        found.setflags(write=False)
        return self.setdefault(name, found)

    @cached_property
    def samplings(self) -> tuple[Sampling, Sampling]:
        """How intervals of each arm are made.

        All episodes of an arm are the same one if the people are fixed, the driver draws nothing,
        and no two episodes differ.  A pair that met nobody is no such repetition.
        """
        scenario, people, arms = self.scenario, self.scenario.pedestrians, self.scenario.arms
        fixed = not (people.anyone_comes or people.drawn) and any(self["met_someone"])
        errors = scenario.perception.draws
        exact = fixed and not (errors or _draws(arms.av))
        human = fixed and not ((errors and scenario.perception.human) or _draws(arms.human))
        rng = resampling(scenario.experiment.seed, "summary") if self.confidence else None
        av = Sampling(rng, self.confidence, exact and self._same(AV))
        return av, Sampling(rng, self.confidence, human and self._same(REFERENCE))

    def _same(self, arm: int) -> bool:
        """Whether all episodes of an arm are equal; one alone is not."""
        own = self._episodes.drop_columns(["pair"]).take(np.arange(self.n) * 2 + arm)
        return bool(self.n > 1 and own.group_by(own.column_names).aggregate([]).num_rows == 1)


def _draws(name: str) -> bool:
    """Whether a strategy may be given random numbers; nobody knows what a user's own draws."""
    return name not in STRATEGIES or "rng" in needs(STRATEGIES[name])


def _waited_s(sample: PairSample) -> FloatArray:
    """Sum of the waits at the kerb of an episode; NaN where the episode failed."""
    arrivals = sample["arrivals"]
    waited = np.where(arrivals > 0, sample["pedestrian_delay_s"] * arrivals, 0.0)
    return np.where(sample["ran"], waited, np.nan)


def _counted_times(sample: PairSample) -> FloatArray:
    """Both times of the pairs that the ratio of times counts; NaN in all others.

    These are the pairs in which neither episode failed and the AV did not crash.  A driver who has
    not passed counts with the time-out; a reference who crashed counts as driving on, if it did not
    fail after the contact.
    """
    limit_s, (av_late, human_late) = sample.scenario.experiment.timeout_s, sample["timed_out"]
    (_, human), crashed = sample["pass_time_s"], sample["crashed"][REFERENCE]
    av, untouched = _av_and_untouched_s(sample)
    av = np.where(av_late, limit_s, av)
    human = np.where(crashed, untouched, human)
    late = human_late | (crashed & np.isnan(human) & ~sample["cut"][REFERENCE])
    human = np.where(late, limit_s, human)
    counted = ~(sample["failed"].any(axis=0) | np.isnan(av) | np.isnan(human))
    return np.where(counted, [av, human], np.nan)


def _worst_times(sample: PairSample) -> FloatArray:
    """Both times of every pair, missing ones against the AV.

    An AV that crashed, failed or timed out counts with the time-out; a reference who did not pass
    counts with the time of an undisturbed passage.
    """
    av, human = _av_and_untouched_s(sample)
    av = np.where(np.isnan(av), sample.scenario.experiment.timeout_s, av)
    return np.array([av, np.where(np.isnan(human), _free_s(sample), human)])


def _free_s(sample: PairSample) -> float:
    """The time of an undisturbed passage."""
    return sample.scenario.vehicle().free_pass_time_s(sample.scenario.crosswalk())


def _av_and_untouched_s(sample: PairSample) -> tuple[FloatArray, FloatArray]:
    """The AV's time, and the reference's, who counts as driving on after a crash."""
    return sample["pass_time_s"][AV], sample["pass_time_ignoring_contact_s"][REFERENCE]


DERIVED: Mapping[str, Callable[[PairSample], Any]] = MappingProxyType({
    "every": lambda s: np.ones(s.n, dtype=bool),
    "crashed": lambda s: s["ending"] == Ending.CRASHED,
    "timed_out": lambda s: s["ending"] == Ending.TIMED_OUT,
    "failed": lambda s: s["ending"] == Ending.FAILED,
    "failed_strategy": lambda s: s["failed"] & (s["failed_in"] == "strategy"),
    "ran": lambda s: ~s["failed"],
    "cut": lambda s: np.isin(s["failed_in"], ("strategy", "engine")),
    "missed": lambda s: s["crashed"] | s["timed_out"] | s["failed_strategy"],
    "tried": lambda s: s["ran"] | s["failed_strategy"],
    "missing": lambda s: s["crashed"] | s["timed_out"] | s["failed"],
    "sumo_alone": lambda s: (s["sumo_collision"] == 1) & s["ran"] & ~s["crashed"],
    "crash_avoidable": lambda s: s["crashed"] & (s["avoidable"] == 1),
    "crash_avoidable_attentive": lambda s: s["crashed"] & (s["avoidable_attentive"] == 1),
    "met": lambda s: s["pedestrians"] > 0,
    "fell_back": lambda s: s["fallback"] > 0,
    "fell_back_met": lambda s: s["fell_back"] & s["met"],
    "counted_time_s": _counted_times,
    "worst_time_s": _worst_times,
    "worst_delay_s": lambda s: s["worst_time_s"] - _free_s(s),
    "waited_s": _waited_s,
    # A crash is a conflict of every kind.
    "conflict_pet": lambda s: s["crashed"] | (s["pet_s"] < s.limits.pet_s),
    "conflict_ttc": lambda s: s["crashed"] | (s["min_ttc_s"] < s.limits.ttc_s),
    "conflict_time_advantage": lambda s: s["crashed"] | (
        s["min_time_advantage_s"] < s.limits.time_advantage_s),
    "conflict_drac": lambda s: s["crashed"] | (s["max_drac_mps2"] > s.limits.drac_mps2),
    "met_someone": lambda s: np.any(s["met"], axis=0),
    "met_nobody": lambda s: ~np.any(s["met"], axis=0) & ~np.any(s["failed"], axis=0),
    "tau": lambda s: np.divide(*s["pass_time_s"]),
    "tau_all": lambda s: np.divide(*_av_and_untouched_s(s)),
    "tau_worst": lambda s: np.divide(*s["worst_time_s"]),
    "delay_difference_s": lambda s: np.subtract(*_av_and_untouched_s(s)),
    "not_in_time_ratio": lambda s: np.isnan(s["counted_time_s"][AV]),
    "in_mu": lambda s: ~np.isnan(s["tau"]),
})  # fmt: skip
"""Columns that are derived from those of ``episodes``.

``tau`` is the AV's time over the reference's, NaN where either did not cross; in ``tau_all`` and
``delay_difference_s`` a reference who crashed counts as driving on; ``tau_worst`` is of every pair.
"""
