"""Ten scenarios whose probability of a crash is known, for ``benchmarks.surrogates``.

κ of a scenario is known in one of these ways.  None of them uses ``harness/studies/risk``.

- ``quadrature``: one pedestrian steps off at the trigger.  Side, walking speed and the look of the
  first detection are all that is random, so κ is a sum of integrals (``benchmarks.risk``).
- ``product``: the same, with a fault of known share (``benchmarks.risk``).
- ``looks``: the look of the first detection is all that is random, so κ is a sum over looks.
- ``brute force``: crashes are counted in episodes of another seed than those of the prediction.
- ``reference``: the same, from ``data/risk_reference.csv``.
- ``one arrival``: at most one pedestrian comes.  Whoever comes after the pass of an ego that never
  brakes meets nobody, so κ = P(arrival within the pass) P(crash | arrival within the pass).  The
  second factor is counted.
"""

import csv
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from benchmarks.risk import REFERENCE, TRUTH, crashes, looks, quadrature, runner_of
from harness.core.encounter import Arm, Ending
from harness.core.seeding import Given
from harness.measures import EpisodeRecord
from harness.scenario import Scenario, Setting, load_scenario

TRUTH_SEED = 104
EPISODES_SEED = 105

COLUMNS = ("min_ttc_s", "pet_s", "max_drac_mps2")
"""What is recorded of an episode, beside its crash."""


class Truth(NamedTuple):
    """κ of a scenario, its standard error (0: numerical error below 1e-3 of κ), and its source."""

    kappa: float
    standard_error: float
    how: str


class Case(NamedTuple):
    """A scenario: the shipped one, what is changed of it, and how its κ is known."""

    shipped: str
    changes: dict[str, Any]
    truth: Callable[["Case"], Truth]

    def scenario(self, seed: int) -> Scenario:
        """The scenario with a seed."""
        changes = {**self.changes, "experiment.seed": seed}
        return load_scenario(self.shipped, [Setting(key, value) for key, value in changes.items()])


def _by_quadrature(case: Case) -> Truth:
    return Truth(quadrature(case.scenario(0)), 0.0, "quadrature")


def _by_product(_case: Case) -> Truth:
    return Truth(TRUTH["dead-3"], 0.0, "product")


def _by_looks(case: Case) -> Truth:
    scenario = case.scenario(0)
    chances = looks(scenario.perception.detection_probability)
    people: list[tuple[int, Given]] = [
        (0, {"timed_detection": [detection]}) for detection, _ in chances
    ]
    probabilities = np.array([probability for _, probability in chances])
    return Truth(float(probabilities @ crashes(runner_of(scenario), people)), 0.0, "looks")


def _by_brute_force(episodes: int) -> Callable[[Case], Truth]:
    def count(case: Case) -> Truth:
        crashed = crashes(
            runner_of(case.scenario(TRUTH_SEED)), [(pair, {}) for pair in range(episodes)]
        )
        return _share(int(crashed.sum()), episodes, 1.0, "brute force")

    return count


def _by_reference(case: str) -> Callable[[Case], Truth]:
    def look_up(_case: Case) -> Truth:
        with REFERENCE.open(encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file) if row["case"] == case]
        crashed, pairs = (sum(int(row[key]) for row in rows) for key in ("crashed", "pairs"))
        return _share(crashed, pairs, 1.0, "reference")

    return look_up


def _by_one_arrival(episodes: int) -> Callable[[Case], Truth]:
    def count(case: Case) -> Truth:
        scenario = case.scenario(TRUTH_SEED)
        pass_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
        (flow_per_hour,) = np.atleast_1d(np.asarray(scenario.pedestrians.flow_per_hour))
        within = -math.expm1(-pass_s * float(flow_per_hour) / 3600)
        arrivals = np.random.default_rng(TRUTH_SEED).uniform(0.0, within, episodes)
        people: list[tuple[int, Given]] = [
            (pair, {"arrival": [arrival]}) for pair, arrival in enumerate(arrivals.tolist())
        ]
        crashed = crashes(runner_of(scenario), people)
        return _share(int(crashed.sum()), episodes, within, "one arrival")

    return count


