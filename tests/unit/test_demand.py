"""Who comes when: λ by quarter of an hour, groups, classes of walking speeds.

The seeds are fixed.  With other seeds each p-value would be below 1e-3 in one of 1,000 runs.
"""

from collections import Counter
from itertools import groupby

import numpy as np
import pytest
from scipy import stats

from harness.core.encounter import Arm, Arrival, Side
from harness.encounter.arrivals import already_walking, planned_arrivals
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.scenario import Scenario, validate
from harness.studies.risk_space import space_of
from tests.scenes import on_plain, refuses

LUCK = 1e-3
QUARTERS = [120.0, 0.0, 480.0, 240.0]
SIZES = [0.5, 0.3, 0.2]
"""Mean 1.7 people, mean square 3.5."""

CLASSES = [{"share": 0.1, "mean_mps": 1.0, "std_mps": 0.5}, {"share": 0.3, "mean_mps": 1.2}]
SPEEDS = {"mean_mps": 1.5, "std_mps": 0.2, "classes": CLASSES}


def scene(timeout_s: float = 3600.0, **pedestrians: object) -> Scenario:
    return validate({"pedestrians": pedestrians, "experiment": {"timeout_s": timeout_s}}, "test")


def hour(pedestrians: dict[str, object], **traffic: object) -> Scenario:
    return validate({"pedestrians": pedestrians, "traffic": traffic}, "test")


def plans(scenario: Scenario, pairs: int) -> list[tuple[Arrival, ...]]:
    return [planned_arrivals(scenario, pair) for pair in range(pairs)]


