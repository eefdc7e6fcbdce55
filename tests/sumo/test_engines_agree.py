"""SUMO and the plain engine play the same episodes.

The plain engine integrates constant accelerations in closed form; SUMO is another program.  What
they agree on was computed twice.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from types import MappingProxyType

import numpy as np
import pytest

from harness.encounter.pairing import PairRunner
from harness.engine.shared import close_engine, open_engine
from harness.measures import MEASURES, EpisodeRecord, Outcome
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario, validate
from harness.strategies import registry
from tests.scenes import on_plain

Keys = Mapping[str, object]

NONE: Keys = MappingProxyType({})

# SUMO's own driver is nowhere but in SUMO.
STRATEGIES = [name for name in registry.STRATEGIES if name != "sumo_driver"]


def random_scene(
    rng: np.random.Generator, seed: int, people: Keys, own: Keys = NONE, road: Keys = NONE
) -> Scenario:
    """Each strategy in turn against any, any of a few egos, flows from one walker to many.

    The ego has some keys of its ``own``, and so has the ``road``.
    """
    first = bool(rng.random() < 0.5)
    ego = {
        "initial_speed_mps": float(rng.choice([3.0, 5.0, 8.3])),
        "trigger_range_m": float(rng.choice([30.0, 42.5])),
        # Never exactly where a step ends: the last bit would decide what is seen.
        "detection_range_m": float(rng.choice([20.03, 60.0])),
        **own,
    }
    pedestrians = {
        "flow_per_hour": float(rng.choice([150, 600, 1500])),
        "first_at_trigger": first,
        "near_side_share": float(rng.random()),
        "kerb_wait_s": float(rng.choice([0.0, 2.0])),
        **people,
    } | ({"max_count": 1} if rng.random() < 0.3 else {})
    arms = {"av": STRATEGIES[seed % len(STRATEGIES)], "human": str(rng.choice(STRATEGIES))}
    human = {"reading": str(rng.choice(["marginal", "given_time_advantage"]))}
    human["speed"] = str(rng.choice(["mode", "sampled"]))
    step_s = float(rng.choice([0.1, 0.1, 0.05]))
    tree = {"ego": ego, "pedestrians": pedestrians, "arms": arms, "model": {"extrapolate": True}}
    tree["strategies"] = {"human_gmm": human}
    tree["experiment"] = {"seed": seed, "timeout_s": 40.0, "step_s": step_s}
    if seed % 4 == 0:
        tree["actuation"] = {"dead_time_s": 0.25, "lag_s": 0.3, "max_jerk_mps3": 9.0, "human": True}
        road = {**road, "grade": -0.05, "friction": 0.4}
    return validate({**tree, "crossing": {**road}}, "test")


def same(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-7, abs_tol=1e-7)
    return one == other


def assert_same_episode(sumo: Outcome, plain: Outcome, where: object) -> None:
    a, b = sumo.trace, plain.trace
    # A rear bumper exactly on the edge at a step's end may take one step more to have passed.
    assert abs(len(a.x_m) - len(b.x_m)) <= 1, where
    for mine, theirs in ((a.x_m, b.x_m), (a.speed_mps, b.speed_mps)):
        count = min(len(mine), len(theirs))
        np.testing.assert_allclose(
            mine[:count], theirs[:count], atol=1e-6, rtol=0, err_msg=str(where)
        )
    ours, others = (
        [w for w in outcome.trace.walks if w.arrival.arrival_s <= outcome.record.end_s - 1e-9]
        for outcome in (sumo, plain)
    )
    assert [w.arrival for w in ours] == [w.arrival for w in others], where
    for walk, other in zip(ours, others, strict=True):
        for name in ("start_s", "speed_mps", "range_m", "vehicle_speed_mps"):
            assert same(getattr(walk, name), getattr(other, name)), (where, name, walk, other)
    names = [field.name for field in fields(EpisodeRecord)]
    names += [measure.column for measure in MEASURES]
    for name in set(names) - {"sumo_collision", "values"}:
        mine, theirs = getattr(sumo.record, name), getattr(plain.record, name)
        assert same(mine, theirs), (where, name, mine, theirs)
    assert b.sumo_collision is None
    assert isinstance(a.sumo_collision, bool)


def random_scenes(scenes: int, seed: int, **people: object) -> Iterator[Scenario]:
    rng = np.random.default_rng(seed)
    return (random_scene(rng, number, people) for number in range(scenes))


def compare(scenes: Iterable[Scenario], pairs: int, sumo, model: InteractionModel) -> Counter[str]:
    seen: Counter[str] = Counter()
    for number, scene in enumerate(scenes):
        in_sumo = PairRunner(scene, model, lambda scene=scene: sumo(scene)).run(range(pairs))
        for one, other in zip(in_sumo, on_plain(scene, model).run(range(pairs)), strict=True):
            where = (number, one.pair, one.arm, one.strategy)
            assert_same_episode(one, other, where)
            seen[one.strategy] += 1
            seen[one.record.ending] += 1
            seen["seen by SUMO"] += bool(one.trace.sumo_collision)
            seen["SUMO alone"] += bool(one.trace.sumo_collision) and one.record.contact is None
            seen["met"] += one.record.pedestrians
            seen["met several"] += one.record.pedestrians > 1
            starts = ((walk.start_s, walk.arrival.arrival_s) for walk in one.trace.walks)
            seen["set off late"] += any(at and at > came + 1 for at, came in starts)
    return seen


def test_a_few_hundred_random_episodes(sumo, model) -> None:
    scenes = 4 * len(STRATEGIES)
    seen = compare(random_scenes(scenes, 7), 5, sumo, model)
    assert sum(seen[name] for name in STRATEGIES) == scenes * 5 * 2
    assert min(seen[name] for name in STRATEGIES) >= 20
    assert seen["crossed"] > 100
    assert seen["crashed"] >= 5
    assert seen["met several"] > 50
    # SUMO looks once or twice a step, and at a car on the junction alone: it misses some contacts.
    # People may still be where they were a step ago when it looks.
    assert 0 < seen["seen by SUMO"] < seen["crashed"]
    assert seen["SUMO alone"] <= 1


def test_pedestrians_who_decide_by_thresholds(sumo, model) -> None:
    wary = {"behaviour": "threshold", "threshold": {"factor": 2.0}}
    seen = compare(random_scenes(3 * len(STRATEGIES), 9, **wary), 4, sumo, model)
    assert seen["set off late"] > 3


@pytest.mark.slow
def test_thousands_of_random_episodes(sumo, model) -> None:
    seen = compare(random_scenes(150, 8), 10, sumo, model)
    assert seen["crossed"] + seen["crashed"] + seen["timed_out"] == 3000


@pytest.mark.usefixtures("no_simulation")
def test_sumo_says_nothing_of_its_own(capfd: pytest.CaptureFixture[str]) -> None:
    """Standard output is for results, and standard error for the harness's own lines."""
    engine = open_engine(Scenario())
    engine.begin([])
    engine.step(5.0, [])
    engine.end()
    close_engine()
    assert capfd.readouterr() == ("", "")
