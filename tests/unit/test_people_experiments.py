"""The experiments with measured people: their states by hand, their shares by closed forms."""

import hashlib
import json
import math
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pytest

from harness.core.encounter import Arrival, Side
from harness.engine.plain import PlainEngine
from harness.episode.cell_constants import constants_of
from harness.episode.loop import run_episode
from harness.report.screens.people_tables import people_screen
from harness.report.screens.screen import screen_lines
from harness.scenario import Setting, validate
from harness.strategies.constant_speed import ConstantSpeed
from harness.studies.validation import people
from harness.studies.validation.people import validate_people
from harness.studies.validation.people.measured import (
    GapCell,
    first_cells,
    gap_cells,
    site_periods,
)
from harness.studies.validation.people.scenes import (
    first_scene,
    gap_scene,
    site_scenario,
    state_at,
)
from harness.studies.validation.people.simulating import Job, episodes, pedestrian_first, simulate
from tests.batches import here, printed, refusal

GAP_DECISIONS = "7cfe99c05ea31418474a77011d782da13de95713a76fb72794bba4904e91a718"
FIELD_SITES = "629e9ff840fd8f6c8d25b3ab099de797da0acc8f97f6956f78eb16ffebabd17c"
"""SHA-256 of the files that the project was given with the data."""


def test_who_stands_at_the_kerb_decides_from_the_given_time_on() -> None:
    """Nobody is in their way: a car at 10 m/s is 30 m away, and they need a gap of 0 s."""
    scenario = validate({"ego": {"initial_speed_mps": 10.0}}, "test")
    start_s = {}
    for from_s in (None, 0.0, 1.0):
        person = Arrival(0, 0.0, Side.NEAR, 0.5, critical_gap_s=0.0, looks_from_s=from_s)
        engine = PlainEngine(scenario.vehicle(), 0.1)
        rules = constants_of(scenario)
        trace = run_episode(engine, ConstantSpeed(), [person], lambda *_: 1.0, rules)
        start_s[from_s] = trace.walks[0].start_s
    assert start_s == {None: 0.0, 0.0: 0.0, 1.0: 1.0}


def test_the_yielding_car_begins_in_the_state_it_has_when_the_first_car_passes() -> None:
    """By hand: from 38.5 m at v0 it brakes with v0²/72; at 25 mph that is 1.7348 m/s².

    2 s behind at 25 mph (11.176 m/s) it would be 22.352 m away.  It passed 38.5 m 1.44488 s ago, so
    it has lost 2.50653 m/s and is 22.352 + 2.50653 · 1.44488/2 = 24.1628 m away.
    """
    yielding = {(c.time_gap_s, c.speed_mph): c for c in gap_cells() if c.yields}
    braking = {
        key: state_at(cell, 0.0)
        for key, cell in yielding.items()
        if state_at(cell, 0.0)[1] < cell.speed_mps - 1e-9
    }
    assert set(braking) == {(2, 25), (3, 25), (2, 30), (2, 35)}
    assert braking[2, 25] == pytest.approx((24.1628, 8.66947), abs=1e-4)
    assert braking[3, 25] == pytest.approx((33.6997, 10.40424), abs=1e-4)
    assert braking[2, 30] == pytest.approx((27.7694, 11.23605), abs=1e-4)
    assert braking[2, 35] == pytest.approx((31.6535, 14.08020), abs=1e-4)
    assert state_at(yielding[5, 35], 0.0) == pytest.approx((5 * 35 * 0.44704, 35 * 0.44704))


@pytest.mark.parametrize("cell", [c for c in gap_cells() if c.yields])
def test_the_yielding_car_stands_2_5_m_before_the_line_as_soon_as_even_braking_allows(
    cell: GapCell,
) -> None:
    """It stands 38.5 m/v0 − gap later than at constant speed it would be there: 2 · 36 m/v0."""
    (trace,) = episodes(gap_scene(cell, "gap_acceptance", [], 1), 1)
    assert trace.x_m[-1] == pytest.approx(-2.5, abs=1e-6)
    begins_s = cell.time_gap_s - 38.5 / cell.speed_mps
    stands_s = begins_s + 2 * 36 / cell.speed_mps
    at_s = 0.1 * float(np.flatnonzero(trace.speed_mps < 1e-9)[0]) - 0.1
    assert at_s == pytest.approx(stands_s, abs=0.15)
    # In between it brakes evenly.
    halfway = round((begins_s + stands_s) / 2 / 0.1) + 1
    if begins_s > 0:
        slowing = -np.diff(trace.speed_mps)[halfway] / 0.1
        assert slowing == pytest.approx(cell.speed_mps**2 / 72, rel=0.01)


