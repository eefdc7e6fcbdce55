"""A cell's episodes as aligned columns: one entry for each pair, of both arms or of the pair."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from harness.core.encounter import Ending, FloatArray
from harness.core.errors import unknown_name
from harness.core.seeding import resampling
from harness.results.estimators import Sampling
from harness.scenario import Scenario
from harness.strategies.parameters import needs
from harness.strategies.registry import STRATEGIES

BothArms = tuple[np.ndarray, np.ndarray]
"""Aligned columns of the AV's and of the reference's arm, one entry for each pair."""

AV, REFERENCE = 0, 1


class Sample:
    """The episodes of one cell.

    Args:
        episodes: rows of ``episodes`` by pair, the AV's first.
        scenario: the cell's scenario.
        confidence: two-sided confidence of intervals; 0: there are none.
    """

    def __init__(self, episodes: pa.Table, scenario: Scenario, confidence: float) -> None:
        self.scenario, self._episodes = scenario, episodes
        self.n = episodes.num_rows // 2
        rng = resampling(scenario.experiment.seed, "summary") if confidence else None
        self.sampling = Sampling(rng, confidence)
        self._arms: dict[str, BothArms] = {}
        self._pairs: dict[str, np.ndarray] = {}

    def arms(self, name: str) -> BothArms:
        """A column of ``episodes`` or of ``ARM_COLUMNS``: floats with NaN if undefined, or bool.

        Raises:
            InputError: there is no such column.
        """
        if name not in self._arms:
            if name in ARM_COLUMNS:
                self._arms[name] = ARM_COLUMNS[name](self)
            elif name in self._episodes.column_names:
                values = self._episodes[name].cast(pa.float64()).to_numpy()
                self._arms[name] = values[::2], values[1::2]
            else:
                known = [*ARM_COLUMNS, *self._episodes.column_names]
                raise unknown_name("column", "column", name, known)
        return self._arms[name]

    def pairs(self, name: str) -> np.ndarray:
        """A column of ``PAIR_COLUMNS``."""
        if name not in self._pairs:
            self._pairs[name] = PAIR_COLUMNS[name](self)
        return self._pairs[name]

    def words(self, name: str) -> tuple[list[Any], list[Any]]:
        """A column of text of ``episodes``, of both arms; None where it is empty."""
        values = self._episodes[name].to_pylist()
        return values[::2], values[1::2]

    @property
    def repeated(self) -> tuple[bool, bool]:
        """Whether all episodes of each arm repeat the same one: nothing in them is random.

        They do if the people are fixed, the driver draws nothing, and no two episodes differ.  A
        pair that met nobody is no such repetition.
        """
        scenario, people = self.scenario, self.scenario.pedestrians
        if people.anyone_comes or people.drawn or not self.pairs("met_someone").any():
            return False, False
        errors, arms = scenario.perception.draws, scenario.arms
        av = not (errors or _draws(arms.av)) and self._same(AV)
        human = not ((errors and scenario.perception.human) or _draws(arms.human))
        return av, human and self._same(REFERENCE)

    def _same(self, arm: int) -> bool:
        own = self._episodes.drop_columns(["pair"]).take(np.arange(self.n) * 2 + arm)
        distinct: int = own.group_by(own.column_names).aggregate([]).num_rows
        return self.n > 1 and distinct == 1


def _draws(name: str) -> bool:
    """Whether a strategy may be given random numbers; nobody knows what a user's own draws."""
    return name not in STRATEGIES or "rng" in needs(STRATEGIES[name])


def _each(function: Callable[[Sample, int], np.ndarray]) -> Callable[[Sample], BothArms]:
    return lambda sample: (function(sample, AV), function(sample, REFERENCE))


def _is(column: str, value: str) -> Callable[[Sample], BothArms]:
    return _each(
        lambda sample, arm: np.array([word == value for word in sample.words(column)[arm]])
    )


def _any(*names: str) -> Callable[[Sample], BothArms]:
    """Marks episodes that one of some columns marks."""
    return _each(lambda s, arm: np.logical_or.reduce([s.arms(name)[arm] for name in names]))


def _crash_that(column: str) -> Callable[[Sample], BothArms]:
    """Marks crashes for which a column is true."""
    return _each(lambda s, arm: s.arms("crashed")[arm] & (s.arms(column)[arm] == 1))


def _conflict(column: str, threshold: str, *, above: bool = False) -> Callable[[Sample], BothArms]:
    """Marks episodes whose measure lies beyond a threshold; a crash is a conflict of every kind."""

    def marks(sample: Sample, arm: int) -> np.ndarray:
        limit = getattr(sample.scenario.conflicts, threshold)
        values = sample.arms(column)[arm]
        beyond: np.ndarray = values > limit if above else values < limit  # NaN is neither
        return beyond | sample.arms("crashed")[arm]

    return _each(marks)


