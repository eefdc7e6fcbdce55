"""What is said about a result in words, on the page and on the terminal alike."""

from typing import Any

from harness.scenario import Scenario

PAPER = {"mu": "0.7044", "cv": "4.54 %", "kappa": "0"}
"""Chen, Zhao, Peng 2017, section III-E; N = 50."""


def is_the_papers(scenario: Scenario) -> bool:
    """Whether the paper's Table II and arms are what runs here (any N, seed and model)."""
    ego, pedestrians = scenario.ego, scenario.pedestrians
    return (
        (ego.trigger_range_m, scenario.crossing.length_m, ego.initial_speed_mps) == (30, 9, 5)
        and (scenario.arms.av, scenario.arms.human) == ("soft_yield", "human_gmm")
        and pedestrians.first_at_trigger
        and pedestrians.max_count == 1
    )


def short(value: Any) -> str:
    """A scenario's value as a user would write it."""
    return f"{value:g}" if isinstance(value, float) else str(value)