TRIALS = 600


def shares_started(behaviour: str) -> dict[GapCell, float]:
    """The simulated share that sets off before the gap is over, in every cell at constant speed."""
    shares = {}
    for number, cell in enumerate(gap_cells()):
        if not cell.yields:
            scene = gap_scene(cell, behaviour, [], 1)
            starts = simulate(Job("gaps", number, "", scene, TRIALS)).values
            shares[cell] = sum(start < cell.time_gap_s for start in starts) / TRIALS
    return shares


def close(share: float, expected: float) -> bool:
    return abs(share - expected) < 4 * math.sqrt(expected * (1 - expected) / TRIALS)


def test_gaps_are_accepted_as_the_share_of_critical_gaps_below_them() -> None:
    """gap_acceptance: ln g ~ N(ln 4 − σ²/2, σ²), σ² = ln(1 + (2.5/4)²); the gap ends at the edge.

    The near edge is half of the narrowest crosswalk, 0.5 m, before the line.
    """
    sigma = math.sqrt(math.log(1 + (2.5 / 4) ** 2))
    gaps = NormalDist(math.log(4) - sigma**2 / 2, sigma)
    for cell, share in shares_started("gap_acceptance").items():
        assert close(share, gaps.cdf(math.log(cell.time_gap_s - 0.5 / cell.speed_mps)))


def test_gaps_are_accepted_by_the_published_thresholds_and_latencies() -> None:
    """threshold, from the published parameters: they set off before the car if θ < τ_eff and l
    is below the gap, or if they decide in its last 0.373 s (the step 0.3 s before it) and l is
    shorter.  The mean absolute error to the measured shares may be 0.07 (0.065 in draws of the
    model without a simulation).
    """
    thresholds, latencies = NormalDist(1.430, 0.405), NormalDist(0.0166, 0.604)
    shares = shares_started("threshold")
    for cell, share in shares.items():
        gap_s, edge_s = cell.time_gap_s, 0.5 / cell.speed_mps
        judged_s = gap_s + 0.252 * (gap_s * cell.speed_mps / (50 / 3.6) - gap_s)
        decide = thresholds.cdf(math.log(judged_s))
        early = latencies.cdf(math.log(gap_s - edge_s))
        late = latencies.cdf(math.log(0.3 - edge_s))
        assert close(share, decide * early + (1 - decide) * late)
    assert np.mean([abs(share - cell.share) for cell, share in shares.items()]) <= 0.07


def test_at_the_zebra_the_person_stands_1_95_m_before_the_path_of_a_car_at_50_kmh() -> None:
    for cell in first_cells():
        scenario = first_scene(cell, "gap_acceptance", "constant_speed", [], 1).scenario
        vehicle, crossing = scenario.vehicle(), scenario.crosswalk()
        assert crossing.to_lane_m(Side.NEAR) - vehicle.width_m / 2 == pytest.approx(1.95)
        assert vehicle.initial_speed_mps == pytest.approx(13.8889, abs=1e-4)
        assert vehicle.trigger_range_m / 13.88889 == pytest.approx(cell.time_to_arrival_s)


def test_the_pedestrian_is_first_if_they_reach_the_path_before_the_front_reaches_the_line() -> None:
    """Before a car that keeps its speed, 3 s away: they set off at 1 s, so with a walk of 1.95 m
    they are first if they walk faster than 1.95/2 m/s."""
    cell = first_cells()[0]
    for speed_mps, first in ((0.95, False), (1.0, True)):
        walking = {"mean_mps": speed_mps, "std_mps": 1e-6}
        settings = [
            Setting("pedestrians.walking_speed", walking),
            Setting("pedestrians.behaviour", "constant"),
            Setting("pedestrians.kerb_wait_s", 0.0),
        ]
        scene = first_scene(cell, "constant", "constant_speed", settings, 1)
        (trace,) = episodes(scene, 1)
        assert trace.walks[0].start_s == 1.0
        assert pedestrian_first(trace) is first
    waits = [Setting("pedestrians.kerb_wait_s", 9.0)]
    (trace,) = episodes(first_scene(cell, "constant", "constant_speed", waits, 1), 1)
    assert not pedestrian_first(trace)