def _waited_s(sample: Sample, arm: int) -> FloatArray:
    """Sum of the waits at the kerb of an episode; NaN where the episode failed."""
    arrivals = sample.arms("arrivals")[arm]
    waited = np.where(arrivals > 0, sample.arms("pedestrian_delay_s")[arm] * arrivals, 0.0)
    return np.where(sample.arms("ran")[arm], waited, np.nan)


def _counted_times(sample: Sample) -> BothArms:
    """Both times of the pairs that the ratio of times counts; NaN in all others.

    These are the pairs in which neither episode failed and the AV did not crash.  A driver who has
    not passed counts with the time-out; a reference who crashed counts as driving on.
    """
    limit_s = sample.scenario.experiment.timeout_s
    (av, human), (av_late, human_late) = sample.arms("pass_time_s"), sample.arms("timed_out")
    crashed, untouched = (
        sample.arms(name)[REFERENCE] for name in ("crashed", "pass_time_ignoring_contact_s")
    )
    av = np.where(av_late, limit_s, av)
    human = np.where(crashed, untouched, human)
    human = np.where(human_late | (crashed & np.isnan(human)), limit_s, human)
    counted = ~(sample.pairs("failed") | np.isnan(av) | np.isnan(human))
    return np.where(counted, av, np.nan), np.where(counted, human, np.nan)


def _worst_times(sample: Sample) -> BothArms:
    """Both times of every pair, missing ones against the AV.

    An AV that crashed, failed or timed out counts with the time-out; a reference who did not pass
    counts with the time of an undisturbed passage.
    """
    scenario = sample.scenario
    free_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    av, human = (
        sample.arms("pass_time_s")[AV],
        sample.arms("pass_time_ignoring_contact_s")[REFERENCE],
    )
    av = np.where(np.isnan(av), scenario.experiment.timeout_s, av)
    return av, np.where(np.isnan(human), free_s, human)


def _worst_delays(sample: Sample) -> BothArms:
    scenario = sample.scenario
    free_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    av, human = sample.arms("worst_time_s")
    return av - free_s, human - free_s


ARM_COLUMNS: Mapping[str, Callable[[Sample], BothArms]] = {
    "every": _each(lambda s, _: np.ones(s.n, dtype=bool)),
    "crashed": _is("ending", Ending.CRASHED),
    "timed_out": _is("ending", Ending.TIMED_OUT),
    "failed": _is("ending", Ending.ENGINE_FAILED),
    "failed_strategy": _is("failed_in", "strategy"),
    "ran": _each(lambda s, arm: ~s.arms("failed")[arm]),
    "missed": _any("crashed", "timed_out", "failed_strategy"),
    "tried": _any("ran", "failed_strategy"),
    "missing": _any("crashed", "timed_out", "failed"),
    "crash_avoidable": _crash_that("avoidable"),
    "crash_avoidable_attentive": _crash_that("avoidable_attentive"),
    "met": _each(lambda s, arm: s.arms("pedestrians")[arm] > 0),
    "fell_back": _each(lambda s, arm: s.arms("fallback")[arm] > 0),
    "counted_time_s": _counted_times,
    "worst_time_s": _worst_times,
    "worst_delay_s": _worst_delays,
    "waited_s": _each(_waited_s),
    "conflict_pet": _conflict("pet_s", "pet_s"),
    "conflict_ttc": _conflict("min_ttc_s", "ttc_s"),
    "conflict_time_advantage": _conflict("min_time_advantage_s", "time_advantage_s"),
    "conflict_drac": _conflict("max_drac_mps2", "drac_mps2", above=True),
}
"""Columns of an arm that are derived from those of ``episodes``."""

PAIR_COLUMNS: Mapping[str, Callable[[Sample], np.ndarray]] = {
    "every": lambda s: np.ones(s.n, dtype=bool),
    "failed": lambda s: np.logical_or(*s.arms("failed")),
    "met_someone": lambda s: np.logical_or(*s.arms("met")),
    "met_nobody": lambda s: ~s.pairs("met_someone") & ~s.pairs("failed"),
    "tau": lambda s: np.divide(*s.arms("pass_time_s")),
    "tau_all": lambda s: (
        s.arms("pass_time_s")[AV] / s.arms("pass_time_ignoring_contact_s")[REFERENCE]
    ),
    "tau_worst": lambda s: np.divide(*s.arms("worst_time_s")),
    "delay_difference_s": lambda s: (
        s.arms("pass_time_s")[AV] - s.arms("pass_time_ignoring_contact_s")[REFERENCE]
    ),
    "not_in_time_ratio": lambda s: np.isnan(s.arms("counted_time_s")[AV]),
    "in_mu": lambda s: ~np.isnan(s.pairs("tau")),
}
"""Columns of a pair.

``tau`` is the AV's time over the reference's, NaN where either did not cross; in ``tau_all`` and
``delay_difference_s`` a reference who crashed counts as driving on; ``tau_worst`` is of every pair.
"""
