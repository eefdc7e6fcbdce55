"""What several strategies share: whom they do not stop for, which values they refuse."""

import numpy as np
import pytest

from harness.core.vocabulary import Side, Strategy
from harness.strategies.constant_speed import ConstantSpeed
from harness.strategies.emergency_brake import EmergencyBrake
from harness.strategies.gap_yield import GapYield
from harness.strategies.hard_yield import HardYield
from tests.scenes import play, scenario, shown


@pytest.mark.parametrize("strategy", [HardYield, EmergencyBrake, GapYield])
def test_they_do_not_stop_for_people_who_wait(strategy: type[Strategy]) -> None:
    # At the kerb, held back by the 2 s rule: nobody is on the crossing.
    scene = scenario(pedestrians={"kerb_wait_s": 2.0})
    trace = play(strategy(), [(4.5, Side.NEAR, 1.0)], scene)
    assert trace.walks[0].start_s is None
    np.testing.assert_array_equal(trace.speed_mps, play(strategy(), []).speed_mps)


@pytest.mark.parametrize("speed_mps", [0.0, 2.0, 4.0])
def test_constant_speed_drives_off_where_the_vehicle_before_has_slowed_it(speed_mps: float) -> None:
    scene = scenario(ego={"initial_speed_mps": 4.0})
    wanted = 0.0 if speed_mps == 4.0 else scene.vehicle().resume_acceleration_mps2
    assert ConstantSpeed().decide(shown(scene, 10.0, speed_mps)) == wanted
