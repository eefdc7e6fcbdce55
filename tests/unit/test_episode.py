"""One episode: arrivals inside a step, the kerb rule, what a strategy sees, how it ends."""

import math
import re

import numpy as np
import pytest

from harness.core.errors import EngineError
from harness.core.vocabulary import Arrival, Ending, Observation, Side
from harness.engine.plain import PlainEngine
from harness.measures import measure
from harness.scenario.pedestrians import PedestriansSection
from harness.strategies.constant_speed import ConstantSpeed
from tests.scenes import Recorder, episode, play, scenario


@pytest.mark.parametrize("arrival", [0.0, 0.037, 0.1, 0.3, 1.2345678901234, 4.999999])
def test_a_start_is_never_rounded_to_a_step(arrival: float) -> None:
    recorder = Recorder()
    trace = play(recorder, [(arrival, Side.NEAR, 1.3)])
    assert trace.walks[0].start_s == arrival
    # 2.25 m to the lane's centre, 9 m to the other kerb.
    for seen in recorder.seen:
        if seen.time_s <= arrival - 1e-9 or not seen.pedestrians:
            continue
        (view,) = seen.pedestrians
        walked = 1.3 * (seen.time_s - arrival)
        assert view.lateral_m == pytest.approx(2.25 - walked, abs=1e-9)
        assert view.remaining_m == pytest.approx(9 - walked, abs=1e-9)
        expected = (0, Side.NEAR, 1.3, True)
        assert (view.index, view.side, view.speed_mps, view.on_crossing) == expected
    # Seen from the first step that does not begin before they came.
    first = next(seen.time_s for seen in recorder.seen if seen.pedestrians)
    assert first == pytest.approx(math.ceil(arrival / 0.1 - 1e-9) * 0.1)


def test_they_see_the_ego_where_it_is_at_that_moment() -> None:
    # Braking at 0.8 m/s² from 5 m/s at 30 m: after t, 30 − 5 t + 0.4 t² and 5 − 0.8 t.
    arrival = 1.2345
    trace = play(Recorder(lambda _: -0.8), [(arrival, Side.FAR, 1.0)])
    walk = trace.walks[0]
    assert walk.range_m == pytest.approx(30 - 5 * arrival + 0.4 * arrival**2, abs=1e-9)
    assert walk.vehicle_speed_mps == pytest.approx(5 - 0.8 * arrival, abs=1e-9)


BY_DEFAULT = {"kerb_wait_s": PedestriansSection().kerb_wait_s}


@pytest.mark.parametrize(
    ("wait_s", "arrival", "goes"),
    # At 5 m/s the edge (R = 2 m) is 2 s away at R = 12 m: 3.6 s after the trigger.
    [(2.0, 0.0, True), (2.0, 3.5, True), (2.0, 3.59, True), (2.0, 3.61, False), (2.0, 5.0, False),
     # With no waiting at all, still: the body overlaps the crosswalk from R = 2 m (5.6 s) on.
     (2.0, 6.0, False), (0.0, 5.59, True), (0.0, 5.61, False), (0.0, 7.3, False)],
)  # fmt: skip
def test_kerb_rule_and_nobody_under_the_body(wait_s: float, arrival: float, goes: bool) -> None:
    scene = scenario(pedestrians={"kerb_wait_s": wait_s})
    trace = play(ConstantSpeed(), [(arrival, Side.NEAR, 1.2)], scene)
    (walk,) = trace.walks
    assert walk.start_s == (arrival if goes else None)
    assert (walk.speed_mps is None, walk.range_m is None) == (not goes, not goes)


def test_who_waits_looks_again_at_every_step() -> None:
    # From 3.7 s on, 9.5 m before the edge, the ego brakes with 1 m/s², which takes 12.5 m from
    # 5 m/s; from 4.3 s on, 6.68 m before it, with 2 m/s², which takes 4.84 m from 4.4 m/s.  They
    # see that a step later.
    scene = scenario(pedestrians=BY_DEFAULT)
    recorder = Recorder(lambda seen: -np.interp(seen.time_s, [3.65, 3.7, 4.25, 4.3], [0, 1, 1, 2]))
    trace = play(recorder, [(3.66, Side.NEAR, 1.2)], scene)
    walk, expected = trace.walks[0], 4.4
    assert walk.start_s == pytest.approx(expected, abs=1e-12)
    step = 44
    assert walk.range_m == pytest.approx(-trace.x_m[step])
    assert walk.vehicle_speed_mps == pytest.approx(trace.speed_mps[step])
    waiting = [seen for seen in recorder.seen if seen.pedestrians and seen.time_s < expected - 1e-9]
    assert waiting
    for seen in waiting:
        view = seen.pedestrians[0]
        assert (view.speed_mps, view.on_crossing, view.remaining_m) == (0.0, False, 9.0)


@pytest.mark.parametrize(
    ("deceleration", "goes"),
    [(2.5, True), (25 / 14 + 0.01, True), (25 / 14 - 0.01, False), (0.0, False)],
)
@pytest.mark.parametrize("gap_s", [None, 30.0])
def test_a_car_that_stops_before_the_edge_keeps_nobody_waiting(deceleration, goes, gap_s) -> None:
    # It brakes from 4.2 s on, 7 m before the edge: from 5 m/s to a stand takes 25/14 m/s².
    scene = scenario(pedestrians=BY_DEFAULT)
    recorder = Recorder(lambda seen: -deceleration if seen.time_s > 4.15 else 0.0)
    trace = episode(scene, recorder, [Arrival(0, 4.25, Side.NEAR, 0.5, gap_s)])
    assert (trace.walks[0].start_s == 4.25) is goes


