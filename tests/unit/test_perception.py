"""What a driver is shown: late, in part, with errors, and not through walls; by hand."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from harness.core.vocabulary import Arm, Arrival, Observation, PedestrianView, Side, Trace
from harness.encounter.arrivals import planned_arrivals
from harness.encounter.loop import drive
from harness.measures import measure
from harness.measures.record import Outcome
from harness.model.interaction import load_model
from harness.results.rows import trace_rows
from harness.scenario import Scenario, load_scenario
from harness.scenario.file import Setting
from harness.strategies.perception.encounter_view import Perception
from harness.strategies.perception.occlusion import Rectangle, is_hidden
from harness.strategies.perception.sensor import Sensor, sensor_of
from harness.strategies.perception.track_errors import (
    ERRORS,
    Detection,
    Noise,
    SensorTrack,
    updates_until_found,
)
from harness.strategies.perception.updates import Updates
from tests.scenes import Recorder, episode, on_plain, outcome_of, scenario

FAR_AWAY = {"x_m": -900.0, "y_m": -50.0, "length_m": 1.0, "width_m": 1.0}
"""An obstacle that hides nobody, but lets everything go through the sensor."""


def watched(
    scene: Scenario, arrivals: Sequence[Arrival], choose_speed, sensor: Sensor | None
) -> tuple[list[Observation], Trace]:
    driver = Recorder()
    eyes = None if sensor is None else Perception(sensor, arrivals, 0, {})
    return driver.seen, episode(scene, driver, arrivals, choose_speed, eyes)


def play(
    scene: Scenario, walkers: Sequence[tuple[float, Side, float]]
) -> tuple[list[Observation], Trace]:
    """One episode of an ego that never brakes; walkers: when, from where, how fast."""
    arrivals = [Arrival(i, at, side, 0.5) for i, (at, side, _) in enumerate(walkers)]
    eyes = sensor_of(scene, Arm.AV)
    return watched(scene, arrivals, lambda who, *_: walkers[who.index][2], eyes)


@pytest.mark.parametrize(("every", "late"), [(1, 1), (1, 3), (1, 10), (4, 2)])
def test_what_is_shown_is_exactly_that_old(every: int, late: int) -> None:
    walkers = [(0.33, Side.NEAR, 1.3), (1.0, Side.FAR, 2.0)]
    now, _ = play(scenario(), walkers)
    keys = {"latency_s": late / 10, "update_s": every / 10}
    then, trace = play(scenario(perception=keys), walkers)
    # Looks at 0, 0.4, 0.8 …, told 0.2 s later: at step n the look at 4 ⌊(n − 2)/4⌋.
    looked = [every * ((step - late) // every) for step in range(len(now))]
    expected = [now[step].pedestrians if step >= 0 else () for step in looked]
    assert [o.pedestrians for o in then] == expected
    # The ego's own state is current.
    assert [o.ego for o in then] == [o.ego for o in now]
    assert trace.shown == tuple(o.pedestrians for o in then)


def test_the_human_sees_as_the_av_only_where_asked_for() -> None:
    poor = {"latency_s": 0.3, "detection_probability": 0.5}
    scene = scenario(perception=poor)
    assert sensor_of(scene, Arm.AV) is not None
    assert sensor_of(scene, Arm.HUMAN) is None
    both = scenario(perception={**poor, "human": True})
    assert sensor_of(both, Arm.HUMAN) == sensor_of(both, Arm.AV)
    # Obstacles hide from both, unless the AV's sensor sees through them.
    walled = scenario(crossing={"obstacles": [FAR_AWAY]}, perception={"occlusion": False})
    human = sensor_of(walled, Arm.HUMAN)
    assert sensor_of(walled, Arm.AV) is None
    assert len(human.obstacles) == 1


@pytest.mark.parametrize("probability", [0.9, 0.5, 0.1])
def test_updates_until_found_are_geometric(probability: float) -> None:
    uniforms = np.random.default_rng(4).random(20_000)
    found = [updates_until_found(float(u), probability) for u in uniforms]
    # Classes that expect at least 20 each, the tail in one.
    most = int(stats.geom.ppf(1 - 20 / len(found), probability)) or 1
    counts = [found.count(n) for n in range(1, most + 1)]
    expected = stats.geom.pmf(range(1, most + 1), probability) * len(found)
    rest = len(found) - sum(counts)
    p = stats.chisquare([*counts, rest], [*expected, len(found) - expected.sum()]).pvalue
    assert p > 1e-3
    assert updates_until_found(0.3, 1.0) == 1
    assert updates_until_found(0.3, 0.0) == math.inf


def sensor_with(**keys: float) -> Sensor:
    sensor = sensor_of(scenario(perception=keys, crossing={"obstacles": [FAR_AWAY]}), Arm.AV)
    assert sensor is not None
    return sensor


def test_the_quantile_decides_the_first_detection_and_what_is_lost_is_looked_for() -> None:
    # u = 0.999, p = 0.5: ⌈ln 0.001 / ln 0.5⌉ = ⌈9.97⌉ = 10 updates; they come at 0.55 s, so the
    # first update is at 0.6 s and the tenth at 1.5 s.
    sensor = sensor_with(detection_probability=0.5)
    arrivals = [Arrival(0, 0.55, Side.NEAR, 0.5, detection_quantile=0.999)]
    seen, _ = watched(scenario(), arrivals, lambda *_: 1.0, sensor)
    shown = [o.time_s for o in seen if o.pedestrians]
    assert shown[0] == pytest.approx(1.5)
    # Then they are tracked, until they have left at 9.55 s or the episode ends.
    assert np.diff(shown) == pytest.approx(0.1)
    track = Detection(SensorTrack(sensor, 0, 0, 0.7))  # ⌈1.737⌉ = 2 looks
    looks = [True, False, False, True, True, False]
    assert [track.found(look) for look in looks] == [False, False, False, True, True, False]


@settings(max_examples=50)
@given(st.integers(0, 12), st.integers(1, 4), st.lists(st.booleans(), min_size=12, max_size=40))
def test_latency_only_shifts_what_is_shown(late: int, every: int, sights: list[bool]) -> None:
    poor = {"update_s": every / 10, "position_sd_m": 0.3, "dropout_probability": 0.2}
    person = PedestrianView(1, Side.NEAR, 2.0, 8.0, 1.2, on_crossing=True)

    def shown(latency_s: float) -> list[object]:
        sensor = sensor_with(latency_s=latency_s, detection_probability=0.6, **poor)
        updates = Updates(sensor, lambda index: SensorTrack(sensor, 0, index, 0.5))
        return [updates.shown(lambda sees=sees: [(person, sees)]) for sees in sights]

    assert shown(late / 10) == [()] * late + shown(0.0)[: len(sights) - late]


def test_share_of_updates_shown_with_dropouts() -> None:
    # Found with p, dropped with q at each update: a Markov chain of two states, in the found one
    # p/(p + q) of the time; a run in it is geometric with mean 1/q.
    p, q = 0.6, 0.2
    sensor = sensor_with(detection_probability=p, dropout_probability=q)
    detection, updates = Detection(SensorTrack(sensor, 0, 0, 0.0)), 40_000
    shown = np.array([detection.found(True) for _ in range(updates)])
    # Its correlation in time, 1 − p − q = 0.2, makes (1 + 0.2)/(1 − 0.2) = 1.5 times the variance.
    mean = p / (p + q)
    error = math.sqrt(1.5 * mean * (1 - mean) / updates)
    assert abs(shown.mean() - mean) < 4 * error
    change = np.diff(shown.astype(int))
    began, ended = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    began = began[: len(ended)] if began[0] < ended[0] else began[: len(ended) - 1]
    lengths = ended[-len(began) :] - began
    assert abs(lengths.mean() - 1 / q) < 4 * math.sqrt((1 - q) / len(lengths)) / q


def test_errors_have_their_variance_and_correlation() -> None:
    # Updates of 0.1 s, correlation time 0.5 s: φ = exp(−0.2), after k updates exp(−0.2 k).
    sensor = sensor_with(position_sd_m=0.3, speed_sd_mps=0.2, correlation_s=0.5)
    noise = Noise(SensorTrack(sensor, 3, 0, None))
    errors = np.array([noise.next_errors() for _ in range(60_000)])
    for column, sd in zip(errors.T, (0.3, 0.2), strict=True):
        # Effective sample size n (1 − φ²)/(1 + φ²) for a variance; 4 standard errors.
        assert column.std() == pytest.approx(sd, rel=4 * math.sqrt(1 / (2 * 60_000 * 0.1974)))
        for lag in (1, 5, 10):
            correlation = np.corrcoef(column[:-lag], column[lag:])[0, 1]
            assert correlation == pytest.approx(math.exp(-0.2 * lag), abs=0.03)
    assert abs(np.corrcoef(errors.T)[0, 1]) < 0.03
    # Stationary from the first update on: over pedestrians too.
    first = [Noise(SensorTrack(sensor, pair, 0, None)).next_errors()[0] for pair in range(2_000)]
    assert np.std(first) == pytest.approx(0.3, rel=4 / math.sqrt(2 * 2_000))


def test_a_new_error_is_one_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    new = ERRORS[0]._replace(begin=lambda _: lambda view, _: (view, False), keys=("update_s",))
    monkeypatch.setattr("harness.strategies.perception.updates.ERRORS", [new])
    person = PedestrianView(1, Side.NEAR, 2.0, 8.0, 1.2, on_crossing=True)
    for keys, told in (({"update_s": 0.2}, ()), ({"speed_sd_mps": 9.0}, (person,))):
        sensor = sensor_with(**keys)
        updates = Updates(sensor, lambda index, of=sensor: SensorTrack(of, 0, index, None))
        assert updates.shown(lambda: [(person, True)]) == told


WALL = Rectangle(4.0, 5.0, -1.0, 1.0)


@pytest.mark.parametrize(
    ("centre", "hidden"),
    [
        ((10.0, 0.0), True),
        # Behind the wall's near corner (4, 1) the shadow's edge is y = x/4: a disc of radius 0.25
        # at x = 10 is hidden whole while its centre is 0.25 · √(1 + 1/16) = 0.2577 below 2.5.
        ((10.0, 2.242), True),
        ((10.0, 2.243), False),
        ((10.0, 4.0), False),
        ((3.5, 0.0), False),  # before the wall
        ((-10.0, 0.0), False),  # behind the eye
        ((0.1, 0.1), False),  # over the eye
    ],
)
def test_a_disc_is_hidden_when_the_whole_of_it_is(centre, hidden) -> None:
    assert is_hidden((0.0, 0.0), centre, [WALL]) is hidden


QUARTERS = st.integers(-40, 40).map(lambda quarters: quarters / 4)


@given(st.tuples(*[QUARTERS] * 4), st.tuples(QUARTERS, QUARTERS), st.integers(1, 8))
def test_what_is_hidden_is_so_in_the_mirror_and_behind_a_larger_obstacle(sides, at, more) -> None:
    x, y = at
    (low, high), (right, left) = sorted(sides[:2]), sorted(sides[2:])
    hidden = is_hidden((0.0, 0.0), at, [Rectangle(low, high, right, left)])
    assert is_hidden((0.0, 0.0), (x, -y), [Rectangle(low, high, -left, -right)]) is hidden
    assert is_hidden((0.0, 0.0), (-y, x), [Rectangle(-left, -right, low, high)]) is hidden
    larger = Rectangle(low - more, high + more, right - more, left + more)
    assert larger.holds((0.0, 0.0)) or is_hidden((0.0, 0.0), at, [larger]) >= hidden


@pytest.mark.parametrize("speed", [2.7778, 10.0, 16.6667])
def test_when_the_child_behind_parked_cars_becomes_visible(speed: float) -> None:
    # Seen from the eye, d before the child's line and at y = 2.25, the smaller car ends at its
    # corner (-1, 0.35).  That line of sight reaches x = 0 at 0.35 + m with the slope
    # m = -1.9/(d - 1); the disc is seen once its centre is above 0.35 + m - 0.25 sqrt(1 + m²).
    changes = {"pedestrians.timed_case": "CPNCO-50", "ego.initial_speed_mps": speed}
    scene = load_scenario("euro_ncap_vru", [Setting(key, value) for key, value in changes.items()])
    sensor = sensor_of(scene, Arm.HUMAN)
    assert sensor is not None
    seen, _ = watched(scene, planned_arrivals(scene, 0), lambda *_: 0.0, sensor)
    # They start 4 m from the lane's centre at a = v²/2 over 1 m and are hit at 69.75 m/v.
    contact_s = 69.75 / speed
    start_s = contact_s - 2 / 1.3889 - 3 / 1.3889
    time_s = 0.1 * np.arange(int(contact_s / 0.1) + 1)
    walked_s = np.maximum(0.0, time_s - start_s)
    fast_s = np.minimum(walked_s, 2 / 1.3889)
    walked_m = 1.3889**2 / 4 * fast_s**2 + 1.3889 * (walked_s - fast_s)
    slope = -1.9 / (70.0 - speed * time_s + 2.4 - 1)
    in_sight = -1.75 + walked_m > 0.35 + slope - 0.25 * np.sqrt(1 + slope**2)
    first = next(o for o in seen if o.pedestrians)
    assert first.time_s == pytest.approx(time_s[in_sight][0])
    # Some 1.5 s before the contact, where an adult without the cars is in sight all the time.
    assert 1.2 < contact_s - first.time_s < 1.9


def outcomes(scene: Scenario, pairs: int = 6) -> list[Outcome]:
    return list(on_plain(scene, load_model(scene.model.name)).run(range(pairs)))


def flow(*settings: tuple[str, object]) -> Scenario:
    base = [("pedestrians.flow_per_hour", 1000.0), ("arms.av", "gap_yield")]
    return load_scenario("cctc_flow", [Setting(key, value) for key, value in (*base, *settings)])


def test_a_sensor_without_faults_changes_no_record() -> None:
    through = outcomes(flow(("crossing.obstacles", [FAR_AWAY])))
    without = outcomes(flow())
    assert [o.record for o in through] == [o.record for o in without]
    assert all(o.trace.shown is not None for o in through)
    assert all(o.trace.shown is None for o in without)


@pytest.mark.parametrize("detection", [0.1, 1.0])
def test_numbers_tell_of_nobody_who_has_not_been_seen(detection: float) -> None:
    poor = [("perception.detection_probability", detection), ("perception.latency_s", 0.3)]
    runner = on_plain(flow(("pedestrians.warm_up_s", 60.0), *poor), load_model("dut"))
    for pair in range(6):
        driver = Recorder()
        trace = drive(runner.begin(pair), driver)
        told = [view.index for seen in driver.seen for view in seen.pedestrians]
        assert [*dict.fromkeys(told)] == [*range(len({*told}))]
        # Everybody keeps their number, of which the trace's index says who they are.
        planned = [view.index for views in trace.shown or () for view in views]
        assert len({*zip(planned, told, strict=True)}) == len({*planned}) == len({*told})


def test_cells_share_their_draws_and_pairs_do_not() -> None:
    poor = [("perception.detection_probability", 0.3), ("perception.position_sd_m", 0.2)]
    one = planned_arrivals(flow(*poor), 0)
    late = planned_arrivals(flow(*poor, ("perception.latency_s", 0.5)), 0)
    assert [a.detection_quantile for a in one] == [a.detection_quantile for a in late]
    assert one[0].detection_quantile != planned_arrivals(flow(*poor), 1)[0].detection_quantile
    # Given uniforms take the place of the first draws, as `harness risk` gives them.
    given = planned_arrivals(flow(*poor), 0, {"detection": (0.25,)})
    assert given[0] == one[0]._replace(detection_quantile=0.25)
    assert given[1:] == one[1:]
    # Old results keep their draws.
    assert [a._replace(detection_quantile=None) for a in one] == list(planned_arrivals(flow(), 0))
    sensor = sensor_of(flow(*poor), Arm.AV)
    assert sensor is not None
    tracks = [SensorTrack(sensor, a, b, 0.5) for a, b in np.ndindex(2, 2)]
    assert len({Noise(track).next_errors() for track in tracks}) == 4


def test_given_uniforms_are_the_first_errors_and_the_wait_after_the_first_loss() -> None:
    errors: dict = {"perception_error": (0.5, 0.5, stats.norm.cdf(2.0), stats.norm.cdf(-1.0))}
    track = SensorTrack(sensor_with(position_sd_m=0.3, speed_sd_mps=0.1), 0, 1, None, errors)
    assert Noise(track).next_errors() == pytest.approx((2.0 * 0.3, -1.0 * 0.1))
    # They are added: 0.6 m farther along the walk, 0.1 m/s slower.  Who stands is seen to stand.
    sensor = sensor_with(position_sd_m=0.3, speed_sd_mps=0.1)
    for speed_mps, seen_mps in ((1.2, 1.1), (0.0, 0.0)):
        updates = Updates(sensor, lambda index: SensorTrack(sensor, 0, index, None, errors))
        person = PedestrianView(1, Side.NEAR, 2.0, 8.0, speed_mps, on_crossing=True)
        (told,) = updates.shown(lambda person=person: [(person, True)])
        assert (told.lateral_m, told.remaining_m) == pytest.approx((1.4, 7.4))
        assert told.speed_mps == pytest.approx(seen_mps)
    # u = 0.999, p = 0.5: ten looks, as at the first detection.
    sensor = sensor_with(detection_probability=0.5)
    track = Detection(SensorTrack(sensor, 0, 1, 0.0, {"redetection": (0.1, 0.999)}))
    seen = [track.found(in_sight) for in_sight in (True, False, *[True] * 10)]
    assert seen == [True, *[False] * 10, True]


def test_what_was_shown_is_kept_in_the_traces() -> None:
    walkers = [(0.0, Side.NEAR, 1.0)]
    seen, trace = play(scenario(perception={"latency_s": 0.5}), walkers)
    rows = trace_rows(0, [outcome_of(trace)]).to_pydict()
    shown = [i for i, name in enumerate(rows["object"]) if name == "shown-0"]
    told = {o.time_s: o.pedestrians[0] for o in seen if o.pedestrians}
    end_s = measure([trace])[0].end_s
    times = [rows["time_s"][i] for i in shown]
    assert times == pytest.approx([t for t in told if t <= end_s])
    for i in shown:
        time_s = rows["time_s"][i]
        # From the near kerb at 1 m/s, half a second ago.
        assert rows["y_m"][i] == pytest.approx(time_s - 0.5, abs=1e-9)
        assert (rows["x_m"][i], rows["speed_mps"][i]) == (0.0, 1.0)
    assert all(b > a for a, b in pairwise(times))
