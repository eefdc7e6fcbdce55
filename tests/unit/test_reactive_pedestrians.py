"""Pedestrians who look again every second: when they look, what they do, what is kept of it."""

from dataclasses import replace

import pytest

from harness.core.vocabulary import Arrival, Ending, Side, Walk
from harness.encounter.cell_constants import constants_of
from harness.encounter.crowd import Crowd
from harness.encounter.deciding import KerbLane
from harness.measures import measure
from harness.results.rows import pedestrian_rows, trace_rows
from harness.scenario import Scenario, validate
from tests.scenes import Recorder, episode, outcome_of


def scene(**sections: dict[str, object]) -> Scenario:
    pedestrians = {"behaviour": "reactive", "kerb_wait_s": 0.0, **sections.pop("pedestrians", {})}
    return validate({"pedestrians": pedestrians, **sections}, "test")


class Speeds:
    """Gives one speed after the other, and keeps what was asked."""

    def __init__(self, *speeds: float) -> None:
        self._speeds = list(speeds)
        self.asked: list[tuple[float, ...]] = []

    def __call__(self, _who, range_m, speed_mps) -> float:
        self.asked.append((range_m, speed_mps))
        return self._speeds[min(len(self.asked), len(self._speeds)) - 1]


def play(speeds: Speeds, driver: Recorder, arrival_s: float = 0.0, side=Side.NEAR, **sections):
    trace = episode(scene(**sections), driver, [Arrival(0, arrival_s, side, 0.5)], speeds)
    return trace, trace.walks[0]


FAR_AWAY = {"ego": {"trigger_range_m": 300.0, "initial_speed_mps": 20.0}}
"""An ego that needs 15 s to the crosswalk: whoever walks has crossed before it."""


def test_looks_every_second_from_the_moment_they_stepped_off() -> None:
    speeds = Speeds(1.0, 2.0, 0.5, 1.5)
    trace, walk = play(speeds, Recorder(lambda _: -0.6), arrival_s=0.234, **FAR_AWAY)
    # Steps off at 0.234 s and looks 1, 2, 3 … s later, at the ego as it is at that very moment.
    # 1 m, 2 m, 0.5 m, then 1.5 m/s: 8 of 9 m at 6.234 s, the last look before 6.9 s.
    for number, (range_m, speed_mps) in enumerate(speeds.asked):
        at = 0.234 + number
        assert range_m == pytest.approx(300 - 20 * at + 0.3 * at**2, abs=1e-9)
        assert speed_mps == pytest.approx(20 - 0.6 * at, abs=1e-9)
    assert len(speeds.asked) == 7
    assert walk.legs is not None
    assert [leg.time_s for leg in walk.legs] == pytest.approx([0.234, 1.234, 2.234, 3.234])
    assert [leg.y_m for leg in walk.legs] == pytest.approx([0.0, 1.0, 3.0, 3.5])
    assert [leg.y_mps for leg in walk.legs] == [1.0, 2.0, 0.5, 1.5]
    assert (walk.speed_mps, walk.start_s) == (1.0, 0.234)
    rows = pedestrian_rows(0, [outcome_of(trace)]).to_pydict()
    assert rows["cleared_s"] == [pytest.approx(3.234 + 5.5 / 1.5)]


def test_seen_and_kept_at_their_present_speed() -> None:
    driver = Recorder()
    trace, _ = play(Speeds(1.0, 2.0, 1.5), driver, arrival_s=0.55, side=Side.FAR, **FAR_AWAY)
    by_time = {round(o.time_s, 1): o.pedestrians[0] for o in driver.seen if o.pedestrians}
    # 1 m until 1.55 s, 2 m until 2.55 s, then at 1.5 m/s.
    for time_s, walked, speed in ((1.5, 0.95, 1.0), (1.6, 1.1, 2.0), (2.6, 3.075, 1.5)):
        view = by_time[time_s]
        assert view.remaining_m == pytest.approx(9 - walked)
        assert view.lateral_m == pytest.approx(6.75 - walked)
        assert (view.speed_mps, view.on_crossing) == (speed, True)
    rows = trace_rows(0, [outcome_of(trace)]).to_pydict()
    places = {
        round(time, 1): y
        for name, time, y in zip(rows["object"], rows["time_s"], rows["y_m"], strict=True)
        if name == "pedestrian-0"
    }
    assert places[1.5] == pytest.approx(9 - 0.95)
    assert places[1.6] == pytest.approx(9 - 1.1)
    # 9 m: 6 m at 1.5 m/s from 2.55 s on.
    assert max(places) == pytest.approx(6.5)


def test_stops_before_the_cars_way_if_it_would_hit_them() -> None:
    # Far side at 1.5 m/s from 0.5 s on.  At 2.5 s (third look) y = 6 m, bumper 17.5 m away: their
    # disc is in the way (y = 3.4 to 1.1 m) from 1.73 to 3.27 s later, the car over the line from
    # 3.45 to 4.55 s later: no contact ahead.  They slow to 1 m/s: in the way from 2.6 to 4.9 s
    # later: they stop.  So they would be at 3.5 s (car 2.45 to 3.55 s later); at 4.5 s it is over
    # the line 1.45 to 2.55 s later, before them: they walk on.
    driver = Recorder()
    trace, walk = play(Speeds(1.5, 1.5, 1.0), driver, arrival_s=0.5, side=Side.FAR)
    assert [leg.time_s for leg in walk.legs] == pytest.approx([0.5, 2.5, 4.5])
    assert walk.legs[1] == pytest.approx((2.5, 0.0, 6.0, 0.0, 0.0, 0.0))
    assert walk.legs[2] == pytest.approx((4.5, 0.0, 6.0, 0.0, -1.0, 0.0))
    (record,) = measure([trace])
    standing = [o.pedestrians[0] for o in driver.seen if 2.55 < o.time_s < 4.45]
    assert {(view.speed_mps, view.on_crossing) for view in standing} == {(0.0, True)}
    # The car's rear is 0.25 m past the line at 7.05 s, they enter its way at 7.1 s.
    assert (record.ending, record.pet_s) == (Ending.CROSSED, pytest.approx(0.05, abs=1e-9))
    assert pedestrian_rows(0, [outcome_of(trace)]).to_pydict()["cleared_s"] == [None]
    # As above, but they never walk on.
    _, walk = play(Speeds(1.5, 1.5, 1.0), Recorder(), arrival_s=0.5, side=Side.FAR)
    stands = Walk(walk.arrival, walk.start_s, 1.5, 30.0, 5.0, walk.legs[:2])
    trace, _ = play(Speeds(1.0), Recorder(), arrival_s=0.5)
    (record,) = measure([replace(trace, walks=(stands,))])
    # At y = 6 m: never in the way, so no PET; 2.85 m beside the car, less their radius.
    assert (record.ending, record.pet_s) == (Ending.CROSSED, None)
    assert record.min_gap_m == pytest.approx(6.0 - (2.25 + 0.9) - 0.25)


def test_who_sees_no_vehicle_walks_on() -> None:
    gone: list[int] = []
    people = [Arrival(0, 0.0, Side.NEAR, 0.5)]
    crowd = Crowd(
        people, [KerbLane(2.25, 3.5, 9.0)], lambda *_: 1.2, constants_of(scene()), gone.append
    )
    for step in range(100):
        crowd.begin_step(step / 10)
        crowd.advance(step / 10, (step + 1) / 10)
    assert gone == [0]
    assert [leg.y_mps for leg in crowd.came[0].walk.legs or ()] == [1.2]
