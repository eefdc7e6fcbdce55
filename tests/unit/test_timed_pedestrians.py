"""Pedestrians whom a car that never brakes would hit at a given share of its width."""

import pytest

from harness.core.vocabulary import Contact, Ending, Side, Trace
from harness.encounter.arrivals import planned_arrivals
from harness.measures import measure
from harness.scenario import Scenario, read_scenario_file, study_of, validate
from tests.scenes import Recorder, episode

WIDTH, RADIUS = 1.8, 0.25

CASES = {
    # Euro NCAP: side, from where (m), acceleration distance (m), speed (km/h), share.
    "CPNA-25": ("near", 4.0, 1.0, 5.0, 0.25),
    "CPNA-75": ("near", 4.0, 1.0, 5.0, 0.75),
    "CPFA-50": ("far", 6.0, 1.5, 8.0, 0.50),
    "CPNCO-50": ("near", 4.0, 1.0, 5.0, 0.50),
    # FMVSS No. 127, table 2 to S8.1.1, S8.3.1 to S8.3.4.
    "right-25": ("near", 4.0, 1.5, 5.0, 0.25),
    "right-50": ("near", 4.0, 1.5, 5.0, 0.50),
    "left-50": ("far", 6.0, 1.5, 8.0, 0.50),
    "obstructed-50": ("near", 4.0, 1.5, 5.0, 0.50),
}


def timed(case: str, **changes: object) -> dict[str, object]:
    side, start, accelerating, kmh, share = CASES[case]
    table = {"name": case, "side": side, "start_lateral_m": start, "impact_share": share}
    distance = {"acceleration_distance_m": accelerating, "speed_mps": kmh / 3.6}
    return {**table, **distance, **changes}


def scene(*walkers: dict[str, object], ego: dict[str, float] | None = None, **more) -> Scenario:
    tree = {
        "ego": {"initial_speed_mps": 10.0, "trigger_range_m": 70.0, **(ego or {})},
        "pedestrians": {"flow_per_hour": 0.0, "timed": list(walkers), **more},
    }
    return validate(tree, "my.toml")


def play(scenario: Scenario, strategy=None) -> Trace:
    return episode(scenario, strategy or Recorder(), planned_arrivals(scenario, 0))


def test_start_and_acceleration_worked_out_by_hand() -> None:
    # CPNA-25 at 36 km/h from 70 m: contact at 69.75/10 = 6.975 s.  They walk 4 − (0.9 − 0.45) =
    # 3.55 m at 25/18 m/s: 1 m evenly from rest in 2 · 1/(25/18) = 1.44 s, 2.55 m in 1.836 s.
    trace = play(scene(timed("CPNA-25")))
    (walk,) = trace.walks
    assert walk.start_s == pytest.approx(6.975 - 1.44 - 1.836, abs=1e-12)
    assert walk.speed_mps == pytest.approx(25 / 18)
    # They see the ego at 10 m/s, 70 − 10 · 3.699 m away.
    assert (walk.range_m, walk.vehicle_speed_mps) == pytest.approx((33.01, 10.0))
    first, second = walk.legs
    # From 4 m right of the lane's centre (y = −1.75), a = v²/2d = (25/18)²/2.
    assert first == pytest.approx((3.699, 0.0, -1.75, 0.0, 0.0, (25 / 18) ** 2 / 2))
    assert second == pytest.approx((5.139, 0.0, -0.75, 0.0, 25 / 18, 0.0))
    # CPFA-50: 6 m at 20/9 m/s: 1.5 m in 1.35 s, 4.5 m in 2.025 s, from y = 8.25 downwards.
    (walk,) = play(scene(timed("CPFA-50"))).walks
    assert walk.legs[0] == pytest.approx((3.6, 0.0, 8.25, 0.0, 0.0, -((20 / 9) ** 2) / 3))
    assert walk.legs[1] == pytest.approx((4.95, 0.0, 6.75, 0.0, -20 / 9, 0.0))


