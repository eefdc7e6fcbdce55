"""Columns of both arms of a cell, with a value for each pair, and their statistics.

Means have Student's t intervals over pairs.  Shares have the intervals of Korn and Graubard,
because the trials of one pair may be correlated.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from harness.core.encounter import FloatArray
from harness.old.statistics import (
    UNDEFINED,
    Interval,
    Proportion,
    clustered_proportion,
    student_mean,
    student_ratio,
)
from harness.old.store.summaries import check_pairs

Columns = Mapping[str, FloatArray]
"""The numbers of one arm, over the pairs in which neither arm failed."""


@dataclass(frozen=True)
class ArmColumns:
    """The columns of both arms of a cell, AV's first.

    A pair in which an arm failed counts only in ``pairs`` and ``failed``.
    """

    arms: tuple[Columns, Columns]
    pairs: int
    failed: int
    confidence: float

    def mean(self, name: str, arm: int) -> Interval:
        """The mean of a column whose values are ≥ 0."""
        return self.mean_of(self.arms[arm][name]).within(least=0.0)

    def difference(self, name: str) -> Interval:
        """The mean over pairs of the AV's value minus the reference's."""
        av, human = self.arms
        return self.mean_of(av[name] - human[name])

    def time_ratio(self) -> Interval:
        """The sum of the travel times in the AV's arm divided by the sum in the reference's arm."""
        times = np.array([columns["travel_time_s"] for columns in self.arms])
        av, human = times[:, ~np.isnan(times).any(axis=0)]
        return student_ratio(av, human, self.confidence).within(least=0.0)

    def share(self, events: str, trials: str, arm: int) -> Proportion:
        """The share of events among trials; both are columns of counts."""
        columns = self.arms[arm]
        return clustered_proportion(columns[events], columns[trials], self.confidence)

    def share_difference(self, events: str, trials: str) -> Interval:
        """The difference of the shares, with Student's t interval of the pairs' contributions.

        It has no interval if there was no event in either arm, because an event may still occur.
        """
        totals = [float(columns[trials].sum()) for columns in self.arms]
        if 0.0 in totals:
            return UNDEFINED
        av, human = (
            float(columns[events].sum()) / total
            for columns, total in zip(self.arms, totals, strict=True)
        )
        difference = av - human
        # Contributions of the pairs to the share, linearised: their mean is 0.
        parts = [
            (columns[events] - share * columns[trials]) / columns[trials].mean()
            for columns, share in zip(self.arms, (av, human), strict=True)
        ]
        reach = self.mean_of(parts[0] - parts[1]).half_width
        if reach is None or not (av or human):
            return Interval(difference, None, None)
        return Interval(difference, difference - reach, difference + reach).within(-1.0, 1.0)

    def total(self, name: str, arm: int) -> int:
        """The sum of a column of counts."""
        return int(self.arms[arm][name].sum())

    def mean_of(self, values: FloatArray) -> Interval:
        """The mean of the defined values, with its interval."""
        return student_mean(values[~np.isnan(values)], self.confidence)


def arm_columns(rows: pa.Table, name: str, confidence: float) -> ArmColumns:
    """The columns of a cell, from its rows of a table by pair, AV first.

    Raises:
        InputError: the rows do not have both arms of each pair; ``name`` is the table's name.
    """
    check_pairs(rows, name)
    ran = np.array([reason is None for reason in rows["reason"].to_pylist()], dtype=bool)
    both = ran[::2] & ran[1::2]
    columns = {
        field.name: rows[field.name].cast(pa.float64()).to_numpy(zero_copy_only=False)
        for field in rows.schema
        if pa.types.is_floating(field.type) or pa.types.is_integer(field.type)
    }
    av, human = (
        {name: column[place::2][both] for name, column in columns.items()} for place in (0, 1)
    )
    return ArmColumns((av, human), len(both), int((~both).sum()), confidence)


def scaled(interval: Interval, factor: float) -> Interval:
    """An interval times a number above 0."""
    ends = (interval.value, interval.low, interval.high)
    return Interval(*(None if end is None else factor * end for end in ends))
