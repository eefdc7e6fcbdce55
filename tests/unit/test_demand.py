"""Who comes when: λ, groups, classes of walking speeds.

The seeds are fixed.  With other seeds each p-value would be below 1e-3 in one of 1,000 runs.
"""

from collections import Counter
from itertools import groupby

import numpy as np
import pytest
from scipy import stats

from harness.core.vocabulary import Arm, Side
from harness.encounter.arrivals import already_walking
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.scenario import Scenario, validate
from harness.studies.risk.space import space_of
from tests.scenes import on_plain, plans, refuses

LUCK = 1e-3
SIZES = [0.5, 0.3, 0.2]
"""Mean 1.7 people, mean square 3.5."""

CLASSES = [{"share": 0.1, "mean_mps": 1.0, "std_mps": 0.5}, {"share": 0.3, "mean_mps": 1.2}]
SPEEDS = {"mean_mps": 1.5, "std_mps": 0.2, "classes": CLASSES}


def scene(timeout_s: float = 3600.0, **pedestrians: object) -> Scenario:
    return validate({"pedestrians": pedestrians, "experiment": {"timeout_s": timeout_s}}, "test")


@pytest.mark.parametrize("more", [{}, {"group_size": SIZES}, {"first_at_trigger": True}])
def test_a_sweep_over_the_flow_keeps_its_people(more: dict) -> None:
    """Who comes as number i is the same, only earlier: time is stretched."""
    slow, fast = (plans(scene(flow_per_hour=flow, **more), 20) for flow in (250.0, 500.0))
    for one, other in zip(slow, fast, strict=True):
        for a, b in zip(one, other, strict=False):
            assert (a.side, a.quantile) == (b.side, b.quantile)
            assert b.arrival_s == pytest.approx(a.arrival_s / 2)


def test_groups_have_their_sizes_and_flow_counts_people() -> None:
    pairs, people = 600, 600.0 / 6
    of = scene(600.0, flow_per_hour=600.0, group_size=SIZES, behaviour="gap_acceptance")
    found = plans(of, pairs)
    together = (groupby(plan, key=lambda a: a.arrival_s) for plan in found)
    groups = [[*members] for plan in together for _, members in plan]
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
    people["walking_speed"] = SPEEDS
    of = validate(
        {
            "pedestrians": people | {"behaviour": behaviour, "group_size": [0.0, 0.0, 1.0]},
            "arms": {"av": "human_yield", "human": "human_yield"},
            "strategies": {"human_yield": {"yield_rate": 1.0}},
            "ego": {"initial_speed_mps": 8.0, "trigger_range_m": 100.0},
        },
        "test",
    )
    together = waited = 0
    for outcome in on_plain(of, model).run(range(15)):
        for members in zip(*[iter(outcome.trace.walks)] * 3, strict=False):
            assert len({walk.start_s for walk in members}) == 1
            if members[0].start_s is not None:
                assert len({walk.speed_mps for walk in members}) == 3
                together += 1
                waited += members[0].start_s > members[0].arrival.arrival_s
    assert together > 40
    assert waited > 10


def test_those_on_the_crosswalk_at_the_trigger_follow_littles_law(model) -> None:
    of = scene(1800.0, flow_per_hour=900.0, group_size=SIZES, warm_up_s=60.0,
               walking_speed=SPEEDS)  # fmt: skip
    walking = WalkingSpeeds(of, model).unconditional
    pairs = 600
    counts = np.array([len(already_walking(of, pair, walking, 0)) for pair in range(pairs)])
    parts = truncated()
    # λ E[L0/v]; nobody needs 60 s for 9 m at 0.3 m/s or more.
    mean = 0.25 * sum(share * part.expect(lambda v: 9 / v) for share, part in parts)
    # The members of a group of s add up to s each: the variance is at most E[S²]/E[S] as large.
    assert abs(counts.mean() - mean) < 4 * np.sqrt(mean * 3.5 / 1.7 / pairs)


def truncated():
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


def test_what_has_single_arrivals_refuses_groups() -> None:
    of = scene(1800, group_size=SIZES)
    refuses("pedestrians.group_size: is not supported", lambda: space_of(of, Arm.AV))
