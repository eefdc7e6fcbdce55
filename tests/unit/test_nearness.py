"""How near a reference is to measured drivers: the kind of scene decides, the table is shipped."""

import math

import numpy as np
import pytest

from harness.report.screens.screen import Screen, screen_lines
from harness.scenario import Setting, load_scenario
from harness.statistics import Note, Rank
from harness.studies.runs.nearness import (
    FIRST_OFF,
    RESPONDING,
    WAITS_OFF,
    nearness,
    scene_kind,
)
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
        ("cctc_flow", {"pedestrians.behaviour": "gap_acceptance"}, "flow", "waits are off by −1."),
        (
            "cctc_flow",
            {"pedestrians.behaviour": "threshold", "pedestrians.kerb_wait_s": 0.0},
            "flow",
            "waits are off by +4.2 s",
        ),
        ("field_sites", {}, "flow", "waits are off by"),
    ],
)
def test_the_kind_of_scene_decides_what_a_reference_is_held_against(
    name: str, settings: dict[str, object], kind: str, words: str
) -> None:
    """At the sites each yield rate is the site's own; the shipped hours' drivers respond late."""
    scenario = load_scenario(name, YIELDS | settings)
    assert scene_kind(scenario) == kind
    line = nearness(scenario)
    assert line.startswith("human_yield ")
    assert words in line


NOT_HELD = "was not held against real drivers in such scenes"
CROWDS = "in crowds (DUT): order right for 62 %."


@pytest.mark.parametrize(
    ("name", "settings", "line"),
    [
        # Drivers and people with other settings, people who do not wait, people who do not decide.
        ("cctc", {"arms.human": "sumo_driver"}, f"sumo_driver {NOT_HELD}."),
        ("cctc", {"strategies.human_yield.yield_rate": 0.5},
         f"human_yield with these settings {NOT_HELD}; with its defaults {CROWDS}"),
        ("cctc", {"pedestrians.threshold.factor": 0.5}, f"human_yield {NOT_HELD}; {CROWDS}"),
        ("cctc", {"pedestrians.behaviour": "constant", "pedestrians.kerb_wait_s": 0.0},
         f"human_yield {NOT_HELD}; {CROWDS}"),
        ("euro_ncap_vru", {}, f"human_yield {NOT_HELD}; {CROWDS}"),
        ("traffic", {"strategies.human_yield.reaction_time_s": 1.2},
         f"human_yield with these settings {NOT_HELD}; with its defaults at 12 measured "
         "site-periods: pedestrians' waits are off by +4.2 s, R² −5.66 (1: exact, 0: a constant)."),
    ],
)  # fmt: skip
def test_what_was_not_measured_is_said(name: str, settings: dict[str, object], line: str) -> None:
    one = {"pedestrians.behaviour": "threshold"} if name == "cctc" else {}
    assert nearness(load_scenario(name, YIELDS | one | settings)) == line


def test_in_a_users_own_simulation_the_nearest_scene_has_sumos_pedestrians() -> None:
    own = load_scenario("cctc", {"arms.human": "sumo_driver"}).model_copy(
        update={"simulation": object()}
    )
    assert nearness(own) == (
        f"sumo_driver {NOT_HELD}; at a measured zebra: the share of pedestrians who go first is "
        "off by 0.10."
    )


def test_only_what_was_left_out_comes_before_the_line() -> None:
    first = [Note(Rank.FAILURES, "Failures."), Note(Rank.LEFT_OUT, "Left out.")]
    later = [Note(rank, f"{rank.name} {n}.") for rank in Rank for n in (1, 2, 3)]
    notes = [*first, *(note for note in later if note.rank >= Rank.NEARNESS)]
    screen = Screen("a against b", "2 pairs", ("", "AV"), (), tuple(notes), "All: --full.")
    lines = screen_lines(screen)
    assert lines.index("! Left out.") + 1 == lines.index("! NEARNESS 1.")
    assert "! REFERENCE 1." not in lines


@pytest.mark.slow
def test_the_shipped_table_is_what_the_command_gives() -> None:
    for behaviour, drivers in FIRST_OFF.items():
        trials = 100 if behaviour == "sumo" else 500
        findings = validate_people(behaviour, list(drivers), trials=trials, hours=0)
        given = {
            held.driver: round(held.scores.mean_absolute_error, 3)
            for held in findings.held
            if held.driver and held.scores is not None
        }
        assert given == drivers


@pytest.mark.slow
@pytest.mark.parametrize("behaviour", WAITS_OFF)
def test_the_shipped_waits_are_met_again_by_other_people_and_vehicles(behaviour: str) -> None:
    """Within three standard errors: of both numbers for the mean error, of these hours for R².

    With standard errors s of the sites' means, that of the mean error is √Σ s²/12; to first order
    that of R² is 2 √Σ (error s)²/Σ (measured − mean)².
    """
    for driver, shipped in WAITS_OFF[behaviour].items():
        name, *responds = driver.split(", ")
        settings = [
            Setting(f"strategies.{name}.{key}", value, "test")
            for key, value in RESPONDING.items()
            if responds
        ]
        findings = validate_people(behaviour, [name], settings, trials=1, hours=2, seed=2)
        (held,) = (held for held in findings.held if held.experiment.key == "waits")
        assert held.scores is not None
        measured = np.array([row.measured for row in held.rows], dtype=float)
        errors = np.array([row.simulated for row in held.rows], dtype=float) - measured
        spread = np.array([row.standard_error for row in held.rows], dtype=float)
        mean_error_s = math.hypot(np.linalg.norm(spread) / len(spread), shipped.mean_error_s)
        assert held.scores.mean_error == pytest.approx(shipped.mean_s, abs=3 * mean_error_s)
        r2_error = 2 * np.linalg.norm(errors * spread) / ((measured - measured.mean()) ** 2).sum()
        assert held.scores.r2 == pytest.approx(
            shipped.r2, abs=3 * math.hypot(r2_error, shipped.r2_error)
        )
