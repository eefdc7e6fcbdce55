"""People who decide, drivers whom they meet, and hours at real crossings, beside measured ones.

The files of ``tests/data/people`` have counts and published figures alone:

- ``gap_decisions.csv``: counted from the open table of the HIKER experiment (Lee et al. 2022; data
  with Markkula et al., PNAS Nexus 2023, CC BY-NC-SA), 60 people in a laboratory; the counts include
  people who set off before the first car had passed.
- ``who_goes_first.csv``: 32 pairs of driver and pedestrian in coupled simulators, described in Yang
  et al. 2024, Transportation Research Part F, doi:10.1016/j.trf.2024.08.027.
- ``field_sites.csv``: 12 periods at 6 crossings, NCHRP Project 17-87, working paper on uncontrolled
  crossings, tables B-1 to B-4.

docs/validation.md says what is simulated of each, and has the errors.
"""

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.core.vocabulary import Arm, Observation, Trace
from harness.encounter.arms import make_strategy
from harness.encounter.arrivals import planned_arrivals
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.model.interaction import load_model
from harness.scenario import Scenario, validate
from harness.strategies.manoeuvres import stop_after
from harness.studies.running.run import run
from tests.scenes import episode

pytestmark = pytest.mark.slow

DATA = Path(__file__).parents[1] / "data" / "people"
MPH_MPS, FOOT_M, STEP_S = 0.44704, 0.3048, 0.1
TRIALS = 500

BRAKES_FROM_M, STANDS_AT_M = 38.5, 2.5
"""Ranges at which the yielding car begins to brake and at which it stands."""

TO_ZONE_M, CAR_WIDTH_M, CAR_MPS = 1.95, 1.8, 50 / 3.6
"""From the person at the zebra to the path of the car, and the car."""

MOST_SHARED_PER_HOUR = 20.0
"""Where fewer people come, this many are simulated: they meet each other too rarely to matter."""

FIRST_OFF = {
    "threshold": {"human_yield": 0.151, "gap_yield": 0.608},
    "gap_acceptance": {"human_yield": 0.105, "gap_yield": 0.352},
    "constant": {"human_yield": 0.042, "gap_yield": 0.100},
}
"""Mean absolute error of the share in which the person goes first (docs/validation.md)."""

WAITS_OFF = {
    "threshold": (4.25, 0.14, -5.66, 0.43),
    "gap_acceptance": (-1.38, 0.06, -0.38, 0.07),
    "constant": (-2.74, 0.04, -2.22, 0.08),
}
"""Mean error of waits in s and R², each with its standard error (docs/validation.md)."""

Cell = Mapping[str, str]


