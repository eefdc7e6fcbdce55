"""How human each reference was found to be, wherever a result is shown."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from harness.report.tables import per_cent
from harness.runs.run_data import CellResult, RunData
from harness.scenario import Scenario, load_scenario
from harness.strategies.parameters import parameters_of
from harness.strategies.registry import STRATEGIES

MEASURED_ON = "34 recorded passages of 26 vehicles (DUT)"
"""The data of ``MEASURED``: `harness validate` of DUT with these drivers, seed 1."""


@dataclass(frozen=True)
class Humanness:
    """Findings of a validation about one driver with its default parameters.

    ``remark`` says what the driver was fitted on, empty where on nothing.
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
        "its parameters were fitted to these very passages; with parameters fitted to the other "
        "vehicles the order is right for 81 %, which still flatters it, as its rules were chosen "
        "on all passages",
    ),
    "human_gmm": Humanness(
        0.684,
        7.50,
        17,
        "its model was fitted to the same recordings, each time without the vehicles that it was "
        "then compared with (five folds)",
    ),
    "human_yield": Humanness(0.623, 6.74, 11.6),
    "soft_yield": Humanness(0.501, 11.24, 12),
    "hard_yield": Humanness(0.499, 11.45, 12),
    "gap_yield": Humanness(0.620, 6.12, 10),
    "emergency_brake": Humanness(0.841, 1.40, 12),
    "constant_speed": Humanness(0.903, 1.48, 12),
}
"""Order of passing, median error of the pass time, passages with a contact (docs/validation.md)."""


def reference_lines(scenarios: Iterable[Scenario]) -> list[str]:
    """A line for each reference that drives: which one, and how human it was found."""
    lines = []
    for scenario in scenarios:
        name = scenario.arms.human
        found = MEASURED.get(name)
        if found is None or not _as_measured(scenario, name):
            own = " with these parameters" if found is not None else ""
            said = f"how human it is{own} was not measured (harness validate)"
        else:
            said = (
                f"in the place of the drivers of {MEASURED_ON}, among people who walk as "
                f"recorded, its order of passing was right for {per_cent(found.order_right, 0)} % "
                f"of them and its pass time off by {found.pass_time_off_s:.1f} s in the median; it "
                f"touched somebody in {found.contacts:g} passages, the drivers in none"
                f"{found.remark and '; ' + found.remark}"
            )
        lines.append(f"Reference {name}: {said}.")
    return list(dict.fromkeys(lines))


def keeps_its_defaults(scenario: Scenario, strategy: str) -> bool:
    """Whether a scenario leaves every parameter of a built-in strategy as it is."""
    defaults = {of.name: of.default for of in parameters_of(STRATEGIES[strategy])}
    return defaults | scenario.strategies.get(strategy, {}) == defaults


def _as_measured(scenario: Scenario, name: str) -> bool:
    """Whether the driver is the one that was validated; ``human_gmm`` is its model's."""
    own_model = (scenario.model.name, scenario.model.path) != ("dut", None)
    return keeps_its_defaults(scenario, name) and not (own_model and name == "human_gmm")


STUDIED = ("soft_yield", "hard_yield", "gap_yield", "emergency_brake")
"""Strategies that docs/study.md holds against three references, in ``_STUDIES``."""

_STUDIES = {
    "cctc": ("cctc", {}),
    "cctc_flow, 250 per hour": ("cctc_flow", {}),
    "cctc_flow, 1,000 per hour": ("cctc_flow", {"pedestrians.flow_per_hour": 1000.0}),
}
"""The scenarios of that study, with what it changed in their files."""


def known_disagreement(scenario: Scenario, time_ratio: float) -> str:
    """A warning where another shipped reference is known to say the opposite; else empty.

    In docs/study.md each of ``STUDIED`` took more time than ``human_recorded`` in every scenario,
    and less than ``human_gmm`` in ``cctc``.  Of another site, or with other
    parameters, nothing is known.

    >>> from harness.scenario import load_scenario
    >>> known_disagreement(load_scenario("cctc", {"arms.av": "gap_yield"}), 0.7)[:54]
    'the references disagree: gap_yield took more time than'
    >>> known_disagreement(load_scenario("cctc", {"ego.initial_speed_mps": 6.0}), 0.7)
    ''
    """
    av, human = scenario.arms.av, scenario.arms.human
    much, other = ("more", "human_recorded") if time_ratio < 1 else ("less", "human_gmm")
    if av not in STUDIED or human not in MEASURED or human == other:
        return ""
    where = _studied_as(scenario)
    if where is None or (much == "less" and where != "cctc"):
        return ""
    return (
        f"the references disagree: {av} took {much} time than {other} in {where} (docs/study.md), "
        "so this is not said of a human"
    )


def _studied_as(scenario: Scenario) -> str | None:
    """Which of ``_STUDIES`` a scenario is, whoever drives, and however many pairs."""
    same = _but_for_arms(scenario)
    for name, (file, changes) in _STUDIES.items():
        if _but_for_arms(load_scenario(file, changes)) == same:
            return name
    return None


def _but_for_arms(scenario: Scenario) -> Scenario:
    experiment = scenario.experiment.model_copy(update={"pairs": 1, "seed": 0})
    free = {"arms": None, "conflicts": None, "limits": None, "experiment": experiment}
    return scenario.model_copy(update=free)


def references_compared(run: RunData) -> list[str]:
    """A sentence about a run whose cells differ in the reference alone; none about others."""
    return _agreement(run.results) if tuple(run.varied_keys) == ("arms.human",) else []


def _agreement(results: Sequence[CellResult]) -> list[str]:
    """References agree where the intervals of the ratio of times lie on the same side of 1."""
    sides, parts = set(), []
    for result in results:
        ratio, name = result.summary.time_ratio, result.cell.scenario.arms.human
        if ratio.value is None or ratio.low is None or ratio.high is None:
            sides.add("untold")
            parts.append(f"{name} undefined")
            continue
        sides.add("less" if ratio.high < 1 else "more" if ratio.low > 1 else "untold")
        parts.append(f"{name} {ratio.words('.3f')}")
    said = f"ratio of times {'; '.join(parts)}"
    if {"less", "more"} <= sides:
        return [f"The references disagree on whether the AV takes less time than a human: {said}."]
    told, rest = sides - {"untold"}, "each" if "untold" not in sides else "some"
    if not told:
        return [f"No reference tells whether the AV takes less time than a human: {said}."]
    untold = "" if rest == "each" else "; of the others it is not told"
    return [f"The AV takes {told.pop()} time than {rest} of the references{untold}: {said}."]
