"""How near a reference driver is to measured drivers, in scenes of a scenario's kind."""

from typing import Literal, NamedTuple

from harness.scenario import PedestriansSection, Scenario
from harness.strategies.references import is_validated, validated

SceneKind = Literal["crowd", "one pedestrian", "flow", "own simulation", "timed"]

CROWD_PER_HOUR = 1_000.0
"""From this flow on, two or more people are on a road of 9 m at once: a crowd, as in DUT."""


class WaitError(NamedTuple):
    """Error of the waits at twelve measured site-periods: mean and R², with standard errors."""

    mean_s: float
    mean_error_s: float
    r2: float
    r2_error: float


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
    "sumo": {"human_yield": 0.088, "sumo_driver": 0.100},
}
"""Mean absolute error of the share in which the pedestrian goes first at a zebra, by behaviour and
driver (500 trials, 100 with ``sumo``, seed 1; docs/validation.md)."""

WAITS_OFF = {
    "threshold": {"human_yield": WaitError(4.25, 0.14, -5.66, 0.43)},
    "gap_acceptance": {"human_yield": WaitError(-1.38, 0.06, -0.38, 0.07)},
    "constant": {"human_yield": WaitError(-2.74, 0.04, -2.22, 0.08)},
}
"""The errors of waits, by behaviour and driver, seed 1 (docs/validation.md)."""


_DECIDES_BY = {"gap_acceptance": ("gap_acceptance",), "threshold": ("threshold", "kerb_wait_s")}
"""The keys by which pedestrians decide; with other behaviours it is the kerb wait alone."""


def scene_kind(scenario: Scenario) -> SceneKind:
    """Return the kind of scene: one pedestrian, a crowd, or a flow of vehicles or pedestrians.

    Neither timed pedestrians nor those of a user's own simulation decide by our rules.
    """
    people = scenario.pedestrians
    if scenario.simulation is not None:
        return "own simulation"
    if people.timed:
        return "timed"
    if people.max_count == 1:
        return "one pedestrian"
    return "crowd" if max(people.flows_per_hour) >= CROWD_PER_HOUR else "flow"


def nearness(scenario: Scenario) -> str:
    """Return a sentence on how near the reference is to measured drivers in this kind of scene.

    If it was not held against them there, with these settings and pedestrians who decide so, the
    sentence says this, and names the nearest measured scene of the driver, if any.
    """
    name, kind, people = scenario.arms.human, scene_kind(scenario), scenario.pedestrians
    measured = is_validated(scenario)
    held = ""
    if kind == "crowd" and measured:
        held = _in_crowds(name, full=True)
    elif kind == "one pedestrian" and measured and _decide_as_measured(people):
        held = _at_a_zebra(people.behaviour, name)
    elif kind == "flow" and _decide_as_measured(people):
        held = _at_sites(people.behaviour, _at_sites_driver(scenario))
    if held:
        return f"{name} {held}."
    drivers = validated()["recordings"]["drivers"]
    settings = " with these settings" if name in drivers and not measured else ""
    nearest = ""
    if kind == "own simulation":
        nearest = _at_a_zebra("sumo", name)
    elif kind == "flow" and settings and _decide_as_measured(people):
        nearest = _at_sites(people.behaviour, name)
    nearest = nearest or _in_crowds(name)
    own = "with its defaults " if settings and nearest else ""
    said = f"{name}{settings} was not held against real drivers in such scenes"
    return f"{said}{'; ' if nearest else ''}{own}{nearest}."


def _decide_as_measured(people: PedestriansSection) -> bool:
    """Whether pedestrians decide with the parameters that their behaviour has by default."""
    default = PedestriansSection(behaviour=people.behaviour)
    keys = _DECIDES_BY.get(people.behaviour, ("kerb_wait_s",))
    return all(getattr(people, key) == getattr(default, key) for key in keys)


def _at_sites_driver(scenario: Scenario) -> str:
    """The key of the reference in ``WAITS_OFF``, where each site had a yield rate of its own."""
    name = scenario.arms.human
    given = dict(scenario.strategies.get(name, {}))
    if name == "human_yield":
        given = {key: given[key] for key in given.keys() - {"yield_rate", "treatment"}}
    plain = scenario.model_copy(update={"strategies": {name: given}})
    return name if is_validated(plain) else ""


def _in_crowds(name: str, *, full: bool = False) -> str:
    human = validated()["recordings"]["drivers"].get(name)
    if human is None:
        return ""
    order = f"{100 * human['order_right']:.0f} %"
    if not full:
        return f"in crowds (DUT): order right for {order}"
    return (
        f"in recorded crowds (DUT): order of passing right for {order}, pass time off by "
        f"{human['pass_time_off_s']:.1f} s (median)"
    )


def _at_a_zebra(behaviour: str, name: str) -> str:
    off = FIRST_OFF.get(behaviour, {}).get(name)
    if off is None:
        return ""
    return f"at a measured zebra: the share of pedestrians who go first is off by {off:.2f}"


def _at_sites(behaviour: str, driver: str) -> str:
    off = WAITS_OFF.get(behaviour, {}).get(driver)
    if off is None:
        return ""
    return (
        "at 12 measured site-periods: pedestrians' waits are off by "
        f"{_signed(off.mean_s, '+.1f')} s, R² {_signed(off.r2, '.2f')} (1: exact, 0: a constant)"
    )


def _signed(value: float, form: str) -> str:
    """Return a number with a minus sign, as screens write it."""
    return f"{value:{form}}".replace("-", "−")
