"""How near a reference is to measured drivers: the kind of scene decides, the table is shipped."""

import pytest

from harness.old.report.screens.screen import Screen, screen_lines
from harness.old.statistics import Note, Rank
from harness.old.studies.runs.nearness import nearness, scene_kind
from harness.scenario import load_scenario

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
    scene = load_scenario("cctc")
    arms = scene.arms.model_copy(update={"human": "sumo_driver"})
    own = scene.model_copy(update={"simulation": object(), "arms": arms})
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
