"""Every scenario that ships can be run as it stands: the strategies of each cell can be made."""

import pytest

from harness.episode.arms import check_arms
from harness.resources import shipped_directory
from harness.scenario import read_scenario_file, single_cell, study_of

CELLS = {"cctc": 1, "cctc_flow": 1, "euro_ncap_vru": 27, "aggressiveness": 16, "strategies": 28}


def test_no_scenario_is_left_out() -> None:
    shipped = {file.stem for file in shipped_directory("scenarios").glob("*.toml")}
    assert shipped == set(CELLS)


@pytest.mark.parametrize("name", list(CELLS))
def test_each_cell_can_be_run(name: str, model) -> None:
    file = read_scenario_file(name)
    study = single_cell(file) if file.sweep is None else study_of(file, [])
    assert len(study.cells) == CELLS[name]
    driven = set()
    for cell in study.cells:
        assert cell.scenario.model.name == study.base.model.name
        check_arms(cell.scenario, model)
        # Parameters that are varied belong to the strategy that drives.
        for key, value in cell.varied.items():
            if key.startswith("strategies.") and value is not None:
                assert key.split(".")[1] == cell.scenario.arms.av
        driven.add(repr(cell.scenario))
    assert len(driven) == len(study.cells)


def test_all_strategies_meet_all_flows() -> None:
    from harness.strategies.registry import STRATEGIES

    cells = study_of(read_scenario_file("strategies"), []).cells
    assert {cell.scenario.arms.av for cell in cells} == set(STRATEGIES)
    assert len({cell.scenario.pedestrians.flow_per_hour for cell in cells}) * len(
        STRATEGIES
    ) == len(cells)
