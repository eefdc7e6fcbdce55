"""The interval of a risk holds the truth as often as it says, where the truth is known."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from scipy import stats

from benchmarks.risk import (
    CHUNK,
    UNHINDERED,
    estimate,
)
from harness.core.encounter import Arm, Ending
from harness.model.interaction import load_model
from harness.scenario import load_scenario
from harness.studies.risk_draws import Episode, Outcome
from harness.studies.risk_space import Space, space_of
from tests.risks import CROWD, FLAT, crowd, fault, found, gain, half_space, holds, is_true, union
from tests.scenes import on_plain


@pytest.mark.slow
@pytest.mark.parametrize("p", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize(("case", "space"), [(half_space, FLAT), (union, FLAT), (crowd, CROWD)])
def test_the_interval_covers_and_costs_less_than_brute_force(case, space: Space, p: float) -> None:
    run, truth = case(p)
    said = [found(run, space, seed) for seed in range(50)]
    estimates = [numbers["probability"].value or 0.0 for numbers in said]
    held = sum(holds(numbers, truth) for numbers in said)
    assert held >= (0.93 * 50 if case is crowd else stats.binom.ppf(0.001, 50, 0.95))
    error = np.std(estimates) / math.sqrt(50)
    assert abs(np.mean(estimates) - truth) < 3.5 * error
    assert np.median([gain(numbers) for numbers in said[:10]]) >= {1e-2: 0, 1e-4: 5, 1e-6: 50}[p]
    for numbers in said:
        brute_force = numbers["brute_force_episodes"].count
        assert numbers["episodes"].count <= 1.15 * brute_force + 10_000


@pytest.mark.slow
@pytest.mark.parametrize("share", [1e-3, 1e-4])
def test_what_is_said_holds_where_the_learning_misses_a_fault(share: float) -> None:
    run, truth = fault(share)
    said = [found(run, FLAT, seed) for seed in range(40)]
    assert sum(is_true(numbers, truth) for numbers in said) >= stats.binom.ppf(0.001, 40, 0.95)
    # The interval alone is that of the ways found, and says no more.
    assert sum(holds(numbers, truth) for numbers in said) < 0.95 * 40


_SIDES = (0.25, 0.75)


def test_the_interval_covers_the_kappa_of_constant_speed() -> None:
    """Episodes are a function of two uniforms, and looked up on a grid of them."""
    scenario = load_scenario("cctc", {"arms.av": "constant_speed"})
    space, runner = space_of(scenario, Arm.AV), on_plain(scenario, load_model("dut"))
    assert space.fixed == ("side", "quantile")
    grid = ((np.arange(400) + 0.5) / 400).tolist()
    cases = [(0, {"side": [side], "quantile": [q]}) for side in _SIDES for q in grid]
    hits = [
        outcome.record.ending is Ending.CRASHED
        for at in range(0, len(cases), CHUNK)
        for outcome in runner.run_arm_given(Arm.AV, cases[at : at + CHUNK], lambda _: None)
    ]
    crashed = np.array(hits).reshape(2, 400)
    assert crashed.mean() == pytest.approx(UNHINDERED, abs=2 / 400)

    def run(episodes: Sequence[Episode]) -> list[Outcome]:
        u = stats.norm.cdf([each.fixed for each in episodes]) if episodes else np.empty((0, 2))
        ends = crashed[(u[:, 0] >= 0.5).astype(int), (400 * u[:, 1]).astype(int)]
        return [Outcome(bool(end)) for end in ends]

    held = sum(holds(found(run, space, seed), crashed.mean()) for seed in range(100))
    assert held >= stats.binom.ppf(0.001, 100, 0.95)


@pytest.mark.slow
def test_a_crash_that_needs_several_people_takes_a_fifth_of_brute_force() -> None:
    """The reference is by brute force with other streams: ``benchmarks.risk reference late-3``."""
    row = estimate("late-3", 3, 0.1)
    truth, error = 66 / 600_000, math.sqrt(66) / 600_000
    mine = row["coefficient_of_variation"] * row["probability"]
    assert abs(row["probability"] - truth) < 3 * math.hypot(error, mine)
    assert row["weighted"]
    assert row["episodes"] < row["brute_force_episodes"] / 5
