"""The Gymnasium environment in SUMO."""

import libsumo
import pytest

pytest.importorskip("gymnasium")

from harness.core.errors import EngineError
from harness.core.vocabulary import Arm, Ending
from harness.encounter.pairing import PairRunner
from harness.engine.shared import close_engine, open_engine
from harness.model.interaction import load_model
from harness.scenario import Setting, load_scenario
from tests.scenes import refuses
from tests.unit.test_rl import BUSY, drive, environment, measured

pytestmark = pytest.mark.usefixtures("no_simulation")


def test_the_same_records_as_the_harness_after_episodes_broken_off():
    changes = {**BUSY, "arms.av": "constant_speed", "arms.human": "constant_speed"}
    scenario = load_scenario("cctc_flow", [Setting(*item) for item in changes.items()])
    model = load_model(scenario.model.name)
    outcomes = PairRunner(scenario, model, lambda: open_engine(scenario)).run(range(25))
    expected = [outcome.record for outcome in outcomes if outcome.arm is Arm.AV]
    close_engine()
    env = environment(BUSY, engine="sumo")
    found = []
    for pair in range(25):
        env.reset(options={"pair": pair})
        for _ in range(5):
            env.step(env.action_space.sample())
        found.append(drive(env, lambda _: 0.0, options={"pair": pair})[0])
    env.close()
    assert sum(record.ending is Ending.CRASHED for record in found) > 2
    for ours, theirs in zip(measured(found), measured(expected), strict=True):
        # The environment leaves at the contact; SUMO's verdict often comes a step later.
        assert ours == theirs or ours.ending is Ending.CRASHED
        assert ours.contact_time_s == theirs.contact_time_s


def test_one_open_episode_in_sumo_per_process_and_a_new_sumo_after_a_lost_one():
    first, second = environment(engine="sumo"), environment(engine="sumo")
    first.reset()
    refuses("another environment", second.reset)
    first.close()
    expected = drive(second, lambda _: 0.0, options={"pair": 0})[0]
    second.reset()
    libsumo.close()
    with pytest.raises(EngineError, match="failed during the episode"):
        second.step(0.0)
    assert drive(first, lambda _: 0.0, options={"pair": 0})[0] == expected
    first.close()
