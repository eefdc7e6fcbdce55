"""Fixed people and a driver without chance: all pairs repeat one episode, which is no sample."""

from pathlib import Path

import pytest

from harness.old.report.screens.result_screen import screen_of
from harness.old.report.screens.screen import screen_lines
from harness.old.studies.kinds.tasks import Task
from harness.old.studies.runs.opening import load_run
from harness.old.studies.runs.reported import reported
from harness.old.studies.runs.run_data import RunData
from tests.batches import sweep
from tests.made_up import Fate, made_up

BOUND = 1 - 0.025 ** (1 / 30)
"""Clopper and Pearson's upper bound of 0 of 30; that of 30 of 30 is the lower one, 1 − BOUND."""

ONE_SIDED = "0 crashes in a tested cell: the rate is below 9.5 %"
"""1 − 0.05^(1/30) = 0.095."""


def driven(folder: Path, name: str, changes: dict[str, object], last_s: float = 8.0) -> RunData:
    """30 pairs: the AV takes 8 s, and ``last_s`` in the last one; the reference crashes."""

    def fates(_task: Task, pair: int) -> tuple[Fate, Fate]:
        return (last_s if pair == 29 else 8.0), "crashed"

    keys = {"experiment.pairs": 30, "arms.av": "gap_yield", "arms.human": "constant_speed"}
    study = sweep(name, {**keys, **changes}, "ego.initial_speed_mps=5")
    return load_run(made_up(folder, study, fates))


def screen(run: RunData) -> str:
    return " ".join(" ".join(screen_lines(screen_of(reported(run)))).split())


@pytest.mark.parametrize(
    ("changes", "last_s", "sampled"),
    [
        ({}, 8.0, False),
        ({"perception.latency_s": 0.3}, 8.0, False),
        # One episode differs, the AV draws random numbers, or its sensor does.
        ({}, 8.5, True),
        ({"arms.av": "human_yield"}, 8.0, True),
        ({"perception.detection_probability": 0.999}, 8.0, True),
        # Nobody knows what a user's own strategy draws.
        ({"arms.av": "tests.planner:Planner"}, 8.0, True),
    ],
)
def test_repetitions_of_one_episode_have_no_interval(
    tmp_path: Path, changes: dict[str, object], last_s: float, sampled: bool
) -> None:
    run = driven(
        tmp_path / "run",
        "euro_ncap_vru",
        {"pedestrians.timed_case": "CPNA-25", **changes},
        last_s,
    )
    (result,), text = run.results, screen(run)
    crashes, missed = (result.findings[name] for name in ("kappa", "kappa_all"))
    assert (crashes.value, crashes.events, crashes.n) == (0.0, 0, 30)
    for found in (crashes, missed):
        limits = (0.0, pytest.approx(BOUND)) if sampled else (None, None)
        assert (found.low, found.high) == limits
    human = result.findings["kappa_human"]
    assert (human.value, human.low, human.high) == (1.0, None, None)
    assert (ONE_SIDED in text) == sampled
    both = "All 30 episodes of the AV and of constant_speed are the same: more pairs add nothing."
    one = "All 30 episodes of constant_speed are the same: more pairs add nothing about it."
    assert (one if sampled else both) in text
    assert ("Few pairs" in text) == sampled


def test_equal_episodes_with_people_who_come_at_random_keep_their_intervals(tmp_path: Path) -> None:
    run = driven(tmp_path / "run", "cctc_flow", {})
    (result,), text = run.results, screen(run)
    crashes, human = (result.findings[name] for name in ("kappa", "kappa_human"))
    assert (crashes.low, crashes.high) == (0.0, pytest.approx(BOUND))
    assert (human.low, human.high) == (pytest.approx(1 - BOUND), 1.0)
    assert ONE_SIDED in text
    assert "are the same" not in text
