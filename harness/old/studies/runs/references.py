"""Validation results of the reference drivers, and known disagreements between references."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from harness.old.statistics.entries import Finding
from harness.scenario import Scenario, load_scenario
from harness.strategies.parameters import parameters_of
from harness.strategies.registry import STRATEGIES

MEASURED_ON = "34 recorded passages of 26 vehicles (DUT)"
"""The source of ``MEASURED``: `harness validate` on DUT with these drivers, seed 1."""


@dataclass(frozen=True)
class Humanness:
    """Validation findings about one driver with its default parameters.

    ``remark`` names the data to which the driver was fitted; it is empty if there are none.
    """

    order_right: float
    pass_time_off_s: float
    contacts: float
    remark: str = ""


MEASURED = {
    "human_recorded": Humanness(
        0.857,
        1.40,
        9,
        "Its parameters were fitted to these same passages. With parameters fitted to the other "
        "vehicles, the order is right for 81 %, which is still optimistic, because its rules were "
        "chosen on all passages.",
    ),
    "human_gmm": Humanness(
        0.684,
        7.50,
        17,
        "Its model was fitted to the same recordings in five folds, each without the vehicles that "
        "it was then compared with.",
    ),
    "human_yield": Humanness(0.623, 6.74, 11.6),
    "soft_yield": Humanness(0.501, 11.24, 12),
    "hard_yield": Humanness(0.499, 11.45, 12),
    "gap_yield": Humanness(0.620, 6.12, 10),
    "emergency_brake": Humanness(0.841, 1.40, 12),
    "constant_speed": Humanness(0.903, 1.48, 12),
}
"""Order of passing, median error of the pass time, passages with contact (docs/validation.md)."""

_STUDIED = ("soft_yield", "hard_yield", "gap_yield", "emergency_brake")
"""Strategies that docs/strategies.md compares with three references, in ``_STUDIES``."""

_STUDIES = {
    "cctc": ("cctc", {}),
    "cctc_flow, 250 per hour": ("cctc_flow", {}),
    "cctc_flow, 1,000 per hour": ("cctc_flow", {"pedestrians.flow_per_hour": 1000.0}),
}
"""The scenarios of that study: file and changed keys."""


def keeps_its_defaults(scenario: Scenario, strategy: str) -> bool:
    """Return whether a scenario leaves every parameter of a built-in strategy at its default."""
    defaults = {item.name: item.default for item in parameters_of(STRATEGIES[strategy])}
    return defaults | scenario.strategies.get(strategy, {}) == defaults


def not_measured(scenario: Scenario) -> str:
    """Return that the reference driver was not validated with its model and parameters."""
    name = scenario.arms.human
    settings = " with these settings" if name in MEASURED else ""
    return f"{name}{settings} was not compared with recorded drivers (harness validate)."


def is_measured(scenario: Scenario) -> bool:
    """Return whether the reference driver was validated; ``human_gmm`` needs the same model."""
    name = scenario.arms.human
    other_model = (scenario.model.name, scenario.model.path) != ("dut", None)
    if name not in MEASURED or (other_model and name == "human_gmm"):
        return False
    return keeps_its_defaults(scenario, name)


def reference_lines(scenarios: Iterable[Scenario]) -> list[str]:
    """Return a line for each reference driver with its validation results."""
    lines = []
    for scenario in scenarios:
        name = scenario.arms.human
        if not is_measured(scenario):
            lines.append(not_measured(scenario))
            continue
        human = MEASURED[name]
        line = (
            f"{name} replaced the drivers of {MEASURED_ON}: its order of passing was right for "
            f"{100 * human.order_right:.0f} %, the median error of its pass time was "
            f"{human.pass_time_off_s:.1f} s, and it hit somebody in {human.contacts:g} passages. "
            "The recorded drivers hit nobody."
        )
        lines.append(f"{line} {human.remark}".rstrip())
    return list(dict.fromkeys(lines))


def disagreement(scenario: Scenario, time_ratio: float) -> str:
    """Return a sentence if another shipped reference is known to give the opposite result.

    In docs/strategies.md each strategy of ``_STUDIED`` took more time than ``human_recorded`` in
    every scenario, and less time than ``human_gmm`` in ``cctc``.  For other sites or parameters the
    result is unknown and the sentence is empty.

    >>> disagreement(load_scenario("cctc", {"arms.av": "gap_yield"}), 0.7)[:43]
    'Against human_recorded gap_yield is slower:'
    >>> disagreement(load_scenario("cctc", {"ego.initial_speed_mps": 6.0}), 0.7)
    ''
    """
    av, human = scenario.arms.av, scenario.arms.human
    way, other = ("slower", "human_recorded") if time_ratio < 1 else ("faster", "human_gmm")
    if av not in _STUDIED or human not in MEASURED or human == other:
        return ""
    place = _studied_as(scenario)
    if place is None or (way == "faster" and place != "cctc"):
        return ""
    return f"Against {other} {av} is {way}: the result depends on the reference."


def _studied_as(scenario: Scenario) -> str | None:
    """Return the key in ``_STUDIES`` of a scenario that differs only in drivers and pairs."""
    same = _but_for_arms(scenario)
    for name, (file, changes) in _STUDIES.items():
        if _but_for_arms(load_scenario(file, changes)) == same:
            return name
    return None


def _but_for_arms(scenario: Scenario) -> Scenario:
    experiment = scenario.experiment.model_copy(update={"pairs": 1, "seed": 0})
    free = {"arms": None, "conflicts": None, "experiment": experiment}
    return scenario.model_copy(update=free)


def agreement(ratios: Sequence[tuple[str, Finding]]) -> str:
    """Return whether the intervals of the ratio of times lie on the same side of 1, as a sentence.

    Args:
        ratios: the name of each reference, and the ratio of times against it.
    """
    sides, parts = set(), []
    for name, ratio in ratios:
        if ratio.number is None or ratio.low is None or ratio.high is None:
            sides.add("unknown")
            parts.append(f"{name} undefined")
            continue
        sides.add("less" if ratio.high < 1 else "more" if ratio.low > 1 else "unknown")
        parts.append(f"{name} {ratio.number:.3f} ({ratio.low:.3f} … {ratio.high:.3f})")
    listed = f"ratio of times {'; '.join(parts)}"
    if {"less", "more"} <= sides:
        return f"Whether the AV takes less time than a human depends on the reference: {listed}."
    significant = sides - {"unknown"}
    if not significant:
        return f"The AV is not shown to be faster or slower than any reference: {listed}."
    against = "every reference" if "unknown" not in sides else "some of the references"
    rest = "; against the others neither is shown to be faster" if "unknown" in sides else ""
    return f"The AV takes {significant.pop()} time than {against}{rest}: {listed}."
