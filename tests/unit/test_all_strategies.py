"""What several strategies share: whom they do not stop for, which values they refuse."""

import numpy as np
import pytest

from harness.core.encounter import Side, Strategy
from harness.encounter.arms import check_arms
from harness.strategies.constant_speed import ConstantSpeed
from harness.strategies.emergency_brake import EmergencyBrake
from harness.strategies.gap_yield import GapYield
from harness.strategies.hard_yield import HardYield
from tests.scenes import play, refuses, scenario, shown


@pytest.mark.parametrize("strategy", [HardYield, EmergencyBrake, GapYield])
def test_they_do_not_stop_for_people_who_wait(strategy: type[Strategy]) -> None:
    # At the kerb, held back by the 2 s rule: nobody is on the crossing.
    scene = scenario(pedestrians={"kerb_wait_s": 2.0})
    trace = play(strategy(), [(4.5, Side.NEAR, 1.0)], scene)
    assert trace.walks[0].start_s is None
    np.testing.assert_array_equal(trace.speed_mps, play(strategy(), []).speed_mps)


@pytest.mark.parametrize("strategy", [HardYield, EmergencyBrake])
def test_before_an_empty_crosswalk_these_keep_their_speed(strategy: type[Strategy]) -> None:
    np.testing.assert_array_equal(play(strategy(), []).speed_mps, 5.0)


@pytest.mark.parametrize("speed_mps", [0.0, 2.0, 4.0])
def test_constant_speed_drives_off_where_the_vehicle_before_has_slowed_it(speed_mps: float) -> None:
    scene = scenario(ego={"initial_speed_mps": 4.0})
    wanted = 0.0 if speed_mps == 4.0 else scene.vehicle().resume_acceleration_mps2
    assert ConstantSpeed().decide(shown(scene, 10.0, speed_mps)) == wanted


@pytest.mark.parametrize(
    ("name", "key", "value", "allowed"),
    [
        ("human_yield", "yield_rate", -0.1, "greater than or equal to 0"),
        ("human_yield", "yield_rate", 1.1, "less than or equal to 1"),
        ("human_yield", "comfortable_deceleration_mps2", 0.0, "greater than 0"),
        ("emergency_brake", "ttc_threshold_s", 0.0, "greater than 0"),
        ("emergency_brake", "ttc_threshold_s", -1.0, "greater than 0"),
        *(("human_gmm", "decision_interval_s", value, "whole steps")
          for value in (0.0, -1.0, 0.01, 0.25)),
    ],
)  # fmt: skip
def test_values_outside_their_range_are_refused(name, key, value, allowed, model) -> None:
    scene = scenario(arms={"human": name}, strategies={name: {key: value}})
    refuses(rf"^strategies\.{name}\.{key}: .*{allowed}", lambda: check_arms(scene, model))
