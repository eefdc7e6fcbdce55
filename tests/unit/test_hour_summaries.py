"""Summaries of hours of traffic from rows made by hand: trials, shares, ratios, yield rates."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from harness.core.encounter import Arm
from harness.old.statistics import (
    CONFLICTS,
    Finding,
    Interval,
    clustered_proportion,
    columns_of,
    findings_from,
    row_of,
    student_mean,
    student_ratio,
)
from harness.old.store.hour_catalogue import HOURS as CATALOGUE
from harness.old.store.hour_columns import HourColumns
from harness.old.store.hour_tables import _delays, _late, passage_counts
from harness.old.store.kinds import HourKind
from harness.old.store.schemas import HOURS
from harness.old.store.tables import table_of
from harness.scenario import Cell, ConflictsSection, Scenario, validate

AUTOMATED = {"av": "hard_yield", "human": "human_yield"}


def scenario(share: float = 1.0, **arms: str) -> Scenario:
    tree = {"arms": {**AUTOMATED, **arms}, "traffic": {"av_share": share, "duration_s": 3600}}
    return validate(tree, "test")


def summary_of(
    av: dict[str, Any], human: dict[str, Any], of: Scenario, hours: int = 3
) -> dict[str, Finding]:
    """So many hours that are alike but for a column that is given as a list."""
    common = {"vehicles": 100, "pedestrians": 50, "reached": 100, "walking_mps": 1.3}
    rows = []
    for pair in range(hours):
        for arm, own in ((Arm.AV, av), (Arm.HUMAN, human)):
            row = dict.fromkeys(HOURS.names[4:], 0) | common | own
            values = {key: v[pair] if isinstance(v, list) else v for key, v in row.items()}
            rows.append({"cell": 0, "pair": pair, "arm": arm.value} | values)
    return HourKind().findings(table_of("hours", rows), Cell(0, {}, of), 0.95)


def passage(edge_s: float | None, ending: str = "crossed", **values: float) -> dict[str, Any]:
    row = dict.fromkeys((conflict.column for conflict in CONFLICTS), None)
    return row | {"edge_s": edge_s, "ending": ending, "approach_stops": 0, "stops": 0} | values


def test_trials_are_vehicles_that_reached_the_crosswalk_or_crashed() -> None:
    through = [passage(5.0), passage(6.0, min_ttc_s=0.4), passage(7.0, "crashed")]
    before_it = [passage(None, "crashed")]
    never = [passage(None, "timed_out", min_ttc_s=0.4), *[passage(None, "timed_out")] * 7]
    counts = passage_counts([*through, *before_it, *never], ConflictsSection())
    assert (counts["reached"], counts["crashes"]) == (4, 2)
    assert (counts["conflicts_ttc"], counts["conflicts_pet"]) == (3, 2)
    assert counts["conflicts_unreached"] == 1
    own = {"crashes": [1, 0, 0], "reached": [20, 0, 0], "conflicts_unreached": 2}
    findings = summary_of(own, {}, scenario())
    kappa = findings["kappa"]
    assert (kappa.value, kappa.events, kappa.n) == (0.05, 1, 20)
    assert findings["crashes_per_1000"].value == 50
    assert (findings["unreached"].value, findings["conflicts_unreached"].value) == (280, 6)
    assert findings["unreached_human"].value == 0


def test_findings_are_read_back_as_they_were_written() -> None:
    """Undefined numbers have a reason; a difference of shares has no trials."""
    findings = summary_of({"let_go": 9, "had_to_wait": 10}, {}, scenario())
    row = row_of(CATALOGUE, findings)
    assert [*row] == [*columns_of(CATALOGUE)]
    assert (row["first_driver_yield_share_events"], row["first_driver_yield_share_n"]) == (27, 30)
    assert "first_driver_yield_share_difference_n" not in row
    assert findings["first_driver_yield_share_human"].reason == "nobody had to wait"
    assert all(finding.reason for finding in findings.values() if finding.value is None)
    assert findings_from(CATALOGUE, row) == findings


def test_queues_and_fallbacks_by_hand() -> None:
    own = {"queue_p95": [2.0, 3.0, 4.0]}
    findings = summary_of(own, {"queue_p95": 1.0}, scenario())
    assert findings["queue_p95_m"].value == pytest.approx(21.0)
    assert findings["queue_p95_m"].low == pytest.approx(7 * (findings["queue_p95"].low or 0.0))
    assert findings["queue_p95_m_difference"].value == pytest.approx(14.0)
    findings = summary_of({"met": 40, "fallbacks": [40, 0, 20]}, {}, scenario())
    share = findings["fallback_share"]
    assert (share.events, share.n) == (60, 120)


def test_a_share_of_people_keeps_within_0_and_1() -> None:
    """Three hours of 9, 10 and 10 of 10: Student's t would say 0.82 … 1.11."""
    av = {"let_go": [9, 10, 10], "had_to_wait": 10}
    human = {"let_go": 10, "had_to_wait": 10}
    findings = summary_of(av, human, scenario())
    share, of_human, difference = (
        findings[f"first_driver_yield_share{end}"] for end in ("", "_human", "_difference")
    )
    expected = clustered_proportion(np.array([9.0, 10, 10]), np.full(3, 10.0))
    assert (share.value, share.low, share.high) == (expected.value, expected.low, expected.high)
    assert share.high <= 1.0
    assert of_human.high == 1.0
    # Trials are alike, so the difference is the plain paired one.
    paired = student_mean(np.array([-0.1, 0, 0]))
    assert difference.value == pytest.approx(paired.value)
    assert difference.low == pytest.approx(paired.low)


