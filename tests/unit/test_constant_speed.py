"""The control case drives at v0, whoever slowed it."""

import pytest

from harness.encounter import EgoView, Observation
from harness.strategies.constant_speed import ConstantSpeed
from tests.scenes import scenario


@pytest.mark.parametrize("speed_mps", [0.0, 2.0, 4.0])
def test_it_drives_off_where_the_vehicle_before_has_slowed_it(speed_mps: float) -> None:
    scene = scenario(ego={"initial_speed_mps": 4.0})
    ego = EgoView(10.0, speed_mps, 0.0)
    seen = Observation(0.0, 0.1, ego, scene.vehicle(), scene.crosswalk(), ())
    a0 = scene.vehicle().resume_acceleration_mps2
    assert ConstantSpeed().decide(seen) == (0.0 if speed_mps == 4.0 else a0)
