"""Aligned columns of a cell, from which all statistics of its pairs are computed."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from harness.core.encounter import FloatArray

BothArms = tuple[np.ndarray, np.ndarray]
"""Aligned columns of the AV's and the human's arm, one entry for each pair."""


@dataclass(frozen=True, slots=True)
class PairColumns:
    """Aligned columns of a cell, one entry for each pair.

    ``time_s`` and ``delay_s`` are NaN where the arm did not cross. ``untouched_time_s`` is the
    pass time if contacts are ignored; it is NaN where the ego never passed. ``stops`` and
    ``stopped_s`` are NaN where the arm failed. ``front`` marks contacts with the front,
    ``avoidable`` marks crashes that full braking would have prevented, ``avoidable_attentive``
    crashes that an attentive driver would have avoided, ``failed_strategy`` failures of the
    strategy.  ``met`` is the number of pedestrians who stepped off.  ``arrivals``
    is the number of pedestrians who arrived, and ``waited_s`` is the sum of their waits at the
    kerb.  ``conditionings`` is the number of uses of the interaction model.  ``clamped`` is the
    number of uses for an ego that was faster or farther away than the model's box.  The two
    excesses are the largest distances from the box; they are NaN where there are none.
    ``max_speed_mps`` is the ego's largest speed.  ``steps``, the two root mean squares and the two
    largest values, which are NaN where the arm failed before its first step, are those of the
    record.
    """

    time_s: BothArms
    untouched_time_s: BothArms
    delay_s: BothArms
    stops: BothArms
    stopped_s: BothArms
    crashed: BothArms
    front: BothArms
    avoidable: BothArms
    avoidable_attentive: BothArms
    timed_out: BothArms
    failed: BothArms
    failed_strategy: BothArms
    met: BothArms
    arrivals: BothArms
    waited_s: BothArms
    conditionings: BothArms
    clamped: BothArms
    speed_excess_mps: BothArms
    range_excess_m: BothArms
    max_speed_mps: BothArms
    steps: BothArms
    rms_acceleration_mps2: BothArms
    rms_jerk_mps3: BothArms
    max_deceleration_mps2: BothArms
    max_jerk_mps3: BothArms
    av_fallback: np.ndarray

    def where(self, keep: "np.ndarray | slice") -> "PairColumns":
        """The columns of the pairs of a mask or a slice."""

        def kept(column: np.ndarray | BothArms) -> Any:
            if isinstance(column, tuple):
                return column[0][keep], column[1][keep]
            return column[keep]

        return PairColumns(
            **{field.name: kept(getattr(self, field.name)) for field in fields(self)}
        )

    def same(self, arm: int) -> bool:
        """Whether there are several pairs, and all episodes of an arm have the same columns."""
        both = (getattr(self, column.name) for column in fields(self))
        columns = [column[arm] for column in both if isinstance(column, tuple)]
        return len(self.tau) > 1 and all(
            np.array_equal(column[1:], column[:-1], equal_nan=True) for column in columns
        )

    @property
    def tau(self) -> FloatArray:
        """AV time / human time of each pair, NaN where either arm did not cross."""
        av, human = self.time_s
        ratio: FloatArray = av / human
        return ratio

    @property
    def tau_all(self) -> FloatArray:
        """τ over all pairs in which the AV crossed; a human who crashed counts as driving on.

        It is NaN where the AV did not cross, where the human never passed, and where the time
        that ignores contacts is not stored.
        """
        ratio: FloatArray = self.time_s[0] / self.untouched_time_s[1]
        return ratio

    @property
    def delay_difference_s(self) -> FloatArray:
        """The AV's delay minus the human's over the pairs of ``tau_all``; NaN elsewhere."""
        difference: FloatArray = self.time_s[0] - self.untouched_time_s[1]
        return difference

    def times_counted(self, timeout_s: float) -> BothArms:
        """Both arms' times of the pairs that the ratio of times counts; NaN in all others.

        These are the pairs in which no arm failed and the AV did not crash.  A driver who has not
        passed at ``timeout_s`` counts with ``timeout_s``; a human who crashed counts with
        ``untouched_time_s``.  If a run did not store this time, the pairs in which the human
        crashed are left out.
        """
        av = np.where(self.timed_out[0], timeout_s, self.time_s[0])
        human = np.where(self.crashed[1], self.untouched_time_s[1], self.time_s[1])
        kept = not (np.isnan(self.untouched_time_s[1]) & ~np.isnan(self.time_s[1])).any()
        never = self.timed_out[1] | (self.crashed[1] & np.isnan(human) & kept)
        human = np.where(never, timeout_s, human)
        counted = ~(self.any_failed | np.isnan(av) | np.isnan(human))
        return np.where(counted, av, np.nan), np.where(counted, human, np.nan)

    def times_worst(self, timeout_s: float, free_pass_s: float) -> BothArms:
        """Both arms' times of every pair; missing times count against the AV.

        An AV that crashed, failed or timed out counts with ``timeout_s``; a human who did not pass
        counts with ``free_pass_s``.
        """
        av, human = self.time_s[0], self.untouched_time_s[1]
        human = np.where(np.isnan(human), self.time_s[1], human)
        return (
            np.where(np.isnan(av), timeout_s, av),
            np.where(np.isnan(human), free_pass_s, human),
        )

    def tau_worst(self, timeout_s: float, free_pass_s: float) -> FloatArray:
        """τ of every pair, with the times of ``times_worst``."""
        av, human = self.times_worst(timeout_s, free_pass_s)
        ratio: FloatArray = av / human
        return ratio

    @property
    def av_missed(self) -> np.ndarray:
        """Whether the AV crashed, timed out, or failed because of its strategy."""
        missed: np.ndarray = self.crashed[0] | self.timed_out[0] | self.failed_strategy[0]
        return missed

    @property
    def av_tried(self) -> np.ndarray:
        """Whether the AV's episode ran, or failed because of its strategy."""
        tried: np.ndarray = ~self.failed[0] | self.failed_strategy[0]
        return tried

    @property
    def any_timed_out(self) -> np.ndarray:
        """Whether either arm of the pair timed out."""
        return self.timed_out[0] | self.timed_out[1]

    @property
    def any_failed(self) -> np.ndarray:
        """Whether either arm of the pair failed."""
        return self.failed[0] | self.failed[1]

    @property
    def met_someone(self) -> np.ndarray:
        """Whether somebody stepped off in either arm of the pair."""
        return (self.met[0] > 0) | (self.met[1] > 0)
