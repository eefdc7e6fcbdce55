"""Scenario files in; checked scenarios and the cells of a study out."""

from harness.core.vocabulary import EngineName
from harness.scenario.consistency import check_effects
from harness.scenario.file import Setting, load_scenario, read_scenario_file, validate
from harness.scenario.scenario import Scenario
from harness.scenario.study import Cell, Study, study_from, study_of

__all__ = [
    "Cell", "EngineName", "Scenario", "Setting", "Study", "check_effects", "load_scenario",
    "read_scenario_file", "study_from", "study_of", "validate",
]  # fmt: skip
