"""People who decide, drivers whom they meet, and hours at real crossings, beside measured ones.

The files of ``tests/data/people`` have counts and published figures alone:

- ``gap_decisions.csv``: counted from the open table of the HIKER experiment (Lee et al. 2022; data
  with Markkula et al., PNAS Nexus 2023, CC BY-NC-SA), 60 people in a laboratory; the counts include
  people who set off before the first car had passed.
- ``who_goes_first.csv``: 32 pairs of driver and pedestrian in coupled simulators, described in Yang
  et al. 2024, Transportation Research Part F, doi:10.1016/j.trf.2024.08.027.
- ``field_sites.csv``: 12 periods at 6 crossings, NCHRP Project 17-87, working paper on uncontrolled
  crossings, tables B-1 to B-4.

docs/validation.md says what is simulated of each, and has the errors.  What is expected here is
measured, or follows from published models and formulas.
"""

import csv
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from harness.core.vocabulary import Arm, Observation, Trace
from harness.encounter.arms import make_strategy
from harness.encounter.arrivals import planned_arrivals
from harness.encounter.walking_speeds import WalkingSpeeds
from harness.model.interaction import load_model
from harness.scenario import Scenario, validate
from harness.strategies.manoeuvres import stop_after
from harness.studies.running.run import run
from tests.closed_forms import lognormal
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

NCHRP_OFF_S = 1.80
"""Mean absolute error of NCHRP's own formula for the waits (docs/validation.md)."""

UPPER_QUARTILES_S = {"25": (5.4, 6.3, 7.3), "35": (4.9, 5.9, 6.7)}
"""Of setting off before a yielding car, at gaps of 2, 3 and 4 s, by its speed in mph: the published
model's, from 40,000 draws."""

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


def by_threshold(speed_mps: float, gap_s: float) -> float:
    """Share that goes before a car at constant speed by Pekkanen et al. (2022), closed form.

    They decide at once or not at all: ln θ ~ N(1.430, 0.405²), ln latency ~ N(0.0166, 0.604²).
    """
    effective_s = gap_s + 0.252 * (speed_mps * gap_s / CAR_MPS - gap_s)
    decide = stats.norm.cdf((math.log(effective_s) - 1.430) / 0.405)
    return float(decide * stats.norm.cdf((math.log(gap_s) - 0.0166) / 0.604))


def by_gap(_speed_mps: float, gap_s: float) -> float:
    """The same with a log-normal critical gap of mean 4 s and standard deviation 2.5 s."""
    return float(lognormal(4.0, 2.5).cdf(gap_s))


EXPECTED: dict[str, tuple[Callable[[float, float], float], float]] = {
    "threshold": (by_threshold, 0.08),
    "gap_acceptance": (by_gap, 0.13),
}
"""The closed form of each behaviour, and how far the measured shares may be from it on average."""


@pytest.mark.parametrize("behaviour", EXPECTED)
def test_gaps_accepted_are_those_of_the_closed_form(behaviour: str) -> None:
    """Within four standard errors."""
    expected, measured_off = EXPECTED[behaviour]
    errors = []
    for cell in STEADY:
        speed_mps, gap_s = speed_and_gap(cell)
        share = (starts_s(cell, behaviour) < gap_s).mean()
        assert abs(share - expected(speed_mps, gap_s)) < 4 * math.sqrt(0.25 / TRIALS), cell
        errors.append(abs(share - int(cell["started_before_the_car"]) / int(cell["trials"])))
    assert np.mean(errors) < measured_off


def test_setting_off_before_a_yielding_car() -> None:
    """The upper quartiles of the published model, which are near the measured ones."""
    for cell in YIELDING:
        if cell["speed_mph"] in UPPER_QUARTILES_S and cell["time_gap_s"] != "5":
            known_s = UPPER_QUARTILES_S[cell["speed_mph"]][int(cell["time_gap_s"]) - 2]
            found_s = float(np.quantile(starts_s(cell, "threshold"), 0.75, method="higher"))
            assert found_s == pytest.approx(known_s, abs=0.4), cell
            assert found_s == pytest.approx(float(cell["start_q75_s"]), abs=0.8), cell


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


@pytest.mark.parametrize("behaviour", EXPECTED)
def test_who_goes_first_at_a_zebra(behaviour: str) -> None:
    """Drivers who yield come near the measured shares; people may decide after 1 s."""
    length_m = 2 * (TO_ZONE_M + CAR_WIDTH_M / 2)
    crossing = {"length_m": length_m, "oncoming_lanes": 0, "lane_width_m": 3.5}
    found = {}
    for driver in ("human_yield", "gap_yield"):
        errors = []
        for cell in FIRST:
            range_m = CAR_MPS * float(cell["time_to_arrival_s"])
            ego = {"initial_speed_mps": CAR_MPS, "trigger_range_m": range_m}
            scenario = alone(behaviour, crossing, ego | {"width_m": CAR_WIDTH_M}, driver)
            share = np.mean([pedestrian_first(trace) for trace in traces(scenario, 1.0)])
            errors.append(abs(share - float(cell["pedestrian_first_share"])))
        found[driver] = np.mean(errors)
    assert found["human_yield"] < min(0.2, found["gap_yield"])


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
        "experiment.seed": 2,
        "experiment.pairs": 2,
    }
    people = run("field_sites", settings=values, out=folder, workers=0).table("people")
    waits: np.ndarray = people.loc[people["arm"] == "human", "wait_s"].dropna().to_numpy()
    return waits


def test_waits_at_twelve_real_crossings(tmp_path: Path) -> None:
    """People who accept gaps are no farther from the measured waits than the published formula.

    Within three standard errors of the mean error.
    """
    folders = [tmp_path / f"{number}" for number in range(len(SITES))]
    waits = [waits_s(site, "gap_acceptance", "human_yield", folders.pop()) for site in SITES]
    errors = [
        of.mean() - float(site["pedestrian_delay_s"]) for of, site in zip(waits, SITES, strict=True)
    ]
    spread = [of.std(ddof=1) / math.sqrt(len(of)) for of in waits]
    assert np.abs(errors).mean() < NCHRP_OFF_S + 3 * np.linalg.norm(spread) / len(spread)
