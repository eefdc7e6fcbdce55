"""How near a reference driver is to measured drivers, in scenes of a scenario's kind."""

from typing import Literal, NamedTuple

from harness.scenario import Scenario
from harness.studies.runs.references import MEASURED, is_measured

SceneKind = Literal["crowd", "one pedestrian", "flow"]

CROWD_PER_HOUR = 1_000.0
"""From this flow on, two or more people are on a road of 9 m at once: a crowd, as in DUT."""


class WaitError(NamedTuple):
    """Error of the mean waits at twelve measured site-periods: mean in s, and R²."""

    mean_s: float
    r2: float


FIRST_OFF = {
    "threshold": {
        "human_yield": 0.151,
        "human_gmm": 0.620,
        "human_recorded": 0.623,
        "gap_yield": 0.608,
        "soft_yield": 0.623,
        "hard_yield": 0.623,
        "emergency_brake": 0.620,
        "constant_speed": 0.624,
    },
    "gap_acceptance": {
        "human_yield": 0.105,
        "human_gmm": 0.357,
        "human_recorded": 0.357,
        "gap_yield": 0.352,
        "soft_yield": 0.357,
        "hard_yield": 0.357,
        "emergency_brake": 0.358,
        "constant_speed": 0.360,
    },
    "constant": {
        "human_yield": 0.042,
        "human_gmm": 0.136,
        "human_recorded": 0.136,
        "gap_yield": 0.100,
        "soft_yield": 0.136,
        "hard_yield": 0.136,
        "emergency_brake": 0.136,
        "constant_speed": 0.136,
    },
}
"""Mean absolute error of the share in which the pedestrian goes first at a zebra, by behaviour and
driver (`harness validate people --trials 500`, seed 1; docs/validation.md)."""

WAITS_OFF = {
    "threshold": {"human_yield": WaitError(4.36, -6.11)},
    "gap_acceptance": {"human_yield": WaitError(-1.24, -0.25)},
}
"""The errors of waits, by behaviour and driver (docs/validation.md)."""


def scene_kind(scenario: Scenario) -> SceneKind:
    """Return the kind of scene: one pedestrian, a crowd, or a flow of vehicles or pedestrians."""
    people = scenario.pedestrians
    if people.max_count == 1:
        return "one pedestrian"
    flow = people.flow_per_hour
    most = max(flow) if isinstance(flow, tuple) else flow
    return "crowd" if most >= CROWD_PER_HOUR else "flow"


def nearness(scenario: Scenario) -> str:
    """Return a sentence on how near the reference is to measured drivers in this kind of scene.

    It is empty if nothing was measured: the driver with these parameters, the pedestrians'
    behaviour, or such a scene.
    """
    name, kind = scenario.arms.human, scene_kind(scenario)
    if not is_measured(scenario) or scenario.simulation is not None:
        return ""
    if kind == "crowd":
        human = MEASURED[name]
        return (
            f"{name} in recorded crowds (DUT): order of passing right for "
            f"{100 * human.order_right:.0f} %, pass time off by {human.pass_time_off_s:.1f} s "
            "(median)."
        )
    behaviour = scenario.pedestrians.behaviour
    first_off = FIRST_OFF.get(behaviour, {}).get(name)
    if kind == "one pedestrian" and first_off is not None:
        return (
            f"{name} at a measured zebra: the share of pedestrians who go first is off by "
            f"{first_off:.2f}."
        )
    waits_off = WAITS_OFF.get(behaviour, {}).get(name)
    if kind == "flow" and waits_off is not None:
        return (
            f"{name} at 12 measured site-periods: pedestrians' waits are off by "
            f"{_signed(waits_off.mean_s, '+.1f')} s, R² {_signed(waits_off.r2, '.2f')}."
        )
    return ""


def _signed(value: float, form: str) -> str:
    """Return a number with a minus sign, as screens write it."""
    return f"{value:{form}}".replace("-", "−")
