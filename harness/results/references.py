"""Two notes on the reference drivers: their validation on recordings, and where they disagree.

``python -m benchmarks.references`` writes the results into ``validated.json``, with data, versions
and date.
"""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, cast

from harness.core.freezing import frozen
from harness.scenario import Scenario, load_scenario
from harness.scenario.sections import ModelSection
from harness.strategies.parameters import defaults_of, knows_the_model
from harness.strategies.registry import STRATEGIES

_PAPERS = (30, 9, 5)
"""The paper's R0 in m, length of the crosswalk in m, and v0 in m/s (Table II)."""

CROWD_PER_HOUR = 1_000.0
"""From this flow on, two or more people are on a road of 9 m at once: a crowd, as in the
recordings."""


FILE = Path(__file__).with_name("validated.json")
"""The validations that are shipped."""


@cache
def known() -> Mapping[str, Any]:
    """The result of ``harness validate``, and the ratios of times of runs."""
    return cast(Mapping[str, Any], frozen(json.loads(FILE.read_text(encoding="utf-8"))))


def recorded() -> dict[str, Mapping[str, Any]]:
    """What each driver reached in place of recorded ones."""
    return {record["driver"]: record for record in known()["validation"]["records"]}


def keeps_its_defaults(scenario: Scenario, strategy: str) -> bool:
    """Whether a scenario leaves every parameter of a built-in strategy at its default."""
    if strategy not in STRATEGIES:
        return False
    defaults = defaults_of(STRATEGIES[strategy])
    return {**defaults, **scenario.strategies.get(strategy, {})} == defaults


def is_the_papers(scenario: Scenario) -> bool:
    """Whether a scenario is the paper's (Table II, arms, pedestrian), for any N and seed."""
    ego, people, arms = scenario.ego, scenario.pedestrians, scenario.arms
    return (
        (ego.trigger_range_m, scenario.crossing.length_m, ego.initial_speed_mps) == _PAPERS
        and scenario.crosswalk().lane_centre_m == scenario.crossing.length_m / 4
        and (arms.av, arms.human) == ("soft_yield", "human_gmm")
        and all(keeps_its_defaults(scenario, name) for name in (arms.av, arms.human))
        and (people.behaviour, people.timed) == ("constant", ())
        and people.first_at_trigger
        and people.max_count == 1
    )


def is_validated(scenario: Scenario) -> bool:
    """Whether the reference was validated with its parameters, and its model if it uses one."""
    name, used, shipped = scenario.arms.human, scenario.model, ModelSection()
    if name not in recorded() or not keeps_its_defaults(scenario, name):
        return False
    same_model = (used.name, used.path) == (shipped.name, shipped.path)
    return same_model or not knows_the_model(STRATEGIES[name])


def not_validated(scenario: Scenario) -> tuple[str, str] | None:
    """Says that the reference was not validated in scenes like the scenario's; None if it was.

    The recordings show crowds that decide for themselves; people who come at fixed times do not.
    The second sentence is what is known of the reference; it may be empty.
    """
    name, people = scenario.arms.human, scenario.pedestrians
    here = is_validated(scenario)
    crowd = not people.timed and people.max_count != 1
    if here and crowd and people.flow_per_hour >= CROWD_PER_HOUR:
        return None
    settings = " with these settings" if not here and name in recorded() else ""
    said = f"{name}{settings} was not validated against real drivers in such scenes."
    if not here:
        return said, ""
    order = 100 * recorded()[name]["order_right"]["value"]
    return said, f"In recorded crowds (DUT) its order of passing was right for {order:.0f} %."


def opposite(scenario: Scenario, time_ratio: float) -> str | None:
    """A sentence if another shipped reference is known to give the opposite result; otherwise None.

    It is known in the scenarios of ``validated.json`` alone, where an interval excludes 1.

    >>> opposite(load_scenario("cctc", {"arms.av": "gap_yield"}), 0.7)
    'With human_recorded as the reference gap_yield is slower.'
    >>> opposite(load_scenario("cctc", {"ego.initial_speed_mps": 6.0}), 0.7)
    """
    av, human, here = scenario.arms.av, scenario.arms.human, _but_for_arms(scenario)
    for row, studied in _studied():
        ratio = row["time_ratio"]
        slower = time_ratio < 1 < ratio["low"]
        other = row["reference"] != human and (slower or ratio["high"] < 1 < time_ratio)
        if other and row["av"] == av and studied == here:
            way = "slower" if slower else "faster"
            return f"With {row['reference']} as the reference {av} is {way}."
    return None


@cache
def _studied() -> tuple[tuple[Mapping[str, Any], str], ...]:
    rows = known()["runs"]
    scenarios = (load_scenario(row["scenario"], row["settings"]) for row in rows)
    return tuple((row, _but_for_arms(each)) for row, each in zip(rows, scenarios, strict=True))


def _but_for_arms(scenario: Scenario) -> str:
    tree = scenario.model_dump(exclude={"arms", "conflicts"})
    del tree["experiment"]["pairs"], tree["experiment"]["seed"]
    return repr(tree)
