"""What is known of the reference drivers: their validation on recordings, and where they disagree.

The results stand in ``validated.json``, with the data and the command that measured them.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any

from harness.scenario import Scenario, load_scenario
from harness.strategies.parameters import parameters_of
from harness.strategies.registry import STRATEGIES

CROWD_PER_HOUR = 1_000.0
"""From this flow on, two or more people are on a road of 9 m at once: a crowd, as in the
recordings."""


@cache
def validated() -> dict[str, Any]:
    """The results in ``validated.json``."""
    text = Path(__file__).with_name("validated.json").read_text(encoding="utf-8")
    results: dict[str, Any] = json.loads(text)
    return results


def keeps_its_defaults(scenario: Scenario, strategy: str) -> bool:
    """Whether a scenario leaves every parameter of a built-in strategy at its default."""
    if strategy not in STRATEGIES:
        return False
    defaults = {item.name: item.default for item in parameters_of(STRATEGIES[strategy])}
    return defaults | scenario.strategies.get(strategy, {}) == defaults


def is_the_papers(scenario: Scenario) -> bool:
    """Whether a scenario is the paper's (Table II, arms, pedestrian), for any N and seed."""
    ego, people, arms = scenario.ego, scenario.pedestrians, scenario.arms
    return (
        (ego.trigger_range_m, scenario.crossing.length_m, ego.initial_speed_mps) == (30, 9, 5)
        and scenario.crosswalk().lane_centre_m == scenario.crossing.length_m / 4
        and (arms.av, arms.human) == ("soft_yield", "human_gmm")
        and all(keeps_its_defaults(scenario, name) for name in (arms.av, arms.human))
        and (people.behaviour, people.timed) == ("constant", ())
        and people.first_at_trigger
        and people.max_count == 1
    )


def is_validated(scenario: Scenario) -> bool:
    """Whether the reference was validated with its parameters, and ``human_gmm`` with its model."""
    name = scenario.arms.human
    other_model = (scenario.model.name, scenario.model.path) != ("dut", None)
    if name not in validated()["recordings"]["drivers"] or (other_model and name == "human_gmm"):
        return False
    return keeps_its_defaults(scenario, name)


def not_validated(scenario: Scenario) -> str | None:
    """A sentence if the reference was not validated in scenes like the scenario's; otherwise None.

    The recordings show crowds that decide for themselves; people who come at fixed times do not.
    """
    name, people = scenario.arms.human, scenario.pedestrians
    known = is_validated(scenario)
    crowd = not people.timed and people.max_count != 1
    if known and crowd and max(people.flows_per_hour) >= CROWD_PER_HOUR:
        return None
    settings = ""
    if not known and name in validated()["recordings"]["drivers"]:
        settings = " with these settings"
    text = f"{name}{settings} was not validated against real drivers in such scenes"
    if known:
        order = validated()["recordings"]["drivers"][name]["order_right"]
        text += f". In recorded crowds (DUT) its order of passing was right for {100 * order:.0f} %"
    return f"{text}."


def validation(scenario: Scenario) -> str:
    """What the reference reached on recordings, as a sentence."""
    name, recordings = scenario.arms.human, validated()["recordings"]
    if not is_validated(scenario):
        settings = " with these settings" if name in recordings["drivers"] else ""
        return f"{name}{settings} was not compared with recorded drivers (harness validate)."
    human = recordings["drivers"][name]
    return (
        f"{name} in place of the drivers of {recordings['data']}: the order of passing was right "
        f"for {100 * human['order_right']:.0f} %, the median error of the pass time was "
        f"{human['pass_time_off_s']:.1f} s, and it hit somebody in {human['contacts']:g} "
        f"passages; the recorded drivers hit nobody. {human['remark']}"
    ).strip()


def opposite(scenario: Scenario, time_ratio: float) -> str | None:
    """A sentence if another shipped reference is known to give the opposite result; otherwise None.

    It is known for the scenarios in ``validated.json`` alone.

    >>> opposite(load_scenario("cctc", {"arms.av": "gap_yield"}), 0.7)
    'Against human_recorded gap_yield is slower: it depends on the reference.'
    >>> opposite(load_scenario("cctc", {"ego.initial_speed_mps": 6.0}), 0.7)
    """
    known, av, human = validated()["opposite"], scenario.arms.av, scenario.arms.human
    way, other = ("slower", "human_recorded") if time_ratio < 1 else ("faster", "human_gmm")
    if av not in known["strategies"] or human == other or not is_validated(scenario):
        return None
    studied = _studied()[:1] if way == "faster" else _studied()
    if _but_for_arms(scenario) not in studied:
        return None
    return f"Against {other} {av} is {way}: it depends on the reference."


@cache
def _studied() -> list[str]:
    studied = validated()["opposite"]["scenarios"]
    return [_but_for_arms(load_scenario(file, changes)) for file, changes in studied]


def _but_for_arms(scenario: Scenario) -> str:
    tree = scenario.model_dump(exclude={"arms", "conflicts"})
    del tree["experiment"]["pairs"], tree["experiment"]["seed"]
    return repr(tree)