def cells(name: str) -> list[Cell]:
    with (DATA / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


STEADY, YIELDING = (
    [cell for cell in cells("gap_decisions") if cell["yields"] == yields]
    for yields in ("no", "yes")
)
FIRST, SITES = cells("who_goes_first"), cells("field_sites")


class EvenBraking:
    """The car that brakes evenly from 38.5 m on to stand 2.5 m before the crossing line."""

    def decide(self, observation: Observation, /) -> float:
        ego, step_s = observation.ego, observation.step_s
        to_brake_m = ego.range_m - BRAKES_FROM_M
        if to_brake_m > 0:
            braked_s = max(0.0, step_s - to_brake_m / ego.speed_mps)
            return -even_deceleration_mps2(ego.speed_mps) * braked_s / step_s
        return stop_after(ego.range_m - STANDS_AT_M, ego.speed_mps, step_s)


def even_deceleration_mps2(speed_mps: float) -> float:
    return speed_mps**2 / (2 * (BRAKES_FROM_M - STANDS_AT_M))


def speed_and_gap(cell: Cell) -> tuple[float, float]:
    """Of the second car, before it brakes: m/s, and s behind the first one."""
    return float(cell["speed_mph"]) * MPH_MPS, float(cell["time_gap_s"])


def alone(behaviour: str, crossing: dict[str, Any], ego: dict[str, Any], driver: str) -> Scenario:
    """One person, who is at the near kerb from the start."""
    people = {"flow_per_hour": 0.0, "first_at_trigger": True, "near_side_share": 1.0}
    return validate(
        {
            "crossing": crossing,
            "ego": ego,
            "arms": {"av": driver, "human": driver},
            "pedestrians": people
            | {"behaviour": behaviour, "walking_speed": {"mean_mps": 1.34}},  # Tarawneh 2001
            "model": {"extrapolate": True},
            "experiment": {"seed": 1, "step_s": STEP_S, "timeout_s": 20.0},
        },
        "test",
    )


def traces(scenario: Scenario, looks_from_s: float, braking: bool = False) -> list[Trace]:
    """Trials in which the person may decide from a time on."""
    model = load_model(scenario.model.name, scenario.model.path)
    speeds, found = WalkingSpeeds(scenario, model), []
    for trial in range(TRIALS):
        (person,) = planned_arrivals(scenario, trial)
        person = person._replace(looks_from_s=looks_from_s)
        driver = EvenBraking() if braking else make_strategy(scenario, Arm.HUMAN, trial, model)
        found.append(episode(scenario, driver, [person], speeds))
    return found


def starts_s(cell: Cell, behaviour: str) -> np.ndarray:
    """When they set off, after the first car has passed; infinite if they do not.

    The laboratory has one lane of 3.5 m and no marked crosswalk: the narrowest that there is.
    Before a yielding car the episode begins a step earlier, so that the person sees it brake.
    """
    yields = cell["yields"] == "yes"
    lead_s = STEP_S if yields else 0.0
    speed_mps, gap_s = speed_and_gap(cell)
    range_m = speed_mps * (gap_s + lead_s)
    if yields and range_m < BRAKES_FROM_M:
        braked_s = (BRAKES_FROM_M - range_m) / speed_mps
        lost_mps = even_deceleration_mps2(speed_mps) * braked_s
        range_m, speed_mps = range_m + lost_mps * braked_s / 2, speed_mps - lost_mps
    crossing = {"length_m": 3.5, "oncoming_lanes": 0, "width_m": 1.0}
    ego = {"initial_speed_mps": speed_mps, "trigger_range_m": range_m}
    scenario = alone(behaviour, crossing, ego, "constant_speed")
    starts = (trace.walks[0].start_s for trace in traces(scenario, lead_s, yields))
    return np.array([math.inf if start is None else start - lead_s for start in starts])


@pytest.mark.parametrize(
    ("behaviour", "gaps_off", "quartiles_off_s"),
    [("threshold", 0.065, 1.35), ("gap_acceptance", 0.109, 2.90), ("constant", 0.380, 3.06)],
)
def test_gaps_accepted_and_quartiles_of_setting_off(behaviour, gaps_off, quartiles_off_s) -> None:
    measured = [int(cell["started_before_the_car"]) / int(cell["trials"]) for cell in STEADY]
    shares = [(starts_s(cell, behaviour) < speed_and_gap(cell)[1]).mean() for cell in STEADY]
    assert np.abs(np.subtract(shares, measured)).mean() == pytest.approx(gaps_off, abs=6e-4)
    errors = []
    for cell in YIELDING:
        starts = np.sort(starts_s(cell, behaviour))
        for share in (25, 50, 75):
            if cell[f"start_q{share}_s"]:
                at = starts[math.ceil(share / 100 * TRIALS) - 1]
                errors.append(abs(at - float(cell[f"start_q{share}_s"])))
    assert np.mean(errors) == pytest.approx(quartiles_off_s, abs=6e-3)


def pedestrian_first(trace: Trace) -> bool:
    """Whether they reached the path of the car before its front reached the crossing line."""
    walk = trace.walks[0]
    if walk.start_s is None or not walk.speed_mps:
        return False
    passed = np.flatnonzero(trace.x_m >= 0)
    if not len(passed):
        return True
    before_m, x_m = trace.x_m[passed[0] - 1 : passed[0] + 1]
    front_s = (passed[0] - 1 - before_m / (x_m - before_m)) * trace.step_s
    return bool(walk.start_s + TO_ZONE_M / walk.speed_mps < front_s)


@pytest.mark.parametrize("behaviour", ["threshold", "gap_acceptance", "constant"])
def test_who_goes_first_at_a_zebra(behaviour: str) -> None:
    """The shipped table is met again; the driver sees them from the start, they look after 1 s."""
    length_m = 2 * (TO_ZONE_M + CAR_WIDTH_M / 2)
    crossing = {"length_m": length_m, "oncoming_lanes": 0, "lane_width_m": 3.5}
    found = {}
    for driver in FIRST_OFF[behaviour]:
        errors = []
        for cell in FIRST:
            range_m = CAR_MPS * float(cell["time_to_arrival_s"])
            ego = {"initial_speed_mps": CAR_MPS, "trigger_range_m": range_m}
            scenario = alone(behaviour, crossing, ego | {"width_m": CAR_WIDTH_M}, driver)
            share = np.mean([pedestrian_first(trace) for trace in traces(scenario, 1.0)])
            errors.append(abs(share - float(cell["pedestrian_first_share"])))
        found[driver] = round(float(np.mean(errors)), 3)
    assert found == FIRST_OFF[behaviour]


def waits_s(site: Cell, behaviour: str, driver: str, folder: Path) -> np.ndarray:
    """The wait of every pedestrian of two hours at a site, with its own flows and yield rate."""
    lanes, length_m = int(site["through_lanes"]), float(site["crossing_length_ft"]) * FOOT_M
    oncoming = lanes // 2 if site["two_way"] == "yes" else 0
    flow, yield_rate = float(site["vehicles_per_hour"]), float(site["yield_rate"])
    values = {
        "crossing.length_m": length_m,
        "crossing.lanes": lanes - oncoming,
        "crossing.oncoming_lanes": oncoming,
        "ego.initial_speed_mps": float(site["speed_limit_mph"]) * MPH_MPS,
        "traffic.flow_per_hour": flow * (1 - oncoming / lanes),
        "traffic.oncoming_per_hour": flow * oncoming / lanes,
        "pedestrians.flow_per_hour": max(float(site["pedestrians_per_hour"]), MOST_SHARED_PER_HOUR),
        "pedestrians.behaviour": behaviour,
        "pedestrians.walking_speed.mean_mps": length_m / float(site["crossing_time_s"]),
        "strategies.human_yield.yield_rate": yield_rate,
        "arms.av": driver,
        "arms.human": driver,
        "model.extrapolate": True,
        "experiment.seed": 2,
        "experiment.pairs": 2,
    }
    people = run("field_sites", settings=values, out=folder, workers=0).table("people")
    waits: np.ndarray = people.loc[people["arm"] == "human", "wait_s"].dropna().to_numpy()
    return waits


@pytest.mark.parametrize("behaviour", WAITS_OFF)
def test_waits_at_twelve_real_crossings(behaviour: str, tmp_path: Path) -> None:
    """The shipped errors are met again by other people and vehicles, within three standard errors.

    These are of both numbers for the mean error, of these hours for R².  With standard errors s of
    the sites' means, that of the mean error is √Σ s²/12; to first order that of R² is
    2 √Σ (error s)²/Σ (measured − mean)².
    """
    measured = np.array([float(site["pedestrian_delay_s"]) for site in SITES])
    apart = ((measured - measured.mean()) ** 2).sum()
    mean_s, mean_error, shipped_r2, shipped_error = WAITS_OFF[behaviour]
    waits = [
        waits_s(site, behaviour, "human_yield", tmp_path / f"{number}")
        for number, site in enumerate(SITES)
    ]
    errors = np.array([of.mean() for of in waits]) - measured
    spread = np.array([of.std(ddof=1) / math.sqrt(len(of)) for of in waits])
    mean_error_s = math.hypot(np.linalg.norm(spread) / len(spread), mean_error)
    assert errors.mean() == pytest.approx(mean_s, abs=3 * mean_error_s)
    r2, r2_error = 1 - (errors**2).sum() / apart, 2 * np.linalg.norm(errors * spread) / apart
    assert r2 == pytest.approx(shipped_r2, abs=3 * math.hypot(r2_error, shipped_error))
