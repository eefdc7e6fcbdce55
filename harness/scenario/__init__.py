"""What is to be run: scenario files, the cells of a study, and how a run is carried out."""

from harness.scenario.file import (
    ScenarioFile,
    Setting,
    load_scenario,
    parse_setting,
    read_scenario_file,
    validate,
)
from harness.scenario.options import Options, Precision, hang_limit_s
from harness.scenario.sections import (
    ConflictsSection,
    ExperimentSection,
    GapAcceptanceSection,
    PedestriansSection,
    Scenario,
)
from harness.scenario.study import Cell, Study, parse_variation, single_cell, study_from, study_of

__all__ = [
    "Cell",
    "ConflictsSection",
    "ExperimentSection",
    "GapAcceptanceSection",
    "Options",
    "PedestriansSection",
    "Precision",
    "Scenario",
    "ScenarioFile",
    "Setting",
    "Study",
    "hang_limit_s",
    "load_scenario",
    "parse_setting",
    "parse_variation",
    "read_scenario_file",
    "single_cell",
    "study_from",
    "study_of",
    "validate",
]
