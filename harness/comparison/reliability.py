"""From how many informative pairs on an interval holds what it says."""

from harness.comparison.bootstrap import Resampled
from harness.comparison.intervals import Interval

RELIABLE_FROM = {
    "mu": 1_000,
    "cv": 4_000,
    "delay_s": 200,
    "delay_human_s": 200,
    "mu_all": 1_000,
    "mu_worst": 1_000,
    "delay_difference_human_s": 1_000,
    "pedestrian_delay_s": 200,
    "pedestrian_delay_human_s": 200,
    "mu_met_someone": 1_000,
    "delay_met_someone_s": 200,
    "delay_human_met_someone_s": 200,
    "time_ratio": 1_000,
    "time_ratio_worst": 1_000,
    "delay_worst_s": 1_000,
    "delay_human_worst_s": 1_000,
    "time_ratio_difference": 500,
    "mu_difference": 500,
    "mu_worst_difference": 2_000,
    "delay_difference_s": 500,
    "delay_worst_difference_s": 1_000,
    "mu_bound": 2_000,
}
"""Informative pairs (see ``Resampled``) below which an interval covers less than 93.5 % in a
scenario of the audit (docs/audits.md); the last six are of a comparison."""

ALIKE_FROM = 20
"""Pairs that met someone from which on values that are all the same are taken to be so always."""


def unreliable(key: str, interval: Interval, met_someone: int) -> bool:
    """Whether an interval rests on too few informative pairs to hold what it says.

    Intervals that are exact never do, nor does one that there is not.

    Args:
        key: of ``RELIABLE_FROM``, or of an interval that has no bound there.
        interval: under that key.
        met_someone: pairs behind it that met someone.  Where all values are the same there is
            nothing that the width could be too small for, unless hardly anybody was met.
    """
    if not isinstance(interval, Resampled) or interval.low is None:
        return False
    if interval.informative == 0:
        return met_someone < ALIKE_FROM
    return interval.informative < RELIABLE_FROM[key]
