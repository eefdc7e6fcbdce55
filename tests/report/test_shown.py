"""What a strategy was shown, on the page: from the traces to the player's squares."""

import json
from pathlib import Path

import numpy as np
import pytest

from harness.old.report.drawing.episode_figures import time_advantage
from harness.old.report.pages.player import run_player
from harness.old.studies.runs.opening import load_run
from harness.old.studies.runs.shown import shown_pairs
from tests.batches import one_cell, run_inline

LATE = {
    "experiment.pairs": 3,
    "arms.av": "gap_yield",
    "perception.latency_s": 0.4,
    "crossing.obstacles": [{"x_m": -6.0, "y_m": -2.0, "length_m": 4.0, "width_m": 1.0}],
}


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("late") / "run"
    return run_inline(one_cell("cctc", LATE), folder, traces=True).path


def test_squares_follow_the_people_by_the_latency(late: Path) -> None:
    run = load_run(late)
    player = run_player(run, shown_pairs(run))
    json.dumps(player.episodes, allow_nan=False)
    assert player.scenes["0"]["obstacles"] == [[-8, -4, -2.5, -1.5]]
    for episode in json.loads(player.json)["episodes"]:
        # Nothing is late for the human, who only sees past the obstacle.
        for arm, late_s in zip(episode["arms"], (0.4, 0.0), strict=True):
            (walker,) = arm["walkers"]
            for square in arm["shown"]:
                times_s = np.array(square["t"]) - late_s
                there = np.interp(times_s, walker["t"], walker["y"])
                assert square["y"] == pytest.approx(there, abs=2e-3)
        (square,) = episode["arms"][0]["shown"]
        assert len(square["t"]) > 20


def test_the_time_advantage_is_that_of_the_people_not_of_what_was_shown(late: Path) -> None:
    run = load_run(late)
    rows = run.traces_of(0, 0)
    rows = rows[rows["arm"] == "av"]
    people = rows[~rows["object"].str.startswith("shown-")]
    assert len(people) < len(rows)
    crossing = run.scenario_of(0).crosswalk()
    np.testing.assert_array_equal(time_advantage(rows, crossing), time_advantage(people, crossing))
