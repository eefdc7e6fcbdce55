"""The differences of two strategies, pair by pair, and the p of all of them together."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from harness.results import estimators
from harness.results.catalogue import ENTRY_OF, Entry
from harness.results.columns import AV, PairSample
from harness.results.estimators import Sampling
from harness.results.finding import Finding, Form, Style
from harness.results.simulated import SimulationSample
from harness.results.tables import RunKind
from harness.studies.candidates import Candidate, common_pairs


class Difference(NamedTuple):
    """A number of cell A minus that of cell B over their common pairs.

    ``reliable_from`` is the least number of pairs that differ for a reliable interval; 0: exact.
    """

    key: str
    heading: str
    style: Style
    reliable_from: int
    of: Callable[[Any, Any, Sampling], Finding]


def _time_ratio(a: PairSample, b: PairSample, sampling: Sampling) -> Finding:
    (a_s, reference_s), (b_s, _) = a["counted_time_s"], b["counted_time_s"]
    return estimators.difference(a_s, b_s, sampling, reference_s)


def _mean(a: PairSample, b: PairSample, sampling: Sampling, column: str) -> Finding:
    """Of a column of both arms, or of the pairs."""
    a_of_av, b_of_av = (np.atleast_2d(each[column])[AV] for each in (a, b))
    return estimators.difference(a_of_av, b_of_av, sampling)


def _share(a: PairSample, b: PairSample, _sampling: Sampling, column: str, ran: str) -> Finding:
    marked, trials = ([each[name][AV] for each in (a, b)] for name in (column, ran))
    return estimators.share_difference(*marked, *trials)


_SHARE = Style(Form.SHARE, 1)
# fmt: off
DIFFERENCES = (
    Difference("time_ratio_difference", "ratio of times", Style(digits=3), 500, _time_ratio),
    Difference("mu_difference", "μ", Style(digits=3), 500, partial(_mean, column="tau")),
    Difference("delay_difference_s", "delay, s", Style(), 500, partial(_mean, column="delay_s")),
    Difference("delay_worst_difference_s", "delay, worst case, s", Style(), 1_000,
               partial(_mean, column="worst_delay_s")),
    Difference("kappa_difference", "crashes", _SHARE, 0,
               partial(_share, column="crashed", ran="ran")),
    Difference("kappa_all_difference", "crashes, time-outs, failures", _SHARE, 0,
               partial(_share, column="missed", ran="tried")),
)
# fmt: on
"""What is compared; a test of each has one family (Holm) over all rows of the table."""


def _of_simulations(entry: Entry) -> Difference:
    """The difference of an entry between the AVs' arms of two cells, with its t test."""

    def of(a: SimulationSample, b: SimulationSample, sampling: Sampling) -> Finding:
        both = (np.array([a[name][AV], b[name][AV]]) for name in entry.estimate.columns)
        return entry.estimate.of_columns(*both, sampling)

    form = Form.SHARE if entry.style.form is Form.EVENTS else entry.style.form
    heading = f"{entry.heading}{entry.unit and f', {entry.unit}'}"
    return Difference(f"{entry.key}_a_minus_b", heading, entry.style._replace(form=form), 0, of)


_SHOWN = ("av_delay_s", "contacts", "conflicts_pet", "share_strategy")
_OTHERS = ("vehicles_delay_s", "other_delay_s", "av_contacts", "people_delay_s", "people_wait_s",
           "queue_p95", "av_time_loss_s")  # fmt: skip


class Compared(NamedTuple):
    """What is compared of a kind of run.

    Attributes:
        differences: the differences; that of the first is on the screen.
        shown: the entries on the screen.
        worse: the difference that a note is made of, and what the worse one does more often.
    """

    differences: tuple[Difference, ...]
    shown: tuple[str, ...]
    worse: tuple[str, str]


COMPARED: Mapping[RunKind, Compared] = {
    "encounters": Compared(
        DIFFERENCES,
        ("time_ratio", "kappa"),
        ("kappa_all_difference", "crashes, times out or fails"),
    ),
    "simulations": Compared(
        tuple(_of_simulations(ENTRY_OF[key]) for key in (*_SHOWN, *_OTHERS)),
        _SHOWN,
        ("contacts_a_minus_b", "touches people"),
    ),
}


class ComparedPair(NamedTuple):
    """Two strategies with their differences by key."""

    a: Candidate
    b: Candidate
    found: Mapping[str, Finding]


def compared(a: Candidate, b: Candidate, sampling: Sampling) -> ComparedPair:
    """The differences of two strategies over the pairs that both have."""
    samples = a.sample(pairs := common_pairs(a, b)), b.sample(pairs)
    found = {}
    for gap in COMPARED[a.run.kind].differences:
        finding = gap.of(*samples, sampling)
        if finding.value is None:
            finding = replace(finding, reason="no pair counts in both")
        found[gap.key] = finding.reliable_above(gap.reliable_from, "pairs that differ")
    return ComparedPair(a, b, found)


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Adjusted p of each test of a family (Holm 1979), in the given order.

    The j-th smallest of m values is multiplied by m − j + 1; the results are monotone, at most 1.
    None is the p of an undefined difference: a test of the family that was not made.
    """
    p = np.array([1.0 if p is None else p for p in p_values])
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted[order] = np.minimum(steps, 1.0)
    tested = zip(p_values, adjusted.tolist(), strict=True)
    return [None if given is None else value for given, value in tested]
