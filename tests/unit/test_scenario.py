"""Scenario files and ``--set``: defaults, parsing, and what is said of every mistake."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from harness.core.encounter import Crossing, Vehicle
from harness.core.errors import InputError
from harness.scenario import load_scenario, read_scenario_file, validate
from harness.scenario.file import parse_setting
from tests.scenes import refusal_of

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
    scenario = validate({}, "test")
    with pytest.raises(ValueError, match="frozen"):
        scenario.ego.length_m = 4.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("ego.initial_speed_mps=8", "ego.initial_speed_mps", 8),
        ("ego.initial_speed_mps = 8.5", "ego.initial_speed_mps", 8.5),
        ("arms.av=hard_yield", "arms.av", "hard_yield"),
        ('arms.av="hard_yield"', "arms.av", "hard_yield"),
        ("pedestrians.first_at_trigger=true", "pedestrians.first_at_trigger", True),
        ("model.path=a/b=c.json", "model.path", "a/b=c.json"),
        ("model.path=", "model.path", ""),
        ("a.b=[1, 2]", "a.b", [1, 2]),
        ("experiment.seed=1_000", "experiment.seed", 1000),
    ],
)
def test_parsing_of_settings(text: str, key: str, value: object) -> None:
    setting = parse_setting(text)
    assert (setting.key, setting.value) == (key, value)
    assert type(setting.value) is type(value)


@pytest.mark.parametrize("text", ["ego.length_m", "=3", "", " = 3"])
def test_settings_that_are_none(text: str) -> None:
    with pytest.raises(InputError, match="not of the form key=value"):
        parse_setting(text)


def test_settings_are_applied_in_order_over_the_file_or_come_as_a_dictionary(tmp_path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[ego]\nlength_m = 4.0\nwidth_m = 1.5\n")
    settings = [
        parse_setting(t) for t in ("ego.length_m=6", "ego.length_m=7", "arms.av=hard_yield")
    ]
    scenario = load_scenario(file, settings)
    assert (scenario.ego.length_m, scenario.ego.width_m) == (7.0, 1.5)
    assert scenario.arms.av == "hard_yield"
    file = read_scenario_file("cctc_flow", {"ego.initial_speed_mps": 8, "experiment.pairs": 3})
    scenario = file.scenario()
    assert (scenario.ego.initial_speed_mps, scenario.experiment.pairs) == (8.0, 3)
    with pytest.raises(InputError, match=r"^settings ego.initial_speed_mps: 'fast'"):
        load_scenario("cctc", {"ego.initial_speed_mps": "fast"})
    file = tmp_path / "mine.toml"
    file.write_text('[model]\npath = "sub/m.json"\n')
    assert load_scenario(file).model.path == str((tmp_path / "sub" / "m.json").resolve())


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("[ego]\nlenght_m = 4", ["my.toml: ego.lenght_m", "unknown key", "'length_m'"]),
        ("[egos]\n", ["my.toml: egos", "unknown key", "did you mean 'ego'"]),
        ("ego = 3", ["my.toml: ego", "3", "a table"]),
        ("[ego]\nlength_m = '4'", ["ego.length_m", "'4'", "number, in m"]),
        ("[ego]\nlength_m = true", ["ego.length_m", "True", "number"]),
        ("[ego]\nlength_m = nan", ["ego.length_m", "nan", "finite"]),
        ("[ego]\ninitial_speed_mps = 0", ["ego.initial_speed_mps", "0", "greater than 0"]),
        ("[ego]\ntrigger_range_m = 1e6", ["ego.trigger_range_m", "1000000.0", "less than"]),
        ("[ego]\ntrigger_range_m = 3.4", ["ego.trigger_range_m", "3.4 m", "3.5 m"]),
        ("[ego]\nwidth_m = 5.0", ["ego.width_m", "5 m", "at most 4 m"]),
        ("[pedestrians]\nmax_count = 1.5", ["pedestrians.max_count", "1.5", "whole number"]),
        ("[pedestrians]\nbehaviour = 'fast'", ["pedestrians.behaviour", "'fast'", "reactive"]),
        ("[pedestrians]\nflow_per_hour = []", ["flow_per_hour", "[]", "a longer array"]),
        ("[pedestrians.gap_acceptance]\nmean = 3", ["gap_acceptance.mean", "'mean_s'"]),
        ("[experiment]\nstep_s = 0.0333", ["experiment.step_s", "0.0333", "milliseconds"]),
        ("[experiment]\ntimeout_s = 0.05", ["experiment.timeout_s", "0.05", "0.1"]),
        ("[arms]\nav = 3", ["arms.av", "3", "text"]),
        ("[arms]\nrobot = 'x'", ["arms.robot", "unknown key", "av, human"]),
        ("[strategies]\nsoft_yield = 3", ["strategies.soft_yield", "3", "allowed: a table"]),
    ],
)
def test_what_is_said_of_mistakes(text: str, parts: list[str]) -> None:
    refusal_of(lambda: validate(tomllib.loads(text), "my.toml", {}), *parts)


CAR = "{x_m=-8.0,length_m=4.2,width_m=1.8,"


@pytest.mark.parametrize(
    ("setting", "parts"),
    [
        ("ego.lenght_m=4", ["--set ego.lenght_m", "unknown key", "length_m"]),
        ("egos.length_m=4", ["--set", "unknown key 'egos'", "did you mean 'ego'"]),
        ("ego.length_m=long", ["--set ego.length_m", "'long'", "number"]),
        ("ego=4", ["--set ego", "4", "allowed: a table"]),
        ("ego.speed=4", ["unknown key 'speed'", "did you mean 'initial_speed_mps'"]),
        ("pedestrians.timed=4", ["--set pedestrians.timed", "4", "allowed: an array"]),
        ("pedestrians.first_at_trigger=1", ["1", "allowed: true or false"]),
        ("ego.length_m.x=4", ["--set ego.length_m.x", "not a table"]),
        ("ego..length_m=4", ["--set ego..length_m", "not a dotted key"]),
        ("ego length=4", ["--set ego length", "not a dotted key"]),
        # Accepted by itself, but it does not fit the others.
        ("ego.trigger_range_m=3", ["--set ego.trigger_range_m", "at least", "3.5 m"]),
        ("experiment.step_s=0.0123", ["--set experiment.step_s", "whole milliseconds"]),
        # In an entry of an array that the option gave.
        (f"crossing.obstacles=[{CAR}y_m=2.0}}]", ["--set crossing.obstacles.0.y_m", "ego's path"]),
        (f"crossing.obstacles=[{CAR}y_m=true}}]", ["--set crossing.obstacles.0.y_m", "True"]),
        (
            f'crossing.obstacles=[{CAR}y_m=-1.0,case="CPNA"}}]',
            ["--set crossing.obstacles.0.case", "unknown case 'CPNA'; allowed: none"],
        ),
    ],
)
def test_what_is_said_of_wrong_settings(setting: str, parts: list[str]) -> None:
    refusal_of(lambda: load_scenario("cctc", [parse_setting(setting)]), *parts)


def test_files_that_are_no_scenario(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("[ego\n")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    for path, says in (
        (broken, "not a TOML file"),
        (binary, "not a TOML file"),
        (tmp_path, "not a regular file"),
        (tmp_path / "none.toml", "No such file"),
        ("cctx", "did you mean 'cctc'"),
    ):
        with pytest.raises(InputError, match=says) as caught:
            load_scenario(path)
        assert str(path) in str(caught.value)
        assert len(str(caught.value).splitlines()) == 1
