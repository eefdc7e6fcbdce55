"""From the episodes of a cell to its summary."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, get_type_hints

import numpy as np
import pyarrow as pa

from harness.comparison import (
    CONFIDENCE,
    Interval,
    PairColumns,
    Proportion,
    Resampled,
    Summary,
    summarise,
)
from harness.encounter import Arm, Contact, Ending
from harness.errors import InputError
from harness.scenario import Cell, Options, Study
from harness.seeding import resampling

FIRST_LOOK = 1_000
"""Pairs at the first look of ``--until``; each further look is at twice as many."""


def looks(pairs: int) -> list[int]:
    """Numbers of pairs at which ``--until`` looks: 1,000, 2,000, 4,000 … and at last ``pairs``."""
    numbers = []
    look = FIRST_LOOK
    while look < pairs:
        numbers.append(look)
        look *= 2
    return [*numbers, pairs]


def confidence_of(study: Study, options: Options) -> float:
    """Confidence of each interval.

    Looking L times and stopping at the best moment would spoil a 95 % interval, so with
    ``--until`` each look uses 1 − 0.05/L (Bonferroni): all of them together hold with 95 %.
    """
    if options.until is None:
        return CONFIDENCE
    most = max(cell.scenario.experiment.pairs for cell in study.cells)
    return 1 - (1 - CONFIDENCE) / len(looks(most))


def summarise_cell(episodes: pa.Table, cell: Cell, confidence: float) -> Summary:
    """The summary of a cell, from its episodes by pair.

    The resampling's stream is the scenario's alone: the same episodes give the same intervals.
    """
    experiment = cell.scenario.experiment
    rng = resampling(experiment.seed, "summary")
    free_pass_s = cell.scenario.vehicle().free_pass_time_s(cell.scenario.crosswalk())
    return summarise(pair_columns(episodes), experiment.timeout_s, free_pass_s, rng, confidence)


def pair_columns(episodes: pa.Table) -> PairColumns:
    """The columns that a comparison needs, from the episodes of one cell.

    Args:
        episodes: rows in order of pairs, AV first.

    Raises:
        InputError: they are not: an arm is missing, or rows of two runs are mixed.
    """
    check_pairs(episodes, "episodes")
    arm = np.array(episodes["arm"].to_pylist())
    ending = np.array(episodes["ending"].to_pylist())
    front = np.array([contact == Contact.FRONT for contact in episodes["contact"].to_pylist()])
    crashed = ending == Ending.CRASHED
    avoidable = np.array([value is True for value in episodes["avoidable"].to_pylist()])

    def numbers(name: str) -> Any:
        if name not in episodes.column_names:  # of a run from before it was kept
            return np.full(len(arm), np.nan)
        return episodes[name].to_numpy().astype(float)

    def both(values: Any) -> tuple[Any, Any]:
        return values[arm == Arm.AV], values[arm == Arm.HUMAN]

    arrivals = numbers("arrivals")
    return PairColumns(
        time_s=both(numbers("pass_time_s")),
        untouched_time_s=both(numbers("pass_time_ignoring_contact_s")),
        delay_s=both(numbers("delay_s")),
        stops=both(numbers("stops")),
        stopped_s=both(numbers("stopped_s")),
        crashed=both(crashed),
        front=both(crashed & front),
        avoidable=both(crashed & avoidable),
        timed_out=both(ending == Ending.TIMED_OUT),
        failed=both(ending == Ending.ENGINE_FAILED),
        failed_strategy=both(_failed_strategy(episodes)),
        met=both(numbers("pedestrians")),
        arrivals=both(arrivals),
        waited_s=both(np.where(arrivals > 0, numbers("pedestrian_delay_s") * arrivals, 0.0)),
        conditionings=both(numbers("conditionings")),
        clamped=both(numbers("clamped")),
        speed_excess_mps=both(numbers("clamped_speed_excess_mps")),
        range_excess_m=both(numbers("clamped_range_excess_m")),
        max_speed_mps=both(numbers("max_speed_mps")),
        av_fallback=both(numbers("fallback") > 0)[0],
    )


def _failed_strategy(episodes: pa.Table) -> np.ndarray:
    """Whether the strategy made the episode fail."""
    if "failed_in" in episodes.column_names:
        return np.array([where == "strategy" for where in episodes["failed_in"].to_pylist()])
    # A run from before that was kept says it in the reason alone.
    reasons = episodes["reason"].to_pylist()
    return np.array([(reason or "").startswith("the strategy ") for reason in reasons])


def check_pairs(rows: pa.Table, what: str) -> None:
    """Refuse rows of a cell that are not two arms of each pair, the AV's first.

    Raises:
        InputError: an arm is missing, or rows of two runs are mixed.
    """
    arms, pairs = rows["arm"].to_pylist(), rows["pair"].to_pylist()
    count = len(arms) // 2
    whole = count > 0 and arms == [Arm.AV.value, Arm.HUMAN.value] * count
    if not whole or pairs[::2] != pairs[1::2] or len({*pairs}) != count:
        raise InputError(what, "are not two arms of each pair of a cell", f"one run's {what}")


def summary_row(summary: Summary) -> dict[str, float | int | None]:
    """A summary as the columns of ``summary.csv``; an interval becomes three, or four."""
    row: dict[str, float | int | None] = {}
    for field in fields(Summary):
        value = getattr(summary, field.name)
        named = isinstance(value, Interval)
        row |= value.columns(field.name) if named else {field.name: value}
    return row


def summary_columns() -> dict[str, type]:
    """The type of each column of a summary; only an ``int`` has a number in every row."""
    columns: dict[str, type] = {}
    for name, kind in get_type_hints(Summary).items():
        ends = ("", "_ci_low", "_ci_high") if kind in (Resampled, Proportion) else ("",)
        columns |= {f"{name}{end}": int if kind is int else float for end in ends}
        if kind is Resampled:
            columns[f"{name}_ci_informative"] = int
    return columns


def summary_from(row: Mapping[str, Any], pairs: PairColumns) -> Summary:
    """A summary from the columns of ``summary.csv``; the inverse of ``summary_row``.

    Args:
        row: the columns; NaN or None where undefined.
        pairs: the cell's columns, which give the numbers of episodes behind the shares.
    """
    values: dict[str, Any] = {}
    kinds = get_type_hints(Summary)
    for field in fields(Summary):
        name, kind = field.name, kinds[field.name]
        if kind not in (Resampled, Proportion):
            values[name] = int(row[name]) if kind is int else known(row[name])
            continue
        found = interval_from(row, name)
        if kind is Resampled:
            rests_on = int(row[f"{name}_ci_informative"])
            values[name] = Resampled(found.value, found.low, found.high, rests_on)
        else:
            of = int(np.count_nonzero(_episodes_behind(name, pairs)))
            count = round((found.value or 0.0) * of)
            values[name] = Proportion(found.value, found.low, found.high, count, of)
    return Summary(**values)


def _episodes_behind(name: str, pairs: PairColumns) -> np.ndarray:
    """Which pairs a share of the summary is out of."""
    ran = ~pairs.failed["_human" in name]
    if name == "kappa_worst":
        return np.ones_like(ran)
    if name == "kappa_all":
        return pairs.av_tried
    return ran & pairs.met_someone if "_met" in name else ran


def interval_from(row: Any, name: str) -> Interval:
    """The interval in three columns of a row of ``summary.csv``, a mapping or a pandas series."""
    return Interval(*(known(row[f"{name}{end}"]) for end in ("", "_ci_low", "_ci_high")))


def known(value: float | None) -> float | None:
    """The number, or None where a table holds none."""
    return None if value is None or np.isnan(value) else float(value)
