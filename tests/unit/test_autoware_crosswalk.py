"""Autoware's crosswalk rule against its documentation, by hand."""

import pytest

from harness.core.vocabulary import PedestrianView, Side
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


NO, YES = False, True


@pytest.mark.parametrize(
    ("ttc_s", "ttv_s", "yields"),
    # It passes first from TTC + 4 s < TTV on, and who is 13 s ahead is gone; ± 0.5 s once decided.
    [(10.0, (13.9, 14.4, 14.6), [YES, YES, NO]), (10.0, (14.1, 13.6, 13.4), [NO, NO, YES]),
     (20.0, (7.1, 6.6, 6.4), [YES, YES, NO]), (20.0, (6.9, 7.4, 7.6), [NO, NO, YES])],
)  # fmt: skip
@pytest.mark.parametrize(("drives", "walks"), [((4, 4), (2, 2)), ((1, 2), (1, 5 / 3.6))])
def test_who_goes_first(ttc_s: float, ttv_s, yields, drives, walks) -> None:
    """At a speed and the one of which its time is computed: at least 2 m/s, and 5 km/h."""
    rule, found = AutowareCrosswalk(), []
    for each_s in ttv_s:
        person = PedestrianView(0, Side.FAR, each_s * walks[1], 30.0, walks[0], on_crossing=True)
        seen = shown(scenario(), ttc_s * drives[1], drives[0], person)
        # It slows down already, so that a stop goes on, however far away the crosswalk is.
        slowing = seen._replace(ego=seen.ego._replace(acceleration_mps2=-0.1))
        found.append(rule.decide(slowing) < 0)
    assert found == yields


@pytest.mark.parametrize(
    ("speed_mps", "from_kerb_m", "stands"),
    [(0.24, 0.9, [YES, YES, NO]), (0.26, 0.9, [YES] * 3), (0.24, 1.1, [NO] * 3)],
)
def test_it_goes_on_after_a_second_before_who_stands(speed_mps, from_kerb_m, stands) -> None:
    rule, found = AutowareCrosswalk(), []
    for time_s in (0.0, 0.9, 1.0):
        at = 2.25 + from_kerb_m, 9.0 + from_kerb_m, speed_mps
        person = PedestrianView(0, Side.NEAR, *at, on_crossing=False)
        found.append(rule.decide(shown(scenario(), 5.5, 0.0, person, time_s=time_s)) == 0.0)
    assert found == stands


def test_it_stops_gently_before_the_line_and_the_brake_is_behind_it() -> None:
    trace = play(AutowareCrosswalk(), [(0.0, Side.FAR, 0.5)])
    standing_m = -trace.x_m[trace.speed_mps < 1e-9]
    assert standing_m[0] == pytest.approx(2.0 + 3.5, abs=0.05)
    assert min(trace.speed_mps[1:] - trace.speed_mps[:-1]) > -1.1 * trace.step_s
    late = [(4.8, Side.NEAR, 1.4)]  # at R = 6 m, too near for a stop of the rule
    assert play(AutowareCrosswalk(), late).speed_mps.min() == 5.0
    assert play(AutowareCrosswalk(emergency_brake=True), late).speed_mps.min() < 1.0
