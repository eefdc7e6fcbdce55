"""SUMO's own driver at the crosswalk: what it does, what it is shown, and who has priority."""

import numpy as np
import pytest

from harness.core.encounter import Arm, Contact, Ending, Side
from harness.engine.network import network_of
from harness.episode.pairing import PairRunner
from harness.measures import measure
from harness.scenario import Scenario
from harness.strategies.sumo_driver import SumoDriver
from tests.scenes import play, scenario

STEP, WALKING = 0.1, 1.2


def scene(priority: bool = True, **pedestrians: object) -> Scenario:
    return scenario(crossing={"pedestrian_priority": priority}, pedestrians=pedestrians)


def stop_of(trace) -> tuple[float, float, float]:
    """(range where it begins to brake, range where it stands, time at which it starts again)."""
    braking = int(np.flatnonzero(np.diff(trace.speed_mps) < -1e-6)[0])
    standing = np.flatnonzero(trace.speed_mps < 1e-6)
    return -trace.x_m[braking], -trace.x_m[standing[0]], float(standing[-1]) * STEP


def test_alone_it_drives_at_v0_else_within_the_scenarios_limits(sumo) -> None:
    trace = play(SumoDriver(), [], scene(), sumo(scene()))
    np.testing.assert_allclose(trace.speed_mps, 5.0, atol=1e-9)
    trace = play(SumoDriver(), [(3.0, Side.NEAR, 0.6)], scene(), sumo(scene()))
    changes = np.diff(trace.speed_mps) / STEP
    assert trace.speed_mps.min() == 0.0
    assert trace.speed_mps.max() <= 5.0 + 1e-9  # the road itself allows 100 m/s
    assert changes.max() == pytest.approx(1.0)  # a0, not the vehicle's 3 m/s²
    assert changes.min() >= -4.5 - 1e-9


@pytest.mark.parametrize("priority", [True, False])
def test_stops_for_whoever_walks_from_either_side(sumo, priority: bool) -> None:
    # It starts again when they are as far past its lane's centre, whichever side they are from.
    past = {}
    for side, to_centre in ((Side.NEAR, 2.25), (Side.FAR, 6.75)):
        for start in (3.5, 4.5):
            engine = sumo(scene(priority))
            trace = play(SumoDriver(), [(start, side, WALKING)], scene(priority), engine)
            assert trace.walks[0].start_s == start
            braking, standing, again = stop_of(trace)
            assert 5.0 < braking < 7.0  # late: v²/2b before its stop
            assert standing == pytest.approx(3.0, abs=0.05)
            past[side, start] = WALKING * (again - start) - to_centre
    assert max(past.values()) - min(past.values()) < WALKING * STEP
    # Out of its path, 1.15 m, and no further than its lane.
    assert 1.15 < min(past.values()) < 2.25


@pytest.mark.parametrize("side", list(Side))
def test_those_who_are_held_are_to_it_as_sumos_own(sumo, side: Side) -> None:
    # SUMO's own pedestrian, for whom SUMO knows on which side they are and where they go.
    native_scene = scene(behaviour="sumo")
    native = play(SumoDriver(), [(2.2, side, WALKING)], native_scene, sumo(native_scene))
    start = native.walks[0].start_s
    assert start is not None
    held = play(SumoDriver(), [(start, side, WALKING)], scene(), sumo(scene()))
    limits = (0.01, 0.01, STEP + 1e-9)
    for one, other, within in zip(stop_of(native), stop_of(held), limits, strict=True):
        assert one == pytest.approx(other, abs=within)


@pytest.mark.parametrize("side", list(Side))
def test_priority_decides_about_those_who_wait(sumo, side: Side) -> None:
    # They wait until the ego stands, or for ever.
    walker = [(1.0, side, WALKING)]
    stops = play(SumoDriver(), walker, scene(kerb_wait_s=30.0), sumo(scene(kerb_wait_s=30.0)))
    assert stops.walks[0].start_s is not None
    assert stops.speed_mps.min() == 0.0
    passes = play(
        SumoDriver(), walker, scene(priority=False, kerb_wait_s=30.0), sumo(scene(priority=False))
    )
    assert passes.walks[0].start_s is None
    np.testing.assert_allclose(passes.speed_mps, 5.0, atol=1e-9)


