"""Scenario files and ``--set``: defaults, parsing, and what is said of every mistake."""

import json
from typing import Any

import numpy as np
import pytest

from harness.core.vocabulary import Crossing, Vehicle
from harness.scenario import load_scenario, read_scenario_file, study_of, validate
from harness.scenario.file import parse_setting

PAPER: dict[str, dict[str, Any]] = {
    "crossing": {"bearing_deg": 316.5, "length_m": 9.0, "width_m": 4.0},
    "ego": {"initial_speed_mps": 5.0, "trigger_range_m": 30.0, "resume_acceleration_mps2": 1.0},
    "pedestrians": {"max_count": 1, "first_at_trigger": True, "near_side_share": 0.5},
    "arms": {"av": "soft_yield", "human": "human_gmm"},
    "strategies": {"soft_yield": {"p1": 0.0169, "p2": -0.13986, "p3": 0.010115}},
}
"""Table II of the paper."""


def test_the_papers_scenario() -> None:
    found = load_scenario("cctc").model_dump()
    for section, values in PAPER.items():
        assert {key: found[section][key] for key in values} == values


def test_constants_for_strategies_of_an_immutable_scenario() -> None:
    scenario = validate({"ego": {"trigger_range_m": 42.0}}, "test")
    # Detection as far as the trigger, unless said otherwise.
    assert scenario.vehicle() == Vehicle(5.0, 42.0, 42.0, 5.0, 1.8, 3.0, 4.5, 1.0)
    assert scenario.crosswalk() == Crossing(9.0, 4.0, 2.25, 4.5, 0, 5.0)
    assert scenario.crosswalk().stop_line_m == 3.0
    seen = validate({"ego": {"detection_range_m": 12.0}}, "test").vehicle()
    assert (seen.trigger_range_m, seen.detection_range_m) == (30.0, 12.0)
    with pytest.raises(ValueError, match="frozen"):
        scenario.ego.length_m = 4.0
    with pytest.raises(TypeError, match="mappingproxy"):
        scenario.strategies["soft_yield"] = {}  # type: ignore[index]


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [("ego.initial_speed_mps = 8.5", "ego.initial_speed_mps", 8.5), ("a.b=[1, 2]", "a.b", [1, 2]),
     ("arms.av=hard_yield", "arms.av", "hard_yield"), ("model.path=", "model.path", ""),
     ('arms.av="hard_yield"', "arms.av", "hard_yield"), ("a.b=a/b=c.json", "a.b", "a/b=c.json"),
     ("a.b=true", "a.b", True), ("experiment.seed=1_000", "experiment.seed", 1000)],
)  # fmt: skip
def test_parsing_of_settings(text: str, key: str, value: object) -> None:
    setting = parse_setting(text)
    assert (setting.key, setting.value) == (key, value)
    assert type(setting.value) is type(value)


def test_settings_are_applied_in_order_over_the_file_or_come_as_a_dictionary(tmp_path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[ego]\nlength_m = 4.0\nwidth_m = 1.5\n")
    settings = [*map(parse_setting, ("ego.length_m=6", "ego.length_m=7", "arms.av=hard_yield"))]
    scenario = load_scenario(path, settings)
    assert (scenario.ego.length_m, scenario.ego.width_m) == (7.0, 1.5)
    assert scenario.arms.av == "hard_yield"
    scenario = load_scenario("cctc_flow", {"ego.initial_speed_mps": 8, "experiment.pairs": 3})
    assert (scenario.ego.initial_speed_mps, scenario.experiment.pairs) == (8.0, 3)
    path.write_text('[model]\npath = "sub/m.json"\n')
    assert load_scenario(path).model.path == str((tmp_path / "sub" / "m.json").resolve())


def test_numbers_and_arrays_of_numpy_are_numbers() -> None:
    settings: dict[str, Any] = {"experiment.pairs": np.int64(7)}
    settings |= {"ego.initial_speed_mps": np.float32(8.0), "experiment.seed": np.arange(3)[2]}
    settings |= {"model.extrapolate": np.True_}
    plain = {key: value.item() for key, value in settings.items()}
    assert load_scenario("cctc_flow", settings) == load_scenario("cctc_flow", plain)
    flows: Any = [("pedestrians.flow_per_hour", np.linspace(100, 300, 3))]
    varied = [dict(cell.varied) for cell in study_of(read_scenario_file("cctc_flow"), flows).cells]
    assert json.dumps(varied[2]) == '{"pedestrians.flow_per_hour": 300.0}'