def test_what_is_seen_of_them() -> None:
    driver = Recorder()
    play(scene(timed("CPNA-25")), driver)
    by_time = {round(o.time_s, 1): o.pedestrians[0] for o in driver.seen if o.pedestrians}
    # They stand 4 m from the centre line from the trigger on.
    assert by_time[0.0] == (0, Side.NEAR, 4.0, 10.75, 0.0, False)
    assert by_time[3.6] == by_time[0.0]
    # Half a second after 3.699 s: a = 0.96451, 0.12056 m on, 0.48225 m/s.
    seen = by_time[4.2]
    assert seen.lateral_m == pytest.approx(4 - 0.964506 * 0.501**2 / 2, abs=1e-6)
    assert seen.speed_mps == pytest.approx(0.964506 * 0.501, abs=1e-6)
    assert not seen.on_crossing
    # They reach the kerb 0.75 m after the 1 m, 0.54 s after 5.139 s.
    assert not by_time[5.6].on_crossing
    assert by_time[5.7].on_crossing
    assert by_time[5.7].remaining_m == pytest.approx(9 - 25 / 18 * (5.7 - 5.679), abs=1e-9)
    driver = Recorder()
    play(scene(timed("CPFA-50")), driver)
    before = [o.pedestrians[0] for o in driver.seen if o.time_s < 3.6 - 1e-9]
    after = [o.pedestrians[0] for o in driver.seen if o.time_s > 3.6 + 1e-9 and o.pedestrians]
    # 0.75 m from the far kerb they stand on the road, but have not stepped off.
    assert {view[2:] for view in before} == {(6.0, 8.25, 0.0, False)}
    assert all(view.on_crossing for view in after)


def test_they_come_in_every_pair_beside_the_others_whatever_the_kerb_rule() -> None:
    alone = scene(flow_per_hour=900.0)
    both = scene(timed("CPNA-25"), timed("CPFA-50"), flow_per_hour=900.0)
    for pair in range(5):
        others, everyone = planned_arrivals(alone, pair), planned_arrivals(both, pair)
        one, two, *rest = everyone
        assert (one.index, one.arrival_s, one.side, one.quantile) == (0, 0.0, Side.NEAR, None)
        assert (two.index, two.arrival_s, two.side, two.quantile) == (1, 0.0, Side.FAR, None)
        assert [arrival._replace(index=arrival.index - 2) for arrival in rest] == list(others)
        assert len(others) > 3
    # At 2 s the ego is never as near as now: they would wait, were they one of the flow.
    trace = play(scene(timed("CPNA-25", speed_mps=5.0), kerb_wait_s=100.0))
    assert trace.walks[0].start_s is not None


@pytest.mark.parametrize("name", ["euro_ncap_vru", "fmvss_127"])
def test_the_shipped_study_hits_where_it_says(name: str) -> None:
    study = study_of(read_scenario_file(name), [])
    assert len(study.cells) == 44
    speeds = sorted({cell.scenario.ego.initial_speed_mps for cell in study.cells})
    assert [speed * 3.6 for speed in speeds] == pytest.approx(range(10, 61, 5), abs=2e-4)
    for cell in study.cells:
        case = cell.scenario.pedestrians.timed_case
        assert case is not None
        side, start, accelerating, kmh, share = CASES[case]
        driver = Recorder()
        trace = play(cell.scenario, driver)
        (record,) = measure([trace])
        assert (record.ending, record.contact) == (Ending.CRASHED, Contact.FRONT)
        contact_s = record.contact_time_s
        # The front meets the disc's edge when the bumper is a radius before the centre line.
        ego = cell.scenario.ego
        reached_s = (ego.trigger_range_m - RADIUS) / ego.initial_speed_mps
        assert contact_s == pytest.approx(reached_s, abs=1e-9)
        (view,) = [o for o in driver.seen if o.time_s <= contact_s][-1].pedestrians
        assert (view.side, view.speed_mps * 3.6) == (side, pytest.approx(kmh, abs=1e-3))
        assert driver.seen[0].pedestrians[0].lateral_m == start
        left = view.lateral_m - view.speed_mps * (contact_s % 0.1)
        assert left == pytest.approx(WIDTH * (0.5 - share), abs=1e-9)
        # Test start: 4 s before the contact at least; they need 2 d_a/v_p + (d − d_a)/v_p.
        assert contact_s > 4.0
        distance = start - WIDTH * (0.5 - share)
        walking_s = (distance + accelerating) / (kmh / 3.6)
        assert trace.walks[0].start_s == pytest.approx(contact_s - walking_s, abs=2e-4)
        # From then on braking at 9 m/s² stops within v²/18, well before they are reached.
        assert ego.initial_speed_mps / 18 < walking_s
        assert record.avoidable is True
