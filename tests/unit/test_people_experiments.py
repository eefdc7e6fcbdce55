"""The experiments with measured people: their states by hand, their shares by closed forms."""

from harness.core.encounter import Arrival, Side
from harness.engine.plain import PlainEngine
from harness.episode.cell_constants import constants_of
from harness.episode.loop import run_episode
from harness.scenario import validate
from harness.strategies.constant_speed import ConstantSpeed


def test_who_stands_at_the_kerb_decides_from_the_given_time_on() -> None:
    """Nobody is in their way: a car at 10 m/s is 30 m away, and they need a gap of 0 s."""
    scenario = validate({"ego": {"initial_speed_mps": 10.0}}, "test")
    start_s = {}
    for from_s in (None, 0.0, 1.0):
        person = Arrival(0, 0.0, Side.NEAR, 0.5, critical_gap_s=0.0, looks_from_s=from_s)
        engine = PlainEngine(scenario.vehicle(), 0.1)
        rules = constants_of(scenario)
        trace = run_episode(engine, ConstantSpeed(), [person], lambda *_: 1.0, rules)
        start_s[from_s] = trace.walks[0].start_s
    assert start_s == {None: 0.0, 0.0: 0.0, 1.0: 1.0}