def test_no_interval_holds_what_cannot_be() -> None:
    """A queue of 0, 0 and 0.6 has no mean below 0; a difference of queues may."""
    av = {"queue_mean": [0.0, 0.0, 0.6], "vehicle_delay_s": [0.0, 0.1, 2.0]}
    findings = summary_of(av, {"queue_mean": [0.0, 0.3, 0.0]}, scenario())
    signed = {"growth", "rising_s"}
    for entry in CATALOGUE:
        for name in filter(None, entry.names[:2]):
            finding = findings[name]
            most = 1000.0 if "per_1000" in name else 1.0 if finding.n else math.inf
            assert entry.key in signed or finding.low is None or finding.low >= 0
            assert finding.high is None or finding.high <= most
    assert findings["queue_mean"].low == 0.0
    low = findings["queue_mean_difference"].low
    assert low < 0


def test_differences_of_shares_cover() -> None:
    """In 1,000 draws of ten hours of both arms: 95 % (2.5 % more or less is 3 sd and some)."""
    rng, held = np.random.default_rng(1), 0
    for _ in range(1_000):
        arms = []
        for share in (0.7, 0.5):
            trials = rng.poisson(60, 10).astype(float)
            own = rng.beta(share * 20, (1 - share) * 20, 10)
            events = rng.binomial(trials.astype(int), own).astype(float)
            arms.append({"let_go": events, "had_to_wait": trials})
        columns = HourColumns((arms[0], arms[1]), 10, 0, 0.95, scenario())
        difference = columns.share_difference("let_go", "had_to_wait")
        assert difference.low is not None
        assert difference.high is not None
        held += difference.low <= 0.2 <= difference.high
    assert 925 <= held <= 975


def test_the_time_ratio_is_that_of_sums_and_covers() -> None:
    """Delays of five skewed hours: 92 % (4,000 draws; of normal ones 95 %, of twenty 94 %)."""
    findings = summary_of({"travel_time_s": [300.0, 100, 50]}, {"travel_time_s": 100.0}, scenario())
    assert findings["time_ratio"].value == 1.5
    rng, intervals = np.random.default_rng(2), list[Interval]()
    truth = (40 + 30 * np.exp(0.125)) / (40 + 60 * np.exp(0.125))
    for _ in range(2_000):
        people = rng.lognormal(0, 0.5, 5)
        human = 40 + 60 * people * rng.lognormal(-0.02, 0.2, 5)
        av = 40 + 30 * people * rng.lognormal(-0.02, 0.2, 5)
        intervals.append(student_ratio(av, human))
    ends = [(i.low, i.high) for i in intervals if i.low is not None and i.high is not None]
    # In a few the reference's sum is too uncertain for an interval to end.

    assert len(ends) >= 0.98 * 2_000
    assert sum(low <= truth <= high for low, high in ends) >= 0.91 * len(ends)


def test_fieller_by_hand() -> None:
    """The ends are the ρ at which the mean of a − ρ b is just t standard errors from 0."""
    a, b = np.array([5.0, 7.0, 6.0, 9.0]), np.array([4.0, 6.0, 7.0, 8.0])
    ratio = student_ratio(a, b)
    for end in (ratio.low, ratio.high):
        apart = student_mean(a - end * b)
        assert min(abs(apart.low or 0.0), abs(apart.high or 0.0)) == pytest.approx(0.0, abs=1e-12)
    assert student_ratio(a, np.zeros(4)).value is None
    # A denominator that may be 0 has no interval.
    assert student_ratio(a, np.array([1.0, -1.0, 2.0, 0.1])).low is None