def test_counts_by_quarter_are_poisson_and_even_within() -> None:
    pairs = 200
    times = np.array([a.arrival_s for plan in plans(scene(flow_per_hour=QUARTERS), pairs)
                      for a in plan])  # fmt: skip
    counts = np.bincount((times // 900).astype(int), minlength=4)
    assert counts[1] == 0
    expected = pairs * np.array([30.0, 120.0, 60.0])
    chi2 = ((counts[[0, 2, 3]] - expected) ** 2 / expected).sum()  # Poisson: variance = mean
    assert stats.chi2(3).sf(chi2) > LUCK
    for quarter in (0, 2, 3):
        inside = times[times // 900 == quarter] / 900 - quarter
        assert stats.kstest(inside, "uniform").pvalue > LUCK


def test_the_time_at_which_as_many_were_expected_by_hand() -> None:
    # 15, 0 and 30 people are expected in the quarters; every unit exponential is 5.5.
    scenario = scene(2700.0, flow_per_hour=[60.0, 0.0, 120.0])
    given = {"arrival": [-np.expm1(-5.5)] * 9}

    def times(begin_s: float) -> list[float]:
        plan = planned_arrivals(scenario, 0, given, horizon_s=5000.0, begin_s=begin_s)
        return [a.arrival_s for a in plan[:9]]

    # 5.5 and 11 minutes; 30 s each from 1800 s on, where 15 had come; 49.5 after the last quarter.
    inside = [1800 + 30 * (5.5 * count - 15) for count in range(3, 10)]
    assert times(0.0) == pytest.approx([330.0, 660.0, *inside])
    # The first flow holds in a warm-up of 300 s too: 20 have come when the second quarter begins.
    inside = [2100 + 30 * (5.5 * count - 20) for count in range(4, 10)]
    assert times(300.0) == pytest.approx([330.0, 660.0, 990.0, *inside])


@pytest.mark.parametrize("more", [{}, {"group_size": SIZES}, {"first_at_trigger": True}])
def test_equal_quarters_are_one_flow_to_the_bit(more: dict[str, object]) -> None:
    one, four = scene(flow_per_hour=250.0, **more), scene(flow_per_hour=[250.0] * 4, **more)
    assert plans(one, 20) == plans(four, 20)
    double = scene(flow_per_hour=[2 * flow for flow in QUARTERS], **more)
    # A sweep over λ keeps its people: who comes as number i is the same, only earlier.
    for slow, fast in zip(plans(scene(flow_per_hour=QUARTERS, **more), 20), plans(double, 20),
                          strict=True):  # fmt: skip
        for a, b in zip(slow, fast, strict=False):
            assert (a.side, a.quantile) == (b.side, b.quantile)
            assert b.arrival_s <= a.arrival_s


def groups_of(plan: tuple[Arrival, ...]) -> list[list[Arrival]]:
    return [[*members] for _, members in groupby(plan, key=lambda a: a.arrival_s)]


def test_groups_have_their_sizes_and_flow_counts_people() -> None:
    pairs, people = 600, 600.0 / 6
    of = scene(600.0, flow_per_hour=600.0, group_size=SIZES, behaviour="gap_acceptance")
    found = plans(of, pairs)
    groups = [members for plan in found for members in groups_of(plan)]
    sizes = Counter(map(len, groups))
    expected = [len(groups) * share for share in SIZES]
    assert stats.chisquare([sizes[size] for size in (1, 2, 3)], expected).pvalue > LUCK
    # A compound Poisson number: mean λT, variance λT E[S²]/E[S].
    counts = np.array([len(plan) for plan in found])
    variance = people * 3.5 / 1.7
    z = stats.norm.isf(LUCK / 2)
    assert abs(counts.mean() - people) < z * np.sqrt(variance / pairs)
    assert counts.var() == pytest.approx(variance, rel=z * np.sqrt(2 / pairs))
    for members in groups:
        assert len({(a.side, a.critical_gap_s) for a in members}) == 1
        assert len({a.quantile for a in members}) == len(members)
    near = np.mean([members[0].side is Side.NEAR for members in groups])
    assert abs(near - 0.5) < z * 0.5 / np.sqrt(len(groups))


@pytest.mark.parametrize("behaviour", ["constant", "gap_acceptance", "reactive", "threshold"])
def test_a_group_steps_off_together_and_each_walks_at_their_own_speed(behaviour, model) -> None:
    # They wait for a car 8 s away until it brakes for them.
    people = {"flow_per_hour": 1200.0, "kerb_wait_s": 8.0, "gap_acceptance": {"mean_s": 8.0}}
    of = validate(
        {
            "pedestrians": {
                **people,
                "behaviour": behaviour,
                "group_size": [0.0, 0.0, 1.0],
                "walking_speed": SPEEDS,
            },
            "arms": {"av": "human_yield", "human": "human_yield"},
            "strategies": {"human_yield": {"yield_rate": 1.0}},
            "ego": {"initial_speed_mps": 8.0, "trigger_range_m": 100.0},
        },
        "test",
    )
    together = waited = 0
    outcomes = [*on_plain(of, model).run(range(15))]
    for outcome in outcomes:
        for members in zip(*[iter(outcome.trace.walks)] * 3, strict=False):
            assert len({walk.start_s for walk in members}) == 1
            if members[0].start_s is not None:
                assert len({walk.speed_mps for walk in members}) == 3
                together += 1
                waited += members[0].start_s > members[0].arrival.arrival_s
    assert together > 40
    assert waited > 10
    for av, human in zip(outcomes[::2], outcomes[1::2], strict=True):
        assert (av.arm, human.arm) == (Arm.AV, Arm.HUMAN)
        shared = zip(av.trace.walks, human.trace.walks, strict=False)
        assert all(mine.arrival == theirs.arrival for mine, theirs in shared)


@pytest.mark.parametrize("flow", [900.0, [900.0, 60.0]])
def test_those_on_the_crosswalk_at_the_trigger_follow_littles_law(flow: object, model) -> None:
    of = scene(1800.0, flow_per_hour=flow, group_size=SIZES, warm_up_s=60.0,
               walking_speed=SPEEDS)  # fmt: skip
    walking = WalkingSpeeds(of, model).unconditional
    pairs = 600
    counts = np.array([len(already_walking(of, pair, walking, 0)) for pair in range(pairs)])
    parts = truncated()
    # λ E[L0/v]; nobody needs 60 s for 9 m at 0.3 m/s or more.
    mean = 0.25 * sum(share * part.expect(lambda v: 9 / v) for share, part in parts)
    # The members of a group of s add up to s each: the variance is at most E[S²]/E[S] as large.
    assert abs(counts.mean() - mean) < 4 * np.sqrt(mean * 3.5 / 1.7 / pairs)


def truncated() -> list[tuple[float, object]]:
    """Share and distribution of each class, and of all others."""
    of = [(0.1, 1.0, 0.5), (0.3, 1.2, 0.25), (0.6, 1.5, 0.2)]
    return [(share, stats.truncnorm((0.3 - m) / s, np.inf, m, s)) for share, m, s in of]


def test_classes_walk_as_their_truncated_normals(model) -> None:
    of = scene(flow_per_hour=900.0, walking_speed=SPEEDS)
    people = [a for plan in plans(of, 10) for a in plan]
    choose = WalkingSpeeds(of, model)
    for number, (share, part) in zip((0, 1, None), truncated(), strict=True):
        speeds = [choose(a, 20.0, 5.0) for a in people if a.walking_class == number]
        assert stats.binomtest(len(speeds), len(people), share).pvalue > LUCK
        assert stats.kstest(speeds, part.cdf).pvalue > LUCK
    # The mixture: E = Σ p m, Var = Σ p (s² + m²) − E².
    speeds = np.array([choose(a, 20.0, 5.0) for a in people])
    mean = sum(share * part.mean() for share, part in truncated())
    square = sum(share * (part.var() + part.mean() ** 2) for share, part in truncated())
    variance = square - mean**2
    assert abs(speeds.mean() - mean) < 3.29 * np.sqrt(variance / len(speeds))
    assert speeds.var() == pytest.approx(variance, rel=0.05)


def test_classes_leave_all_others_as_they_were(model) -> None:
    plain = scene(60.0, flow_per_hour=900.0, walking_speed={**SPEEDS, "classes": []})
    of = scene(60.0, flow_per_hour=900.0, walking_speed=SPEEDS)
    one, other = WalkingSpeeds(plain, model), WalkingSpeeds(of, model)
    classed = 0
    for before, after in zip(plans(plain, 50), plans(of, 50), strict=True):
        for a, b in zip(before, after, strict=True):
            assert a == b._replace(walking_class=None)
            assert (one(a, 20.0, 5.0) == other(b, 20.0, 5.0)) is (b.walking_class is None)
            classed += b.walking_class is not None
    assert classed > 200
    # A larger share only adds people to the class.
    more = [{**CLASSES[0], "share": 0.2}]
    wide = scene(60.0, flow_per_hour=900.0, walking_speed={**SPEEDS, "classes": more})
    for small, large in zip(plans(of, 20), plans(wide, 20), strict=True):
        assert all(b.walking_class == 0 for a, b in zip(small, large, strict=True)
                   if a.walking_class == 0)  # fmt: skip


def test_what_has_one_flow_or_single_arrivals_refuses_the_others() -> None:
    for people, key in (({"flow_per_hour": [250.0, 90.0]}, "flow_per_hour: is not supported"),
                        ({"group_size": SIZES}, "group_size: is not supported")):  # fmt: skip
        refuses(f"pedestrians.{key}", lambda of=people: space_of(scene(1800, **of), Arm.AV))