class Mixed:
    """Brakes by itself, lets SUMO drive, brakes again, lets SUMO drive again."""

    def decide(self, seen):
        return -1.0 if int(seen.time_s + 1e-9) % 2 == 0 else None


def test_a_strategy_may_mix_numbers_and_none(sumo) -> None:
    # 5 m/s: −1 m/s² for a second, +1 (a0) for the next, and so on.
    trace = play(Mixed(), [], scene(), sumo(scene()))
    assert trace.ending is Ending.CROSSED
    np.testing.assert_allclose(trace.speed_mps[[0, 10, 20, 30, 40]], [5, 4, 5, 4, 5], atol=1e-9)
    # Ballistic steps in both: 4.5 m each second.
    np.testing.assert_allclose(trace.x_m[[0, 10, 20, 30, 40]], -30 + 4.5 * np.arange(5), atol=1e-9)


def test_taken_back_sumo_no_longer_brakes(sumo) -> None:
    class Back:
        def decide(self, seen):
            return None if seen.time_s < 3 else 0.0

    # In the ego's path, 1.1 to 3.4 m, from 2.2 to 6.8 s.
    trace = play(Back(), [(0.0, Side.NEAR, 0.5)], scene(), sumo(scene()))
    np.testing.assert_allclose(trace.speed_mps, 5.0, atol=1e-9)
    assert measure([trace])[0].contact is Contact.FRONT


def test_it_is_still_noticed_when_sumo_does_not_keep_to_a_speed(sumo, monkeypatch) -> None:
    engine = sumo(scene())
    own = type(engine).step

    def step(self, speed, pedestrians):
        state = own(self, speed, pedestrians)
        if speed is not None and self._steps == 15:
            self._commanded += 0.1
        return state

    class Last:
        def decide(self, seen):
            return None if seen.time_s < 1 else 0.0

    monkeypatch.setattr(type(engine), "step", step)
    timeout = scenario(experiment={"timeout_s": 1.5})
    trace = play(Last(), [], timeout, engine)
    failed = (Ending.ENGINE_FAILED, "SUMO did not keep the speed that was set")
    assert (trace.ending, trace.reason) == failed
    # The plain engine cannot.
    trace = play(SumoDriver(), [], scene())
    assert trace.ending is Ending.ENGINE_FAILED
    assert trace.reason is not None
    assert "needs SUMO" in trace.reason


def test_a_pair_is_the_same_first_last_or_alone_and_on_either_arm(sumo, model) -> None:
    flow = scenario(
        pedestrians={"flow_per_hour": 900.0, "kerb_wait_s": 2.0},
        arms={"av": "sumo_driver", "human": "sumo_driver"},
        experiment={"timeout_s": 60.0},
    )

    def run(pairs: list[int]) -> dict[tuple[int, str], bytes]:
        outcomes = PairRunner(flow, model, lambda: sumo(flow)).run(pairs)
        return {(o.pair, o.arm.value): o.trace.speed_mps.tobytes() for o in outcomes}

    together = run(list(range(12)))
    assert run([11, 3, 7]) == {key: together[key] for key in together if key[0] in (3, 7, 11)}
    for pair in range(12):
        assert together[pair, Arm.AV.value] == together[pair, Arm.HUMAN.value]
    assert len(set(together.values())) > 3


def test_both_networks_have_the_right_of_way_they_should() -> None:
    with_priority, without = (network_of(scene(priority)).read_text() for priority in (True, False))
    # netconvert: m, the connection yields; M, it has right of way.
    ends = 'from="approach" to="exit" fromLane="0" toLane="0" via=":crosswalk_0_0"'
    assert f'{ends} dir="s" state="m"' in with_priority
    assert 'via=":crosswalk_0_0" dir="s" state="M"' in without
    cctc = scenario(crossing={"latitude_deg": 42.278415, "longitude_deg": -83.735580})
    assert network_of(cctc).name == "cctc.net.xml"
