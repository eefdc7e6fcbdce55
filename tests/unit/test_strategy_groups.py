"""Which cells of a study are comparable."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.old.studies.runs.strategy_groups import groups_over
from harness.scenario import Cell, Setting, Study
from tests.batches import one_cell, scenario_file, sweep
from tests.own_scenario import own_study


def numbers(study: Study) -> list[list[int]]:
    return [[member.cell.number for member in group.cells] for group in groups_over([study])]


def labels(study: Study) -> list[str]:
    return [member.label for group in groups_over([study]) for member in group.cells]


def test_groups_by_flow_and_by_parameters_of_either_arm() -> None:
    study = sweep(
        "cctc_flow", {}, "arms.av=soft_yield,hard_yield", "pedestrians.flow_per_hour=50,250"
    )
    assert numbers(study) == [[0, 2], [1, 3]]
    groups = groups_over([study])
    expected = [{"pedestrians.flow_per_hour": 50}, {"pedestrians.flow_per_hour": 250}]
    assert [group.shared for group in groups] == expected
    assert labels(study) == ["soft_yield", "hard_yield"] * 2
    study = sweep("cctc", {}, "strategies.soft_yield.p1=0.01,0.02")
    assert numbers(study) == [[0, 1]]
    assert labels(study) == ["soft_yield p1=0.01", "soft_yield p1=0.02"]
    study = sweep(
        "cctc",
        {},
        "arms.av=soft_yield,human_gmm",
        "strategies.human_gmm.decision_interval_s=0.5,1.0",
    )
    assert numbers(study) == [[0, 2], [1, 3]]
    assert [group.shared for group in groups_over([study])] == [
        {"strategies.human_gmm.decision_interval_s": 0.5},
        {"strategies.human_gmm.decision_interval_s": 1.0},
    ]


@pytest.mark.parametrize(
    "key", ["experiment.seed=1,2", "ego.initial_speed_mps=4,5", "arms.human=human_gmm,hard_yield"]
)
def test_anything_else_sets_cells_apart(key: str) -> None:
    study = sweep("cctc", {}, "arms.av=soft_yield,constant_speed", key)
    assert numbers(study) == [[0, 2], [1, 3]]


def test_cells_that_are_the_same_are_kept_once_with_defaults_written_out_too() -> None:
    # The parameter of a strategy that does not drive changes nothing.
    study = sweep("cctc", {}, "arms.av=soft_yield,hard_yield", "strategies.soft_yield.p1=0.01,0.02")
    (group,) = groups_over([study])
    assert [member.cell.number for member in group.cells] == [0, 1, 2]
    assert group.repeats == 1
    file = scenario_file("cctc", {})
    file.tree["strategies"] = {}
    assert file.sweep is None
    from harness.scenario import study_of

    study = study_of(file, [("strategies.soft_yield.p1", [0.0169, 0.02])])
    plain = one_cell("cctc", {})
    # The shipped file writes all three defaults out, this one leaves two to the class.
    expected = groups_over([plain])[0].cells[0].parameters
    assert groups_over([study])[0].cells[0].parameters == expected


def test_perception_of_the_av_stays_within_a_group() -> None:
    study = sweep("cctc", {}, "arms.av=soft_yield,gap_yield", "perception.latency_s=0,0.3,0.5")
    (group,) = groups_over([study])
    assert group.shared == {}
    assert labels(study)[:3] == [f"soft_yield latency_s={late}" for late in ("0", "0.3", "0.5")]
    # What differs is named where the strategies differ, too.
    other = Setting("arms.av", "gap_yield")
    late = [other, Setting("perception.latency_s", 0.5)]
    bold = [other, Setting("strategies.gap_yield.critical_gap_s", 0.0)]
    for changes, expected in (
        (late, ["soft_yield latency_s=0", "gap_yield latency_s=0.5"]),
        (bold, ["soft_yield", "gap_yield critical_gap_s=0"]),
    ):
        file = scenario_file("cctc", {})
        varied = {setting.key: setting.value for setting in changes}
        plain = file.scenario([])
        cells = (Cell(0, {"arms.av": "soft_yield"}, plain), Cell(1, varied, file.scenario(changes)))
        assert labels(replace(one_cell("cctc", {}), cells=cells)) == expected
    # The human's arm changes with it where it is shared.
    shared = sweep("cctc", {"perception.human": True}, "perception.latency_s=0,0.3")
    assert numbers(shared) == [[0], [1]]


def test_the_outputs_that_a_run_keeps_set_no_cells_apart(tmp_path: Path) -> None:
    none, kept = (own_study(tmp_path, simulation__outputs=names) for names in ([], ["tripinfo"]))
    (group,) = groups_over([none, kept], ["none", "kept"])
    assert [member.label for member in group.cells] == ["gap_yield (none)", "gap_yield (kept)"]
