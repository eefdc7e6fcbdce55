"""Autoware's crosswalk rule against its documentation, by hand."""

import pytest

from harness.core.encounter import PedestrianView, Side
from harness.strategies.autoware_crosswalk import AutowareCrosswalk
from tests.scenes import play, scenario, shown


@pytest.mark.parametrize("speed", [5.0, 8.0, 50 / 3.6])
def test_a_stop_that_needs_too_much_is_cancelled(speed: float) -> None:
    """1.5 m/s² are reached after 1 s, at v − 0.75 and v − 0.25 m on; 3 m are left to the edge."""
    scene = scenario(ego={"initial_speed_mps": speed, "trigger_range_m": 100.0})
    walker = PedestrianView(0, Side.NEAR, 2.0, 8.75, 1.4, on_crossing=True)
    nearest_m = 2.0 + 3.0 + speed - 0.25 + (speed - 0.75) ** 2 / 3.0
    for range_m, stops in ((nearest_m - 0.01, False), (nearest_m + 0.01, True)):
        wanted = AutowareCrosswalk().decide(shown(scene, range_m, speed, walker))
        assert (wanted < 0) is stops


def test_it_stops_gently_before_the_line_and_the_brake_is_behind_it() -> None:
    trace = play(AutowareCrosswalk(), [(0.0, Side.FAR, 0.5)])
    standing_m = -trace.x_m[trace.speed_mps < 1e-9]
    assert standing_m[0] == pytest.approx(2.0 + 3.5, abs=0.05)
    assert min(trace.speed_mps[1:] - trace.speed_mps[:-1]) > -1.1 * trace.step_s
    late = [(4.8, Side.NEAR, 1.4)]  # at R = 6 m, too near for a stop of the rule
    assert play(AutowareCrosswalk(), late).speed_mps.min() == 5.0
    assert play(AutowareCrosswalk(emergency_brake=True), late).speed_mps.min() < 1.0