def test_a_delay_that_still_grows() -> None:
    """By 10, 12 and 11 s in three hours; one hour alone cannot tell."""
    grows = {"first_third_delay_s": 5.0, "last_third_delay_s": [15.0, 17.0, 16.0]}
    rise = summary_of(grows, {}, scenario())["rising_s"]
    assert rise.value == pytest.approx(11.0)
    # Student's t with 2 degrees of freedom: 4.303 × 1 / √3.
    assert rise.low == pytest.approx(11.0 - 4.3027 / math.sqrt(3), abs=1e-4)
    assert summary_of(grows, {}, scenario(), hours=1)["rising_s"].low is None
    noisy = {"first_third_delay_s": 5.0, "last_third_delay_s": [45.0, 1.0, 2.0]}
    low = summary_of(noisy, {}, scenario())["rising_s"].low
    assert low < 0


def hour_of(of: Scenario, *rows: tuple[float, float, float | None, float]) -> tuple[Any, Any, Any]:
    """An hour of vehicles scheduled, due through and through then, with their uniforms."""
    passages = [
        SimpleNamespace(
            scheduled_s=scheduled,
            due_s=due,
            passed_s=passed,
            control_delay_s=None,
            vehicle=SimpleNamespace(plan=SimpleNamespace(uniform=uniform)),
        )
        for scheduled, due, passed, uniform in rows
    ]
    outcome = SimpleNamespace(scenario=of, arm=Arm.AV, passages=passages)
    counted = SimpleNamespace(begin_s=300.0, end_s=3900.0, passages=passages)
    return outcome, counted, [(p.passed_s or 4000.0) - p.due_s for p in passages]


def test_late_vehicles_by_hand() -> None:
    """Who is due but not through is late; who is on the way, or in time, is not."""
    on_the_way = (3890.0, 3930.0, 3940.0, 0.5)
    in_time = [(350.0 + t, 387.0 + t, 387.05 + t, 0.5) for t in range(0, 3400, 3)]
    first_half = (260.0, 297.0, 2150.0, 0.5)
    both = [(1800.0, 1837.0, 3950.0, 0.5), (1900.0, 1937.0, None, 0.5)]
    outcome, counted, _ = hour_of(scenario(), on_the_way, first_half, *both, *in_time)
    late = _late(outcome, counted)
    assert (late["late_first_half"], late["late_second_half"]) == (1, 2)
    assert late["due_through"] == len(in_time) + 2


def test_delays_of_avs_and_of_others_and_of_thirds() -> None:
    """The AVs' 30 s and the others' 2 s: the mean of all is neither."""
    rows = [
        (400.0, 437.0, 467.0, 0.1),
        (2000.0, 2037.0, 2039.0, 0.6),
        (3800.0, 3837.0, 3839.0, 0.9),
    ]
    outcome, counted, delays = hour_of(scenario(0.3), *rows)
    found = _delays(outcome, counted, delays)
    assert found["automated_delay_s"] == pytest.approx(30.0)
    assert found["other_delay_s"] == pytest.approx(2.0)
    assert found["vehicle_delay_s"] == pytest.approx(34 / 3)
    assert found["first_third_delay_s"] == pytest.approx(30.0)
    assert found["last_third_delay_s"] == pytest.approx(2.0)


@pytest.mark.parametrize("hours", [2, 3, 5, 10, 20])
def test_more_hours_do_not_make_students_interval_more_reliable(hours: int) -> None:
    """docs/method.md: 95 % with normal hours; with lognormal ones 91 to 94 % at any number."""
    rng, covered = np.random.default_rng(1), {}
    quantile = stats.t.ppf(0.975, hours - 1)
    for name, values, mean in (
        ("normal", rng.normal(1.0, 0.3, (40_000, hours)), 1.0),
        ("lognormal", rng.lognormal(0.0, 0.5, (40_000, hours)), math.exp(0.125)),
    ):
        reach = quantile * values.std(axis=1, ddof=1) / math.sqrt(hours)
        covered[name] = float((np.abs(values.mean(axis=1) - mean) <= reach).mean())
        low, high = student_mean(values[0]).low, student_mean(values[0]).high
        expected = pytest.approx((values[0].mean() - reach[0], values[0].mean() + reach[0]))
        assert (low, high) == expected
    assert covered["normal"] == pytest.approx(0.95, abs=0.005)
    assert 0.905 <= covered["lognormal"] <= 0.945
