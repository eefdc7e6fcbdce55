"""Judges an automated vehicle's strategy at an unsignalized crosswalk, in SUMO.

What is named here is the public interface (docs/python.md); everything else may change.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.batch.experiment import resume as resume, run_study as run_study
    from harness.batch.finish import Run as Run
    from harness.conformance import check_strategy as check_strategy
    from harness.encounter import (
        Crossing as Crossing,
        EgoView as EgoView,
        Observation as Observation,
        PedestrianView as PedestrianView,
        Side as Side,
        Strategy as Strategy,
        Vehicle as Vehicle,
    )
    from harness.errors import HarnessError as HarnessError, InputError as InputError
    from harness.interaction import InteractionModel as InteractionModel, load_model as load_model
    from harness.report import figures as figures
    from harness.review.compare import compare as compare
    from harness.review.comparisons import RunComparison as RunComparison
    from harness.review.run_data import RunData as RunData, load_run as load_run
    from harness.rl import CrosswalkEnv as CrosswalkEnv, Transition as Transition
    from harness.scenario import (
        Options as Options,
        Precision as Precision,
        Scenario as Scenario,
        Setting as Setting,
        Study as Study,
        load_scenario as load_scenario,
        parse_variation as parse_variation,
        read_scenario_file as read_scenario_file,
        single_cell as single_cell,
        study_of as study_of,
    )
    from harness.strategies.vector import observation_vector as observation_vector

_HOME = {
    "harness.batch.experiment": ("resume", "run_study"),
    "harness.batch.finish": ("Run",),
    "harness.conformance": ("check_strategy",),
    "harness.encounter": (
        "Crossing",
        "EgoView",
        "Observation",
        "PedestrianView",
        "Side",
        "Strategy",
        "Vehicle",
    ),
    "harness.errors": ("HarnessError", "InputError"),
    "harness.interaction": ("InteractionModel", "load_model"),
    "harness.report": ("figures",),
    "harness.review.compare": ("compare",),
    "harness.review.comparisons": ("RunComparison",),
    "harness.review.run_data": ("RunData", "load_run"),
    "harness.rl": ("CrosswalkEnv", "Transition"),
    "harness.scenario": (
        "Options",
        "Precision",
        "Scenario",
        "Setting",
        "Study",
        "load_scenario",
        "parse_variation",
        "read_scenario_file",
        "single_cell",
        "study_of",
    ),
    "harness.strategies.vector": ("observation_vector",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for: `harness --help` waits for no pandas."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'harness' has no attribute {name!r}")
    module = import_module(_MODULE_OF[name])
    found = import_module("harness.report.figures") if name == "figures" else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