def _share(crashed: int, episodes: int, factor: float, how: str) -> Truth:
    share = crashed / episodes
    error = factor * math.sqrt(share * (1 - share) / episodes)
    return Truth(factor * share, error, f"{how} ({crashed} of {episodes})")


CASES: dict[str, Case] = {
    "reactive": Case(
        "cctc_flow",
        {"arms.av": "constant_speed", "pedestrians.behaviour": "reactive"},
        _by_brute_force(60_000),
    ),
    "emergency": Case(
        "cctc",
        {"arms.av": "emergency_brake", "perception.detection_probability": 0.2},
        _by_quadrature,
    ),
    "gaps": Case(
        "cctc_flow",
        {"arms.av": "constant_speed", "pedestrians.behaviour": "threshold"},
        _by_brute_force(200_000),
    ),
    "late": Case(
        "cctc_flow",
        {
            "arms.av": "gap_yield",
            "pedestrians.flow_per_hour": 500.0,
            "perception.latency_s": 0.7,
        },
        _by_reference("late"),
    ),
    "slow_driver": Case(
        "cctc_flow",
        {
            "arms.av": "human_yield",
            "pedestrians.behaviour": "gap_acceptance",
            "strategies.human_yield.reaction_time_s": 1.0,
            "strategies.human_yield.reaction_time_sigma": 0.4,
        },
        _by_brute_force(250_000),
    ),
    "dead": Case(
        "cctc",
        {
            "arms.av": "benchmarks.faults:Dead",
            "perception.detection_probability": 0.17,
            'strategies."benchmarks.faults:Dead".share': 1e-3,
        },
        _by_product,
    ),
    "few_gaps": Case(
        "cctc_flow",
        {
            "arms.av": "constant_speed",
            "pedestrians.behaviour": "threshold",
            "pedestrians.flow_per_hour": 10.0,
            "pedestrians.max_count": 1,
        },
        _by_one_arrival(100_000),
    ),
    "child": Case(
        "euro_ncap_vru",
        {
            "arms.av": "emergency_brake",
            "pedestrians.timed_case": "CPNCO-50",
            "ego.initial_speed_mps": 8.3333,
            "perception.detection_probability": 0.6,
        },
        _by_looks,
    ),
    "late_brakes": Case(
        "cctc",
        {
            "arms.av": "hard_yield",
            "perception.detection_probability": 0.2,
            "actuation.dead_time_s": 0.5,
            "actuation.lag_s": 0.3,
        },
        _by_quadrature,
    ),
    "missed": Case(
        "cctc",
        {"arms.av": "hard_yield", "perception.detection_probability": 0.2},
        _by_quadrature,
    ),
}
"""By name, from the most frequent crashes to the rarest."""


def episodes(case: Case, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Simulate the AV's episodes of the first pairs.

    Returns:
        Whether each ended in a crash, shape (count,); its ``COLUMNS``, shape (count, 3), NaN where
        a measure is undefined and in crashes.

    Raises:
        SystemExit: an episode failed or timed out.
    """
    crashed, values = [], []
    runner = runner_of(case.scenario(EPISODES_SEED))
    for outcome in runner.run(range(count), arms=[Arm.AV]):
        record = outcome.record
        if record.ending not in (Ending.CRASHED, Ending.CROSSED):
            raise SystemExit(f"pair {outcome.pair} ended as {record.ending}")
        crashed.append(record.ending is Ending.CRASHED)
        values.append(_values(record))
    return np.array(crashed), np.array(values)


def _values(record: EpisodeRecord) -> list[float]:
    if record.ending is Ending.CRASHED:
        return [math.nan] * len(COLUMNS)
    numbers = (getattr(record, column) for column in COLUMNS)
    return [math.nan if number is None else float(number) for number in numbers]
