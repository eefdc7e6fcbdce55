"""How near a reference is to measured drivers: the kind of scene decides, the table is shipped."""

import pytest

from harness.scenario import load_scenario
from harness.studies.runs.nearness import FIRST_OFF, nearness, scene_kind
from harness.studies.validation.people import validate_people

YIELDS = {"arms.human": "human_yield"}


@pytest.mark.parametrize(
    ("name", "settings", "kind", "words"),
    [
        (
            "cctc_flow",
            {"pedestrians.flow_per_hour": 1500.0},
            "crowd",
            "(DUT): order of passing right for 62 %",
        ),
        (
            "cctc",
            {"pedestrians.behaviour": "threshold"},
            "one pedestrian",
            "go first is off by 0.15.",
        ),
        ("cctc_flow", {"pedestrians.behaviour": "gap_acceptance"}, "flow", "waits are off by −1.2"),
        ("cctc_flow", {"pedestrians.behaviour": "threshold"}, "flow", "waits are off by +4.4 s"),
        ("field_sites", {}, "flow", "waits are off by"),
    ],
)
def test_the_kind_of_scene_decides_what_a_reference_is_held_against(
    name: str, settings: dict[str, object], kind: str, words: str
) -> None:
    defaults = {} if name != "field_sites" else {"strategies.human_yield.yield_rate": 0.74}
    scenario = load_scenario(name, YIELDS | settings | defaults)
    assert scene_kind(scenario) == kind
    line = nearness(scenario)
    assert line.startswith("human_yield ")
    assert words in line


def test_nothing_is_said_of_what_was_not_measured() -> None:
    one = {"pedestrians.behaviour": "threshold"}
    for settings in (
        {"arms.human": "sumo_driver"},
        {"arms.human": "human_gmm", "model.name": "dut-k10"},
        YIELDS | {"strategies.human_yield.yield_rate": 0.5},
        YIELDS | {"pedestrians.behaviour": "reactive"},
    ):
        assert nearness(load_scenario("cctc", one | settings)) == ""


@pytest.mark.slow
def test_the_shipped_table_is_what_the_command_gives() -> None:
    for behaviour, drivers in FIRST_OFF.items():
        findings = validate_people(behaviour, list(drivers), trials=500, hours=0)
        given = {
            held.driver: round(held.scores.mean_absolute_error, 3)
            for held in findings.held
            if held.driver and held.scores is not None
        }
        assert given == drivers
