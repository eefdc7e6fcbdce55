"""Every scenario that ships can be run as it stands: the strategies of each cell can be made."""

import pytest

from harness.core.files import shipped_directory
from harness.encounter.arms import check_arms
from harness.scenario import read_scenario_file, study_of

SHIPPED = sorted(file.stem for file in shipped_directory("scenarios").glob("*.toml"))


@pytest.mark.parametrize("name", SHIPPED)
def test_each_cell_can_be_run(name: str, model) -> None:
    study = study_of(read_scenario_file(name))
    for cell in study.cells:
        check_arms(cell.scenario, model)
        # Parameters that are varied belong to the strategy that drives.
        for key, value in cell.varied.items():
            if key.startswith("strategies.") and value is not None:
                assert key.split(".")[1] == cell.scenario.arms.av
