"""The Gymnasium environment: its contract, and the same episodes as the harness."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from examples.policies import NEAREST, YieldToTheNearest, yield_to_the_nearest  # noqa: E402
from harness.core.errors import StrategyError  # noqa: E402
from harness.core.vocabulary import Crossing, EgoView, Ending, Observation, PedestrianView, Side  # noqa: E402
from harness.model.interaction import load_model  # noqa: E402
from harness.scenario import Setting, load_scenario  # noqa: E402
from harness.strategies import registry  # noqa: E402
from harness.strategies.vector import observation_vector  # noqa: E402
from tests.scenes import on_plain, refuses  # noqa: E402

NAME = "harness.rl:harness/Crosswalk-v0"
BUSY = {"pedestrians.flow_per_hour": 800.0, "pedestrians.kerb_wait_s": 0.0}
"""Many conflicts in few episodes."""


def environment(settings=None, scenario="cctc_flow", engine="plain", **more):
    return gymnasium.make(
        NAME, scenario=scenario, settings=settings, engine=engine, disable_env_checker=True, **more
    )


def drive(env, policy, **reset):
    """One episode: its record, the sum of its rewards and its number of steps."""
    vector, _ = env.reset(**reset)
    total, steps = 0.0, 0
    while True:
        action = np.array([policy(vector)], dtype=np.float64)
        vector, reward, terminated, truncated, info = env.step(action)
        total, steps = total + reward, steps + 1
        if terminated or truncated:
            record = env.unwrapped.record
            assert info == {"ending": record.ending}
            return record, total, steps, (terminated, truncated)


def in_the_harness(settings, strategy, pairs):
    """Records of the AV's arm as the harness makes them, on the plain engine."""
    changes = [Setting(key, value) for key, value in {**settings, "arms.av": strategy}.items()]
    scenario = load_scenario("cctc_flow", changes)
    model = load_model(scenario.model.name)
    outcomes = on_plain(scenario, model).run(pairs)
    return [outcome.record for outcome in outcomes if outcome.arm == "av"]


def measured(records):
    """The records without what an environment does not know.

    Its episode is over at a contact, so nothing after it is known; and it does not count how the
    interaction model is asked.
    """
    known = []
    for record in records:
        unknown = {"conditionings": 0, "clamped": 0, "near_clamped": 0}
        unknown |= {"clamped_speed_excess_mps": None, "clamped_range_excess_m": None}
        if record.ending is Ending.CRASHED:
            unknown["pass_time_ignoring_contact_s"] = None
        known.append(replace(record, **unknown))
    return known


def test_gymnasiums_own_checker_accepts_it():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment(BUSY).unwrapped)
        check_env(environment(BUSY, render_mode="rgb_array").unwrapped)
        check_env(environment(None, "cctc").unwrapped)


@pytest.mark.parametrize("seed", [1, 7])
def test_the_same_seed_gives_the_harness_episodes(seed):
    settings = {**BUSY, "experiment.seed": seed}
    expected = in_the_harness(settings, "constant_speed", range(60))
    env = environment(BUSY)
    found = [drive(env, lambda _: 0.0, seed=seed)[0]]
    found += [drive(env, lambda _: 0.0)[0] for _ in range(59)]
    # Both have crashes and passes, or the test would say nothing.
    assert 5 < sum(record.ending is Ending.CRASHED for record in found) < 55
    assert measured(found) == measured(expected)


POOR_EYES = {
    "perception.latency_s": 0.5,
    "perception.detection_probability": 0.3,
    "perception.position_sd_m": 0.3,
}


@pytest.mark.parametrize("eyes", [{}, POOR_EYES])
def test_a_policy_drives_the_same_as_a_strategy(monkeypatch, eyes):
    own = {"policy": YieldToTheNearest, **registry.STRATEGIES}
    monkeypatch.setattr(registry, "STRATEGIES", own)
    expected = in_the_harness({**BUSY, **eyes}, "policy", range(40))
    env = environment({**BUSY, **eyes}, nearest=NEAREST)
    found = [drive(env, yield_to_the_nearest, options={"pair": pair})[0] for pair in range(40)]
    assert sum(record.stops > 0 for record in found) > 5
    assert measured(found) == measured(expected)


