"""Pedestrians in SUMO walk as asked, whatever the vehicle does; SUMO's own walk by themselves."""

import libsumo
import numpy as np
import pytest

from harness.core.encounter import Side
from harness.encounter.arrivals import planned_arrivals
from harness.encounter.cell_constants import constants_of
from harness.encounter.loop import run_episode
from harness.engine.control import SumoEngine
from harness.measures import measure
from harness.strategies.constant_speed import ConstantSpeed
from harness.strategies.hard_yield import HardYield
from tests.scenes import play, scenario
from tests.sites import frame_of


class Watched:
    """A SUMO engine that notes where SUMO itself has everyone after each step."""

    def __init__(self, engine: SumoEngine) -> None:
        self._engine = engine
        self.seen: list[dict[int, tuple[float, float]]] = []

    def __getattr__(self, name):
        return getattr(self._engine, name)

    def begin(self, arrivals):
        state = self._engine.begin(arrivals)
        self._note()
        return state

    def step(self, speed_mps, pedestrians):
        state = self._engine.step(speed_mps, pedestrians)
        self._note()
        return state

    def _note(self) -> None:
        positions = {}
        for index, name in self._engine.people.ids.items():
            if name in libsumo.person.getIDList():
                positions[index] = FRAME.to_road(*libsumo.person.getPosition(name))
        self.seen.append(positions)


FRAME = frame_of(scenario().crossing)

KERB_BAND_M = 0.011
"""Within a centimetre of a kerb SUMO moves a person by up to 11 mm (docs/simulations.md)."""

WALKERS = [(0.0, Side.NEAR, 1.2), (0.234, Side.FAR, 0.9)]
WALKERS += [(1.05, Side.NEAR, 1.61), (3.0, Side.FAR, 1.337)]


@pytest.mark.parametrize("strategy", [ConstantSpeed, HardYield])
def test_positions_are_speed_times_time(sumo, strategy) -> None:
    engine = Watched(sumo(scenario()))
    trace = play(strategy(), WALKERS, engine=engine)
    checked = 0
    for step, positions in enumerate(engine.seen):
        for index, (x, y) in positions.items():
            start, side, speed = WALKERS[index]
            progress = min(max(0.0, speed * (step * 0.1 - start)), 9.0)
            expected = progress if side is Side.NEAR else 9.0 - progress
            if step * 0.1 < start:
                continue  # on their way to the kerb
            at_kerb = min(expected, 9.0 - expected) < KERB_BAND_M
            assert abs(x) < 1e-6
            assert y == pytest.approx(expected, abs=KERB_BAND_M if at_kerb else 1e-6)
            checked += 1
    assert checked > 150
    assert [walk.start_s for walk in trace.walks] == [start for start, _, _ in WALKERS]


def test_waiting_pedestrians_stand_still_until_the_vehicle_has_gone(sumo) -> None:
    # With a 2 s rule somebody who comes at 4.3 s (R = 8.5 m, edge in 1.3 s) must wait.
    scene = scenario(pedestrians={"kerb_wait_s": 2.0})
    engine = Watched(sumo(scene))
    trace = play(ConstantSpeed(), [(4.3, Side.NEAR, 1.2)], scene, engine)
    assert trace.walks[0].start_s is None
    waited = np.array([positions[0] for positions in engine.seen[43:]])
    assert len(waited) > 25
    np.testing.assert_allclose(waited, waited[:1].repeat(len(waited), axis=0), atol=1e-9)
    np.testing.assert_allclose(waited, 0.0, atol=KERB_BAND_M)


def test_engine_starts_exactly_at_the_trigger(sumo) -> None:
    engine = sumo(scenario())
    assert engine.begin(()) == (-30.0, 5.0)
    ego = FRAME.to_road(*libsumo.vehicle.getPosition(engine._ego))
    np.testing.assert_allclose(ego, (-30.0, 2.25), atol=1e-6)
    engine.end()


def test_timed_pedestrians_walk_as_planned_before_the_kerb_too(sumo) -> None:
    walk = {"start_lateral_m": 4.0, "acceleration_distance_m": 1.0, "speed_mps": 25 / 18}
    timed = {"side": "near", "impact_share": 0.25, **walk}
    scene = scenario(pedestrians={"flow_per_hour": 0.0, "timed": [timed]})
    engine, planned = Watched(sumo(scene)), planned_arrivals(scene, 0)
    trace = run_episode(engine, ConstantSpeed(), planned, lambda *_: 1.0, constants_of(scene))
    # Contact at 29.75/5 = 5.95 s; 1 m from rest in 1.44 s, 2.55 m in 1.836 s before it.
    start = 5.95 - 1.44 - 1.836
    for step, positions in enumerate(engine.seen):
        walked = max(0.0, step * 0.1 - start)
        evenly = (25 / 18) ** 2 / 2 * walked**2 / 2
        y = -1.75 + (evenly if walked <= 1.44 else 1 + 25 / 18 * (walked - 1.44))
        # The footpath ends 1.5 m before the kerb; there SUMO moves a person as at the kerb.
        near_an_end = min(abs(y), abs(y + 1.5)) < KERB_BAND_M
        tolerance = KERB_BAND_M if near_an_end else 1e-6
        assert positions[0] == pytest.approx((0.0, y), abs=tolerance)
    (record,) = measure([trace])
    assert record.contact_time_s == pytest.approx(5.95, abs=1e-9)
    assert record.sumo_collision is True
