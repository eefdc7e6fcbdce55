"""The numbers of an hour in both arms, each with its interval over the hours of a cell."""

from dataclasses import dataclass

import numpy as np

from harness.comparison import Interval, clustered_proportion, student_mean
from harness.encounter import FloatArray

Columns = dict[str, FloatArray]
"""The columns of ``hours`` over the pairs of a cell, of one arm."""


@dataclass(frozen=True, slots=True)
class HourMeasure:
    """A number of an hour: the mean of a column of that name, ≥ 0, or a share of counted things.

    A share is ``per`` × the sum of the column ``events`` over that of ``trials``.
    """

    name: str
    unit: str = ""
    events: str = ""
    trials: str = ""
    per: float = 1.0


def _per_1000(events: str) -> HourMeasure:
    return HourMeasure(f"{events}_per_1000", events=events, trials="reached", per=1000.0)


HOUR_MEASURES = (
    HourMeasure("vehicle_delay_s", "s"),
    HourMeasure("automated_delay_s", "s"),
    HourMeasure("other_delay_s", "s"),
    HourMeasure("control_delay_s", "s"),
    HourMeasure("pedestrian_delay_s", "s"),
    HourMeasure("person_delay_h", "h"),
    HourMeasure("throughput_per_hour", "1/h"),
    HourMeasure("queue_mean"),
    HourMeasure("queue_p95"),
    HourMeasure("queue_longest"),
    HourMeasure("stops_per_vehicle"),
    HourMeasure("first_let_go", events="let_go", trials="had_to_wait"),
    _per_1000("crashes"),
    _per_1000("conflicts_ttc"),
    _per_1000("conflicts_time_advantage"),
    _per_1000("conflicts_pet"),
    _per_1000("conflicts_drac"),
)


def of_both_arms(
    measure: HourMeasure, av: Columns, human: Columns, confidence: float
) -> tuple[Interval, Interval, Interval]:
    """A measure of both arms and of their difference, AV − human, hour by hour.

    Means have Student's t interval over hours, cut at 0; shares Korn and Graubard's; their
    difference Student's t of what each hour adds to it, and none where no event was ever seen:
    it may yet occur.
    """
    if measure.trials:
        return _shares(measure, av, human, confidence)
    of_av, of_human = av[measure.name], human[measure.name]
    means = (student_mean(known(values), confidence) for values in (of_av, of_human))
    difference = student_mean(known(of_av - of_human), confidence)
    return *(mean.within(least=0.0) for mean in means), difference  # type: ignore[return-value]


def _shares(
    measure: HourMeasure, av: Columns, human: Columns, confidence: float
) -> tuple[Interval, Interval, Interval]:
    shares, residuals = list[Interval](), list[FloatArray]()
    for own in (av, human):
        events, trials = own[measure.events], own[measure.trials]
        share = clustered_proportion(events, trials, confidence)
        shares.append(scaled(share, measure.per))
        if share.value is not None:
            # Over the mean of the trials, as the sum of the hours' parts is the share itself.
            residuals.append((events - share.value * trials) / trials.mean())
    of_av, of_human = shares
    if of_av.value is None or of_human.value is None:
        return of_av, of_human, Interval(None, None, None)
    difference = of_av.value - of_human.value
    if not (of_av.value or of_human.value):
        return of_av, of_human, Interval(difference, None, None)
    reach = scaled(student_mean(residuals[0] - residuals[1], confidence), measure.per).half_width
    if reach is None:
        return of_av, of_human, Interval(difference, None, None)
    interval = Interval(difference, difference - reach, difference + reach)
    return of_av, of_human, interval.within(-measure.per, measure.per)


def scaled(share: Interval, factor: float) -> Interval:
    """A share times a number."""
    ends = (end and factor * end for end in (share.value, share.low, share.high))
    return Interval(*ends)


def known(values: FloatArray) -> FloatArray:
    """Those that are defined."""
    return values[~np.isnan(values)]
