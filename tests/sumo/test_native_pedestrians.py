"""SUMO's own pedestrians: they walk by themselves, and stop for a car that ignores them."""

import pytest

from harness.core.encounter import Arrival, Ending, Observation, Side
from harness.engine.plain import PlainEngine
from harness.episode.cell_constants import constants_of
from harness.episode.loop import run_episode
from harness.episode.pairing import PairRunner
from harness.measures import measure
from harness.scenario import Scenario, validate
from harness.strategies.constant_speed import ConstantSpeed


def scene(behaviour: str = "sumo", **pedestrians: object) -> Scenario:
    values = {"behaviour": behaviour, "kerb_wait_s": 0.0, **pedestrians}
    return validate({"pedestrians": values}, "test")


def play(scenario: Scenario, engine, strategy, side: Side, arrival_s: float, speed: float):
    arrivals = [Arrival(0, arrival_s, side, 0.5)]
    return run_episode(engine, strategy, arrivals, lambda *_: speed, constants_of(scenario))


class Waits:
    """Stands far away while anyone is there; keeps what it sees."""

    def __init__(self) -> None:
        self.seen: list[Observation] = []

    def decide(self, observation: Observation, /) -> float:
        self.seen.append(observation)
        return -3.0 if observation.pedestrians or observation.time_s < 1 else 1.0


@pytest.mark.parametrize("side", list(Side))
def test_undisturbed_he_walks_at_the_speed_of_the_model(sumo, side: Side) -> None:
    driver = Waits()
    trace = play(scene(), sumo(scene()), driver, side, 0.34, 1.3)
    assert trace.ending is Ending.CROSSED
    (walk,) = trace.walks
    # They are at the footpath's end, 1.5 m before the kerb, when the step of their arrival is over.
    assert walk.start_s == pytest.approx(0.4 + 1.5 / 1.3, abs=1e-6)
    assert (walk.speed_mps, walk.range_m) == (1.3, pytest.approx(30 - 5 * 0.34 + 1.5 * 0.34**2))
    assert walk.legs is not None
    across = 1.3 if side is Side.NEAR else -1.3
    assert [leg.y_mps for leg in walk.legs] == pytest.approx([across] * len(walk.legs), abs=1e-6)
    # SUMO's pedestrians keep to the right: 2 m from the centre line is the edge of the crosswalk.
    assert all(0.5 < abs(leg.x_m) < 2.0 for leg in walk.legs)
    # 9 m at 1.3 m/s, then they are gone.
    gone = max(o.time_s for o in driver.seen if o.pedestrians)
    assert gone == pytest.approx(walk.start_s + 9 / 1.3, abs=0.1)
    views = [o.pedestrians[0] for o in driver.seen if o.pedestrians]
    assert [v.on_crossing for v in views] == [v.remaining_m <= 9.0 for v in views]


def test_he_stops_for_a_car_that_ignores_him(sumo) -> None:
    # Held at constant speed the same person walks into its flank: from the far kerb at 1.66 s at
    # 1.3 m/s their disc reaches its left side (y = 3.4 m) at 5.97 s, while it is over the line
    # from 5.95 to 7.05 s.
    held = scene("constant")
    side, at_kerb_s, speed = Side.FAR, 1.66, 1.3
    trace = play(held, sumo(held), ConstantSpeed(), side, at_kerb_s, speed)
    assert measure([trace])[0].ending is Ending.CRASHED
    trace = play(scene(), sumo(scene()), ConstantSpeed(), side, at_kerb_s - 1.5 / speed, speed)
    (record,) = measure([trace])
    (walk,) = trace.walks
    assert walk.start_s == pytest.approx(at_kerb_s, abs=0.1)
    assert record.ending is Ending.CROSSED
    assert walk.legs is not None
    standing = [leg for leg in walk.legs if leg.y_mps == 0]
    assert len(standing) > 10
    assert all(3.4 < leg.y_m < 4.5 for leg in standing)


def test_the_same_walks_first_or_last_in_a_simulation(sumo, model) -> None:
    scenario = scene(flow_per_hour=1500.0)
    runner = PairRunner(scenario, model, lambda: sumo(scenario))
    together = [(repr(o.trace.walks), repr(o.record)) for o in runner.run(range(8))]
    again = [(repr(o.trace.walks), repr(o.record)) for pair in (7, 0) for o in runner.run([pair])]
    assert again == together[14:16] + together[0:2]
    # Another engine says that it has none.
    trace = play(scene(), PlainEngine(scene().vehicle(), 0.1), Waits(), Side.NEAR, 0.0, 1.3)
    assert trace.ending is Ending.ENGINE_FAILED
    assert trace.reason is not None
    assert "needs SUMO" in trace.reason