def test_reward_is_minus_the_time_and_100_for_a_crash():
    # Free road: 37 m at 5 m/s is 7.4 s, 74 steps of 0.1 s.
    free = environment({"pedestrians.flow_per_hour": 0.0})
    record, total, steps, ends = drive(free, lambda _: 0.0)
    assert (steps, ends) == (74, (True, False))
    assert total == pytest.approx(-7.4)
    assert record.pass_time_s == pytest.approx(7.4)
    crashed = environment({**BUSY, "pedestrians.flow_per_hour": 3000.0})
    record, total, steps, ends = drive(crashed, lambda _: 0.0, seed=3)
    assert record.ending is Ending.CRASHED
    assert steps == math.ceil(record.contact_time_s / 0.1 - 1e-9)
    assert total == pytest.approx(-0.1 * steps - 100)
    assert ends == (True, False)
    # From 5 m/s at 1 m/s² each step begins at 5 + 0.1 n m/s: 0.1 · 0.1 n m too many.
    _, total, steps, _ = drive(free, lambda _: 1 / 3)
    excess = sum(0.1 * 0.1 * n for n in range(steps))
    assert total == pytest.approx(-0.1 * steps - excess)
    env = environment({"experiment.timeout_s": 12.0})
    record, total, steps, ends = drive(env, lambda _: -1.0)
    assert (record.ending, steps, ends) == (Ending.TIMED_OUT, 120, (False, True))
    assert total == pytest.approx(-12.0)


def test_the_vector_takes_the_nearest_first():
    vehicle = load_scenario("cctc").vehicle()
    far = PedestrianView(0, Side.FAR, 6.0, 8.25, 1.5, True)
    near = PedestrianView(1, Side.NEAR, -1.0, 5.75, 1.25, True)
    waits = PedestrianView(2, Side.NEAR, 2.25, 9.0, 0.0, False)
    ego = EgoView(20.0, 4.0, -0.5)
    crossing = Crossing(9.0, 4.0, 2.25, 4.5)
    observation = Observation(1.0, 0.1, ego, vehicle, crossing, (far, near, waits))
    expected = [20, 4, -0.5, 1, -1, 5.75, 1.25, 1, 1, 2.25, 9, 0, 0]
    assert observation_vector(observation, 2).tolist() == expected
    assert observation_vector(observation, 4).tolist()[13:] == [1, 6, 8.25, 1.5, 1, 0, 0, 0, 0, 0]


def test_misuse_is_refused_in_words():
    refuses("nearest", lambda: environment(nearest=0))
    refuses("is a scenario of simulations", lambda: environment(scenario="traffic"))

    refuses("pair", lambda: environment().reset(options={"pair": -1}))
    refuses("key 'paar'; .*mean 'pair'", lambda: environment().reset(options={"paar": 1}))
    refuses("seed: 9223372036854775808 is not", lambda: environment().reset(seed=2**63))
    env = environment()
    env.reset()
    assert env.step(0.5)[0][1] > env.step(np.float32(-9.0))[0][1]
    refuses("a number or an array of one", lambda: env.step(np.array([0.1, 0.2])))
    with pytest.raises(StrategyError, match="the strategy returned nan"):
        env.step(np.array([math.nan]))
    refuses("no episode has ended", lambda: environment().unwrapped.record)
    refuses("after reset", lambda: environment().unwrapped.step(np.zeros(1, dtype=np.float32)))
    # the error ended the episode
    refuses("after reset", lambda: env.unwrapped.step(np.zeros(1)))


def test_an_action_is_a_share_of_what_the_car_can_do():
    """-1 brakes at 4.5 m/s² and 1 accelerates at 3 m/s², the defaults of docs/method.md."""
    env = environment({"pedestrians.flow_per_hour": 0.0})
    for action, wanted in ((-1.0, -4.5), (0.5, 1.5), (9.0, 3.0)):
        before, _ = env.reset()
        after, *_ = env.step(np.array([action]))
        assert after[1] - before[1] == pytest.approx(0.1 * wanted, abs=1e-6)