@pytest.mark.parametrize("detection_m", [12.3, 25.04, 30.0, 100.0])
def test_nobody_is_seen_beyond_the_detection_range(detection_m: float) -> None:
    scene = scenario(ego={"detection_range_m": detection_m})
    recorder = Recorder()
    play(recorder, [(0.0, Side.NEAR, 0.4)], scene)
    for seen in recorder.seen:
        near = seen.ego.range_m <= detection_m
        assert bool(seen.pedestrians) is near
    assert recorder.seen[0].ego == (30.0, 5.0, 0.0)


def test_commands_are_held_to_the_vehicles_limits() -> None:
    gains = np.diff(play(Recorder(lambda _: 99.0), []).speed_mps) / 0.1
    np.testing.assert_allclose(gains, 3.0, atol=1e-9)
    losses = np.diff(play(Recorder(lambda _: -1e9), []).speed_mps) / 0.1
    # 5 m/s at 4.5 m/s²: eleven whole steps and the rest of the speed in the twelfth.
    np.testing.assert_allclose(losses[:11], -4.5, atol=1e-9)
    assert losses[11] == pytest.approx(-0.5, abs=1e-9)
    np.testing.assert_array_equal(losses[12:], 0.0)


def test_it_ends_when_the_rear_has_left_the_far_edge_in_the_last_step_too() -> None:
    trace = play(ConstantSpeed(), [])
    assert trace.ending is Ending.CROSSED
    assert trace.x_m[-1] >= 7.0 - 1e-9 > trace.x_m[-2]
    # 7.4 s to the far edge.
    late = scenario(experiment={"timeout_s": 7.4})
    assert play(ConstantSpeed(), [], late).ending is Ending.CROSSED


@pytest.mark.parametrize("timeout_s", [7.4, 9.3])
def test_a_time_out(timeout_s: float) -> None:
    # From 5 m/s it stands after 12.5 m, of 30 m.
    scene = scenario(experiment={"timeout_s": timeout_s})
    trace = play(Recorder(lambda _: -1.0), [], scene)
    assert (trace.ending, trace.reason) == (Ending.TIMED_OUT, None)
    assert len(trace.x_m) - 1 == round(timeout_s / 0.1)
    (record,) = measure([trace])
    assert (record.ending, record.pass_time_s) == ("timed_out", None)


def raises(_: Observation) -> float:
    raise ZeroDivisionError("no such number")


@pytest.mark.parametrize(
    ("command", "says"),
    [(lambda _: math.nan, "returned nan"), (lambda _: math.inf, "returned inf"),
     (lambda _: -math.inf, "returned -inf"), (lambda _: np.float32("inf"), "inf"),
     (lambda _: True, "returned True"), (lambda _: np.False_, "False"),
     (lambda _: 10**400, "returned 1000"), (raises, "no such number"),
     (lambda _: "brake", "brake|str"), (lambda _: None, "returned None")],
)  # fmt: skip
def test_a_strategy_that_fails_ends_its_episode_with_a_reason(command, says: str) -> None:
    late = Recorder(lambda seen: command(seen) if seen.time_s > 1.05 else 0.0)
    trace = play(late, [(0.0, Side.NEAR, 1.0)])
    assert trace.ending is Ending.FAILED
    assert len(trace.reason.splitlines()) == 1
    assert re.search(says, trace.reason)
    (record,) = measure([trace])
    assert (record.ending, record.reason) == ("failed", trace.reason)
    assert (record.pass_time_s, record.delay_s) == (None, None)
    # The states up to there are kept.
    assert len(trace.x_m) == 12


class Failing(PlainEngine):
    """Breaks at a given call."""

    def __init__(self, at: str) -> None:
        scene = scenario()
        super().__init__(scene.vehicle(), 0.1)
        self._at = at

    def begin(self, arrivals):
        if self._at == "begin":
            raise EngineError("no ego")
        return super().begin(arrivals)

    def step(self, speed_mps, pedestrians):
        if self._at == "step" and self._x_m > -20:
            raise EngineError("lost ego")
        return super().step(speed_mps, pedestrians)

    def remove(self, index):
        if self._at == "remove":
            raise EngineError(f"lost pedestrian {index}")

    def end(self):
        if self._at == "end":
            raise EngineError("no end")
        return super().end()


@pytest.mark.parametrize("at", ["begin", "step", "remove", "end"])
def test_an_engine_that_fails_ends_its_episode_with_a_reason(at: str) -> None:
    arrivals = [Arrival(0, 0.0, Side.NEAR, 0.5), Arrival(1, 2.04, Side.FAR, 0.5)]
    trace = episode(scenario(), ConstantSpeed(), arrivals, lambda *_: 2.5, engine=Failing(at))
    assert (trace.ending, trace.failed_in) == (Ending.FAILED, "engine")
    assert trace.reason in {"no ego", "lost ego", "lost pedestrian 0", "no end"}
    (record,) = measure([trace])
    unknown = {count is None for count in (record.steps, record.pedestrians, record.clamped)}
    assert (record.ending, record.contact, unknown) == ("failed", None, {at == "begin"})
