"""From ``--vary`` and ``[sweep]`` to the cells of a study."""

import itertools
import pickle
from pathlib import Path

import pytest

from harness.scenario import Study, read_scenario_file, study_from, study_of
from harness.scenario.file import parse_setting
from harness.scenario.variation import parse_variation
from tests.batches import here


def study(tmp_path: Path, text: str, *vary: str) -> Study:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return study_of(read_scenario_file(path), [parse_variation(option) for option in vary])


def document_of(found: Study) -> dict[str, object]:
    """What a manifest holds of a study."""
    cells = [cell.varied for cell in found.cells]
    return {"name": found.name, "scenario": found.base.model_dump(), "cells": cells}


@pytest.mark.parametrize(
    ("text", "values"),
    [("a.b=50,100,250", [50, 100, 250]), ("a.b=0.5, 1", [0.5, 1]), ("a.b=x=y", ["x=y"]),
     ("a.b=soft_yield,hard_yield", ["soft_yield", "hard_yield"]), ("a.b=7", [7]),
     ('a.b="x,y",z', ['"x', 'y"', "z"]), ('a.b="x,y","z"', ["x,y", "z"]),
     ("a.b=true,false", [True, False]), ("a.b=mine:Mine,exec:./it", ["mine:Mine", "exec:./it"])],
)  # fmt: skip
def test_values_of_an_option(text: str, values: list[object]) -> None:
    key, parsed = parse_variation(text)
    assert key == "a.b"
    assert parsed == values
    assert [type(value) for value in parsed] == [type(value) for value in values]


def test_the_last_key_changes_fastest(tmp_path: Path) -> None:
    found = study(tmp_path, "", "pedestrians.flow_per_hour=50,100", "arms.av=soft_yield,hard_yield")
    # The convention of nested loops, written as such.
    expected = list(itertools.product([50, 100], ["soft_yield", "hard_yield"]))
    assert [tuple(cell.varied.values()) for cell in found.cells] == expected
    assert found.varied_keys == ["pedestrians.flow_per_hour", "arms.av"]
    for cell, (flow, av) in zip(found.cells, expected, strict=True):
        assert cell.scenario.pedestrians.flow_per_hour == flow
        assert cell.scenario.arms.av == av


def test_vary_replaces_the_table_of_the_file(tmp_path: Path) -> None:
    table = "[sweep]\npedestrians.flow_per_hour = [50, 100]\narms.av = ['soft_yield', 'gap_yield']"
    # A key of the table that nothing sets has its value of the scenario, not one of the table.
    alone = study(tmp_path, "", "ego.length_m=4,5,6")
    found = study(tmp_path, table, "ego.length_m=4,5,6")
    assert found.cells == alone.cells
    assert [cell.varied for cell in found.cells] == [{"ego.length_m": x} for x in (4, 5, 6)]
    options = ("--pairs", 1, "--engine", "plain", "-q", "--out", tmp_path / "run")
    done = here("run", tmp_path / "mine.toml", "--vary", "ego.length_m=4,5", *options)
    assert done.stderr.splitlines() == ["note: --vary replaces the [sweep] of mine.toml"]


def test_cells_that_are_no_grid(tmp_path: Path) -> None:
    found = study(
        tmp_path,
        """
        [pedestrians]
        flow_per_hour = 77.0
        [[sweep.cells]]
        arms.av = "hard_yield"
        [[sweep.cells]]
        pedestrians.flow_per_hour = 500.0
        ego.initial_speed_mps = 8.0
        """,
    )
    assert [cell.varied for cell in found.cells] == [
        {"arms.av": "hard_yield", "pedestrians.flow_per_hour": 77.0, "ego.initial_speed_mps": 5.0},
        {"arms.av": "soft_yield", "pedestrians.flow_per_hour": 500.0, "ego.initial_speed_mps": 8.0},
    ]


def test_studies_come_back_from_a_manifest_and_cells_reach_a_worker(tmp_path) -> None:
    cells = ("strategies.soft_yield.p1 = 0.02", "pedestrians.max_count = 3")
    found = study(tmp_path, "\n".join(f"[[sweep.cells]]\n{cell}" for cell in cells))
    assert study_from(document_of(found), "manifest.json") == found
    assert [cell.varied for cell in study_of(read_scenario_file("cctc")).cells] == [{}]
    for cell in study(tmp_path, "", "arms.av=soft_yield,gap_yield").cells:
        assert pickle.loads(pickle.dumps(cell)) == cell


def with_settings(name: str | Path, *settings: str, vary: tuple[str, ...] = ()) -> Study:
    file = read_scenario_file(name, [parse_setting(text) for text in settings])
    return study_of(file, [parse_variation(text) for text in vary])


@pytest.mark.parametrize(
    ("name", "settings", "cells"),
    [
        # 4 strategies × 5 flows; 6 × 4; 11 shares.
        ("traffic", ["arms.av=soft_yield", "pedestrians.flow_per_hour=300"], 1),
        ("strategies", ["arms.av=mine:S", "ego.length_m=4.5"], 4),
        ("traffic", ["arms={av='soft_yield'}"], 5),
        ("penetration", ["arms.av=soft_yield"], 11),
    ],
)
def test_a_key_that_is_set_leaves_the_grid(name, settings, cells) -> None:
    found = with_settings(name, *settings)
    assert [cell.number for cell in found.cells] == list(range(cells))
    for setting in map(parse_setting, settings):
        assert setting.key not in found.varied_keys
        if setting.key == "arms.av":
            assert {cell.scenario.arms.av for cell in found.cells} == {setting.value}


def test_parameters_of_a_strategy_that_drives_nowhere_are_refused(tmp_path: Path) -> None:
    hand = "strategies.hard_yield.yield_to_waiting=true"
    # It drives in one cell of several, or the file itself gives it parameters.
    assert with_settings("cctc", hand, vary=("arms.av=hard_yield,soft_yield",)).cells
    path = tmp_path / "mine.toml"
    path.write_text("[strategies.hard_yield]\nyield_to_waiting = true\n")
    assert with_settings(path).cells
