"""Scenario files in; checked scenarios and the cells of a study out."""

from harness.scenario.consistency import remarks
from harness.scenario.file import (
    ScenarioFile,
    Setting,
    load_scenario,
    parse_setting,
    read_scenario_file,
    scenario_of_encounters,
    set_thresholds,
    validate,
)
from harness.scenario.options import (
    EngineName,
    engine_named,
)
from harness.scenario.people import (
    GapAcceptanceSection,
    PedestriansSection,
    ThresholdSection,
    WalkingSpeedSection,
)
from harness.scenario.scenario import Scenario
from harness.scenario.sections import (
    ConflictsSection,
    ExperimentSection,
    PerceptionSection,
    SimulationSection,
)
from harness.scenario.study import (
    Cell,
    Study,
    as_written,
    study_from,
    study_of,
)
from harness.scenario.traffic import QUARTER_S, TrafficSection, by_quarter
from harness.scenario.variation import flatten, parse_variation

__all__ = [
    "QUARTER_S",
    "Cell",
    "ConflictsSection",
    "EngineName",
    "ExperimentSection",
    "GapAcceptanceSection",
    "PedestriansSection",
    "PerceptionSection",
    "Scenario",
    "ScenarioFile",
    "Setting",
    "SimulationSection",
    "Study",
    "ThresholdSection",
    "TrafficSection",
    "WalkingSpeedSection",
    "as_written",
    "by_quarter",
    "engine_named",
    "flatten",
    "load_scenario",
    "parse_setting",
    "parse_variation",
    "read_scenario_file",
    "remarks",
    "scenario_of_encounters",
    "set_thresholds",
    "study_from",
    "study_of",
    "validate",
]
