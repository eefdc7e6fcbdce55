"""Delays and waits of those whom the end of a simulation finds at a crosswalk."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from harness.core.encounter import Crossing
from harness.encounter.simulation.arm import SimulationArm
from harness.encounter.simulation.log import SimulationLog
from harness.encounter.simulation.passages import PersonTrack
from harness.encounter.simulation.people import waited_s
from harness.encounter.simulation.standing import Standing
from harness.old.store.simulations.simulation_tables import least_delay_s
from harness.site import RoadFrame

WAY: Any = SimpleNamespace(
    frame=RoadFrame(0.0, 0.0, 1.0, 0.0, 0.0, 1.0), crossing=Crossing(9.0, 4.0, 2.25, 4.5)
)


def test_a_passage_that_did_not_end_has_the_delay_until_then() -> None:
    """10 m in 10 s, where 5 m/s takes 2 s."""
    log: Any = SimpleNamespace(
        time_s=[100.0, 110.0],
        x_m=[-30.0, -20.0],
        vehicle=SimpleNamespace(initial_speed_mps=5.0),
    )
    assert least_delay_s(log) == pytest.approx(8.0)


@pytest.mark.parametrize(("steps_off", "expected_s"), [(True, 2.0), (False, 3.0)])
def test_whoever_never_steps_off_waits_until_the_end(steps_off: bool, expected_s: float) -> None:
    """They walk up to 0.5 m before the kerb within 1 s, and stand there from then on."""
    track = PersonTrack(
        "p",
        np.arange(5.0),
        np.zeros(5),
        np.array([-1.5, -0.5, -0.5, -0.5, 0.5 if steps_off else -0.5]),
        np.array([False] * 4 + [steps_off]),
    )
    assert waited_s(track, 1.0, WAY) == pytest.approx(expected_s)


def test_a_queue_ends_at_the_last_slow_vehicle_on_a_way_straight_on() -> None:
    """A car that stands inside the junction before the crosswalk counts.

    The other cars do not: one has its front beyond the crosswalk, one drives, and one waits for
    right of way in a side street, from where it turns over the crosswalk.  Nor does a bus count
    that is at its stop 70 m before the crosswalk.
    """
    lane = SimpleNamespace
    road = [lane(lane="road", start_m=-100.0), lane(lane=":J_0", start_m=-12.0)]
    side = [lane(lane="side", start_m=-60.0), lane(lane=":J_1", start_m=-9.0)]
    straight, turning = (
        SimpleNamespace(approach=lanes[0].lane, lanes=lanes) for lanes in (road, side)
    )
    crosswalk = SimpleNamespace(id="c", straight_ways=(straight,), ways=(straight, turning))
    # By lane: the cars' positions and speeds.
    cars = {
        "road": {"drives": (70.0, 9.0), "bus": (30.0, 0.0)},
        ":J_0": {"beyond": (13.0, 0.0), "stands": (8.0, 1.0)},
        "side": {"waits": (50.0, 0.0)},
    }
    states = {name: state for there in cars.values() for name, state in there.items()}
    api: Any = SimpleNamespace(
        lane=SimpleNamespace(getLastStepVehicleIDs=lambda name: tuple(cars.get(name, ()))),
        vehicle=SimpleNamespace(
            getLanePosition=lambda name: states[name][0],
            getSpeed=lambda name: states[name][1],
            getLength=lambda _name: 5.0,
            isStopped=lambda name: name == "bus",
        ),
    )
    setting: Any = SimpleNamespace(config=SimpleNamespace(end_s=100.0), crosswalks=(crosswalk,))
    log = SimulationLog()
    Standing(api, setting, log).sample((), {})
    assert log.queues_m == {"c": [4.0 + 5.0]}


def test_a_collision_counts_at_the_chosen_crosswalk_nearest_to_the_front() -> None:
    """The front is 1 m before one crosswalk and 21 m before the next one of the same lane."""

    def crosswalk(name: str, x_m: float) -> Any:
        lanes = [SimpleNamespace(lane="road_1", start_m=-x_m)]
        return SimpleNamespace(id=name, ways=[SimpleNamespace(lanes=lanes, crossing=WAY.crossing)])

    arm: Any = object.__new__(SimulationArm)
    arm.setting = SimpleNamespace(
        crosswalks=[crosswalk("next", 81.0), crosswalk("here", 61.0)], range_m=50.0
    )
    arm.hits, arm.log = set(), SimulationLog()
    ways = [SimpleNamespace(way=SimpleNamespace(crosswalk=name)) for name in ("next", "here")]
    passages = [SimpleNamespace(name="v", driven_way=way, collided=False) for way in ways]
    arm.active = dict(enumerate(passages))
    hit = SimpleNamespace(collider="v", victim="p", type="crossing", lane="road_1", pos=60.0)
    for _ in range(2):  # SUMO reports it at several steps.
        arm._note_collision(hit)
    assert arm.log.person_collisions == {"here": 1}
    assert [passage.collided for passage in passages] == [False, True]
