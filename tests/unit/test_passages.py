"""Passages cut out of recorded places, against geometry worked out by hand.

The crosswalk of the CCTC network: x = 300 m along the road from its beginning, 9 m from kerb to
kerb, 4 m wide, the vehicle's lane centre 2.25 m from the near kerb.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from harness.core.encounter import Ending, Side, StepMotion, Trace, Vehicle
from harness.core.resources import shipped_directory
from harness.encounter.simulation.passages import PersonTrack, VehicleTrack, passage
from harness.measures import measure
from harness.site import WayOver, crosswalks_of, read_network

NET = next(shipped_directory("networks").glob("cctc/*.net.xml"))
WAY = crosswalks_of(read_network(NET))[0].ways[0]


def vehicle(speed_mps: float = 10.0) -> Vehicle:
    return Vehicle(speed_mps, 30.0, 30.0, 5.0, 1.8, 2.6, 4.5, 2.6)


def walker(
    start_s: float, speed_mps: float = 1.5, *, step: float = 0.1, side: Side = Side.NEAR
) -> PersonTrack:
    """Someone who waits 0.5 m before their kerb from t = 0 on and then walks over x = 0."""
    time = np.arange(round(40 / step)) * step
    ahead = np.maximum(-0.5, speed_mps * (time - start_s))
    y = ahead if side is Side.NEAR else 9.0 - ahead
    places = np.array([WAY.frame.to_network(0.0, each) for each in y])
    on = (ahead >= 0) & (ahead <= 9)
    return PersonTrack("p", time, places[:, 0], places[:, 1], on)


def steady(speed_mps: float, *, step: float = 0.1, begin_m: float = -50.0) -> VehicleTrack:
    time = np.arange(round(80 / speed_mps / step)) * step
    return VehicleTrack(time, begin_m + speed_mps * time, np.full(len(time), speed_mps))


def cut(track: VehicleTrack, *people: PersonTrack, motion: StepMotion = "ballistic") -> Trace:
    return passage(track, people, WAY, vehicle(), motion=motion)


def test_the_way_lies_on_the_crosswalk() -> None:
    # The road is 300 m long up to the junction, whose crosswalk is in the middle of its 7 m.
    assert (WAY.approach, WAY.to_edge) == ("approach_0", "exit")
    assert WAY.crossing.length_m == pytest.approx(9.0, abs=1e-6)
    assert WAY.crossing.width_m == pytest.approx(4.0)
    assert WAY.crossing.lane_centre_m == pytest.approx(2.25, abs=1e-6)
    assert WAY.place_m("exit", 10.0) == pytest.approx(13.5)
    assert WAY.place_m("approach", 290.0) == pytest.approx(-10.0)
    assert WAY.place_m("elsewhere", 0.0) is None
    assert WAY.is_straight(5.0)
    assert not WAY.signalled


def test_a_way_is_straight_from_10_m_before_until_the_rear_has_left() -> None:
    # The rear of a car of 5 m has left the 4 m of the crosswalk when its front is at 5 + 2 m.
    half_m = WAY.crossing.width_m / 2
    assert half_m == pytest.approx(2.0)
    least = replace(WAY, straight_before_m=10.0, straight_after_m=5.0 + half_m)
    assert least.is_straight(5.0)
    assert not least.is_straight(5.1)
    assert not replace(least, straight_before_m=9.99).is_straight(5.0)
    assert not replace(least, straight_after_m=6.99).is_straight(5.0)


def test_the_trace_begins_within_the_range_and_ends_behind_the_crosswalk() -> None:
    trace = cut(steady(10.0, begin_m=-50.5))
    # −30.5 m is beyond the range of 30 m, −29.5 m within it.
    assert trace.x_m[0] == pytest.approx(-29.5)
    assert trace.trace_offset_s == pytest.approx(0.05)
    assert trace.ending is Ending.CROSSED
    assert measure([trace])[0].pass_time_s == pytest.approx(3.7)
    assert measure([trace])[0].delay_s == pytest.approx(0.0, abs=1e-9)


def test_records_that_begin_within_the_range() -> None:
    trace = cut(steady(10.0, begin_m=-12.0))
    assert trace.vehicle.trigger_range_m == pytest.approx(12.0)
    assert measure([trace])[0].delay_s == pytest.approx(0.0, abs=1e-9)


def test_records_that_end_on_the_crosswalk() -> None:
    track = steady(10.0)
    short = VehicleTrack(track.time_s[:52], track.x_m[:52], track.speed_mps[:52])
    assert cut(short).ending is Ending.TIMED_OUT


@pytest.mark.parametrize("step", [0.1, 0.25, 1.0])
@pytest.mark.parametrize("side", list(Side))
def test_pet_does_not_depend_on_the_step_of_straight_walks(step: float, side: Side) -> None:
    # The zone: 2.25 m ± (0.9 + 0.25) m. They leave it at 3.4 m (near) or 9 − 1.1 = 7.9 m (far).
    start, leaves = 0.3, {Side.NEAR: 3.4, Side.FAR: 7.9}[side] / 1.5
    track = steady(5.0, step=step, begin_m=-60.0)
    result = measure([cut(track, walker(start, step=step, side=side))])[0]
    # The bumper is 0.25 m before x = 0 after 59.75/5 s.
    assert result.pet_s == pytest.approx(59.75 / 5 - (start + leaves), abs=1e-9)


def test_a_walk_over_the_crosswalk() -> None:
    (walk,) = cut(steady(10.0), walker(3.0)).walks
    # The trace begins when the bumper is at −30 m, after 2 s.
    assert walk.start_s == pytest.approx(1.0)
    assert walk.arrival.side is Side.NEAR
    assert walk.speed_mps == pytest.approx(1.5)
    assert walk.range_m == pytest.approx(20.0)
    assert walk.vehicle_speed_mps == pytest.approx(10.0)
    assert walk.legs is not None
    assert [leg.y_m for leg in walk.legs] == pytest.approx([0.0, 9.0])
    # They stood since before the trace began: no wait within it is known.
    assert walk.arrival.arrival_s == pytest.approx(-2.0)


def test_who_steps_off_in_the_last_step_of_a_passage_sees_the_vehicle() -> None:
    # The trace has records from 2.1 s, at −29.5 m, to 5.8 s, where the rear is past 2 m.
    (walk,) = cut(steady(10.0, begin_m=-50.5), walker(5.75)).walks
    assert walk.start_s == pytest.approx(3.65)
    assert walk.range_m == pytest.approx(-7.0)
    assert walk.vehicle_speed_mps == pytest.approx(10.0)


def test_the_contact_of_a_person_and_a_vehicle() -> None:
    # At 10 m/s the bumper reaches 0.25 m before x = 0 at 4.975 s; they are at y = 2.25 m then.
    result = measure([cut(steady(10.0), walker(4.975 - 1.5))])[0]
    assert result.ending is Ending.CRASHED
    assert result.contact == "front"
    assert result.contact_time_s == pytest.approx(2.975)
    assert result.contact_speed_mps == pytest.approx(10.0)


def braking(motion: StepMotion, step: float = 1.0) -> VehicleTrack:
    """10 m/s, braking at 2 m/s² from t = 1 s on, moved as SUMO moves it."""
    times = np.arange(6) * step
    speeds = 10.0 - 2.0 * np.maximum(times - 1.0, 0.0)
    driven = speeds[1:] if motion == "euler" else (speeds[1:] + speeds[:-1]) / 2
    return VehicleTrack(times, -31.0 + np.concatenate(([0.0], np.cumsum(driven * step))), speeds)


@pytest.mark.parametrize(
    ("motion", "place", "edge_s"),
    [
        # −31, −21, −13, −7, −3, −1; the near edge, −2 m, half way through the last step.
        ("euler", -1.0, 3.5),
        # −31, −21, −12, −5, 0, 3: −2 m after 3 m of 6 t − t² in the fourth step.
        ("ballistic", 3.0, 2.0 + (3.0 - math.sqrt(6.0))),
    ],
)
def test_between_states_a_vehicle_moves_as_sumo_moved_it(
    motion: StepMotion, place: float, edge_s: float
) -> None:
    from harness.measures import crossing_time

    trace = cut(braking(motion), motion=motion)
    assert trace.x_m[-1] == pytest.approx(place)
    assert trace.x_m[0] == pytest.approx(-21.0)
    assert trace.trace_offset_s == pytest.approx(0.9)
    assert crossing_time(trace, -2.0) == pytest.approx(edge_s)


@pytest.mark.parametrize("motion", ["euler", "ballistic"])
def test_a_contact_within_a_step_is_at_the_speed_driven(motion: StepMotion) -> None:
    track = braking(motion)
    # Someone who stands in the lane at the place that is reached within the last step.
    x_net = np.array([WAY.frame.to_network(-1.25 if motion == "euler" else 0.0, 2.25)] * 8)
    time = np.arange(8.0)
    person = PersonTrack("p", time, x_net[:, 0], x_net[:, 1], np.ones(8, dtype=bool))
    trace = cut(track, person, motion=motion)
    result = measure([trace])[0]
    if motion == "euler":
        assert result.contact_speed_mps == pytest.approx(2.0)
        # −3 m at 3 s; the disc at −1.5 m: 0.75 s at 2 m/s.
        assert result.contact_time_s == pytest.approx(3.75)
    else:
        # −5 m at 2 s with 6 m/s; the disc at −0.25 m: 6 t − t² = 4.75.
        within = 3.0 - math.sqrt(9.0 - 4.75)
        assert result.contact_time_s == pytest.approx(2.0 + within)
        assert result.contact_speed_mps == pytest.approx(6.0 - 2.0 * within)


def test_the_wait_at_the_kerb() -> None:
    person = walker(4.0)
    late = PersonTrack(
        "p", *(each[24:] for each in (person.time_s, person.x_m, person.y_m, person.on_crossing))
    )
    (walk,) = cut(steady(10.0), late).walks
    # On record from 2.4 s on, standing within 1 m of the kerb; 0.5 m later they step off.
    assert walk.arrival.arrival_s == pytest.approx(0.4)
    assert walk.start_s == pytest.approx(2.0)
    assert measure([cut(steady(10.0), late)])[0].pedestrian_delay_s == pytest.approx(1.6)


def test_a_walk_between_two_records_of_a_long_step() -> None:
    """Records every 5 s at 2.16 m/s: at the kerb, and 10.8 m before and after it."""
    time, ahead = np.array([-2.5, 2.5, 7.5]), np.array([-10.8, 0.0, 10.8])
    places = np.array([WAY.frame.to_network(0.0, each) for each in ahead])
    on = np.array([False, True, False])
    (walk,) = cut(steady(10.0), PersonTrack("p", time, places[:, 0], places[:, 1], on)).walks
    # They are at the kerb at 2.5 s; the trace begins when the bumper is at −30 m, after 2 s.
    assert walk.start_s == pytest.approx(0.5)
    assert walk.speed_mps == pytest.approx(2.16)


def test_records_within_rounding_of_a_straight_walk_make_one_leg() -> None:
    exact = walker(3.0)
    rounded = PersonTrack(
        "p", exact.time_s, exact.x_m.round(2), exact.y_m.round(2), exact.on_crossing
    )
    trace = passage(steady(10.0), [rounded], WAY, vehicle(), motion="ballistic", rounding_m=0.0075)
    (walk,) = trace.walks
    assert walk.legs is not None
    assert len(walk.legs) == 2
    assert walk.legs[0].y_mps == pytest.approx(1.5, abs=0.005)


def test_when_a_passage_is_recorded_does_not_change_what_is_measured() -> None:
    # They walk at 1 and 2 m/s in turn, so the time to collision depends on the step that counts.
    steps = np.arange(400)
    ahead = np.concatenate(([-0.5] * 40, -0.45 + 0.05 * np.cumsum(np.resize([2, 4], 360))))
    places = np.array([WAY.frame.to_network(0.0, each) for each in ahead])
    on = (ahead >= 0) & (ahead <= 9)
    found = set()
    for later in range(0, 3000, 37):
        time = (steps + later) * 0.1
        driven = VehicleTrack(time, -60.0 + 8.0 * 0.1 * steps, np.full(400, 8.0))
        ttc = measure([cut(driven, PersonTrack("p", time, places[:, 0], places[:, 1], on))])
        assert ttc[0].min_ttc_s is not None
        found.add(round(ttc[0].min_ttc_s, 6))
    assert len(found) == 1


def test_someone_whose_records_end_in_the_road_is_gone_then() -> None:
    person = walker(1.0)
    gone = PersonTrack(
        "p", *(each[:25] for each in (person.time_s, person.x_m, person.y_m, person.on_crossing))
    )
    # They vanish at 2.4 s, 2.1 m from the kerb, right in the lane; the car comes at 5 s.
    assert measure([cut(steady(10.0), gone)])[0].ending is Ending.CROSSED


def test_the_frame_of_the_oncoming_way_is_its_own() -> None:
    way: WayOver = crosswalks_of(read_network(NET))[0].ways[1]
    assert way.crossing.lane_centre_m == pytest.approx(2.25, abs=1e-6)
    trace = passage(steady(10.0), [walker(3.0)], way, vehicle(), motion="ballistic")
    assert trace.walks[0].arrival.side is Side.FAR