def test_the_shipped_figures_are_those_of_their_sources() -> None:
    """The shares as published or counted; the files by their hash."""
    steady = [cell for cell in gap_cells() if not cell.yields]
    shares = {
        mph: [round(c.share, 2) for c in steady if c.speed_mph == mph] for mph in (25, 30, 35)
    }
    assert shares == {
        25: [0.04, 0.25, 0.45, 0.70],
        30: [0.07, 0.26, 0.48, 0.76],
        35: [0.05, 0.28, 0.59, 0.83],
    }
    assert [(c.time_to_arrival_s, c.trials, c.share) for c in first_cells()] == [
        (3, 127, 0.59), (4, 128, 0.91), (5, 128, 1.0), (6, 128, 1.0), (7, 128, 1.0),
    ]  # fmt: skip
    folder = Path(people.__file__).parent
    hashes = {
        path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.glob("*.csv")
    }
    assert hashes["gap_decisions"] == GAP_DECISIONS
    assert hashes["field_sites"] == FIELD_SITES


def test_a_wait_at_a_site_is_simulated_with_its_own_flow_and_yield_rate() -> None:
    """Site 5, weekday: 60 ft, two lanes each way, 25 mph, 862 vehicles, 12.6 s to cross, 0.913."""
    site = site_periods()[4]
    scenario = site_scenario(site, "gap_acceptance", "human_yield", [], 1)
    assert scenario.crossing.length_m == pytest.approx(18.288)
    assert (scenario.crossing.lanes, scenario.crossing.oncoming_lanes) == (2, 2)
    assert scenario.ego.initial_speed_mps == pytest.approx(11.176)
    assert scenario.known_traffic.flow_per_hour == scenario.known_traffic.oncoming_per_hour == 431
    assert scenario.pedestrians.walking_speed is not None
    assert scenario.pedestrians.walking_speed.mean_mps == pytest.approx(18.288 / 12.6)
    assert scenario.strategies["human_yield"]["yield_rate"] == 0.913


@pytest.mark.slow
def test_the_findings_do_not_depend_on_the_workers() -> None:
    alone = validate_people("gap_acceptance", ["human_yield"], workers=0, trials=2, hours=1)
    several = validate_people("gap_acceptance", ["human_yield"], workers=2, trials=2, hours=1)
    assert several == alone


def test_the_first_screen_says_how_many_people_and_trials_stand_behind_each_row() -> None:
    alone = validate_people("gap_acceptance", ["human_yield"], workers=0, trials=2, hours=0)
    lines = screen_lines(people_screen(alone))
    assert len(lines) <= 16
    text = " ".join(lines)
    assert "60 people, 4,270 trials (laboratory)" in text
    assert "32 pairs, 639 trials (laboratory)" in text
    behind = {held.experiment.key: held.trials for held in alone.held}
    assert behind == {"gaps": 4270, "yielding": 2853, "first": 639}


def test_a_driver_outside_the_data_of_its_model_is_named() -> None:
    """The model dut has data up to 8 m/s (its card); the cars at the zebra come at 13.9 m/s."""
    drivers = ["human_gmm", "human_yield"]
    findings = validate_people("constant", drivers, workers=0, trials=1, hours=0)
    screen = people_screen(findings)
    (line,) = (note.text for note in screen.notes if "outside the data" in note.text)
    assert line.startswith("first at a zebra: human_gmm: cars come faster than 8 m/s")


def test_the_command_prints_people_or_refuses_in_one_line(tmp_path: Path) -> None:
    words = ["validate", "people", "--trials", "2", "--hours", "0", "--workers", "1"]
    words += ["--out", str(tmp_path)]
    document = json.loads(printed(*words, "--json", "--without-zebra"))
    assert json.loads((tmp_path / "people.json").read_text("utf-8")) == document
    page = (tmp_path / "people.html").read_text("utf-8")
    assert "counted from the open table of the HIKER" in page
    assert [held["experiment"]["key"] for held in document["held"]][-1] == "first_without_zebra"
    assert document["held"][-1]["scores"] is None
    for more, named in (
        (["--format", "vci"], "--format"),
        (["--set", "ego.length_m=3"], "ego.length_m"),
        (["--behaviour", "constat"], "did you mean 'constant'?"),
        (["--set", "strategies.human_yield.yield_rate=3"], "yield_rate"),
    ):
        assert named in refusal("validate", "people", *more)
    away = ["validate", "./people", "--format", "vci", "--drivers", "human_gmm"]
    done = here(*away)
    assert done.returncode == 2
    assert "no such file or folder" in done.stderr.splitlines()[-1]
    assert "--hours: needs people" in refusal(*away, "--hours", "3")
