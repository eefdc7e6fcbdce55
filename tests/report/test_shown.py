"""What a strategy was shown, on the page: from the traces to the player's squares."""

import json
from pathlib import Path

import numpy as np
import pytest

from harness.report.episode_figures import time_advantage
from harness.report.episode_traces import choose_pairs, shown_pairs
from harness.report.player_data import player_document
from harness.runs.opening import load_run
from harness.scenario import Options
from tests.batches import one_cell
from tests.report.conftest import simulate

LATE = {
    "experiment.pairs": 3,
    "arms.av": "gap_yield",
    "perception.latency_s": 0.4,
    "crossing.obstacles": [{"x_m": -6.0, "y_m": -2.0, "length_m": 4.0, "width_m": 1.0}],
}


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("late") / "run"
    return simulate(one_cell("cctc", LATE), folder, Options(traces=True))


def test_squares_follow_the_people_by_the_latency(late: Path) -> None:
    run = load_run(late)
    chosen = choose_pairs(run)
    document = player_document(run, chosen, shown_pairs(run, chosen))
    json.dumps(document, allow_nan=False)
    assert document["scenes"]["0"]["obstacles"] == [[-8, -4, -2.5, -1.5]]
    for episode in document["episodes"]:
        av, human = episode["arms"]
        (walker,), (square,) = av["walkers"], av["shown"]
        true = dict(zip(range(walker["from"], len(av["t"])), walker["y"], strict=False))
        # Told four steps late, for as long as they are at the crosswalk.
        told = dict(zip(square["at"], square["y"], strict=True))
        assert len(told) > 20
        assert all(told[k] == pytest.approx(true[k - 4], abs=2e-3) for k in told)
        # Nothing is late for the human, who only sees past the obstacle.
        for shown in human["shown"]:
            (walker,) = human["walkers"]
            true = dict(zip(range(walker["from"], len(human["t"])), walker["y"], strict=False))
            for k, y in zip(shown["at"], shown["y"], strict=True):
                assert y == pytest.approx(true[k], abs=2e-3)


def test_the_time_advantage_is_that_of_the_people_not_of_what_was_shown(late: Path) -> None:
    run = load_run(late)
    rows = run.traces_of(0, 0)
    rows = rows[rows["arm"] == "av"]
    people = rows[~rows["object"].str.startswith("shown-")]
    assert len(people) < len(rows)
    crossing = run.scenario_of(0).crosswalk()
    np.testing.assert_array_equal(time_advantage(rows, crossing), time_advantage(people, crossing))
