"""The interval of a risk holds the truth as often as it says, where the truth is known."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy import stats

from benchmarks.risk import (
    CHUNK,
    DETECTION_PROBABILITY,
    LOOKS,
    TRUTH,
    UNHINDERED,
    blind_quantiles,
    estimate,
    looks,
    runner_of,
    scenario_of,
)
from harness.core.encounter import Arm, Ending, FloatArray
from harness.core.seeding import Given
from harness.model.interaction import load_model
from harness.scenario import load_scenario
from harness.studies.risk_draws import Episode, Outcome, Run
from harness.studies.risk_space import Space, parse_event, space_of
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


BINS = 100
"""Of the quantiles of the walking speed."""

FAULTY = Space(("side", "quantile", "detection", "av_strategy", "av_strategy"))

_SIDES = (0.25, 0.75)


class Tables:
    """Scores of Hard-Yield (side, look, bin, grading), and of one that never brakes.

    An episode of the cases of ``benchmarks.risk`` with a rare fault is a function of side, quantile
    of the walking speed, look of the first detection and whether the fault strikes.  Simulated once
    for each side, look and bin of quantiles, its scores are looked up: many risks in a minute.  The
    truth is a sum over the table.
    """

    def __init__(self) -> None:
        bins = ((np.arange(BINS) + 0.5) / BINS).tolist()
        chances = looks()
        self.seen = _scores(
            "missed",
            [
                {"side": [side], "quantile": [quantile], "detection": [detection]}
                for side in _SIDES
                for detection, _ in chances
                for quantile in bins
            ],
        ).reshape(2, LOOKS, BINS, -1)
        self.dead = _scores(
            "dead-3",
            [
                {"side": [side], "quantile": [quantile], "av_strategy": [1e-9]}
                for side in _SIDES
                for quantile in bins
            ],
        ).reshape(2, BINS, -1)
        self._chance = np.array([chance for _, chance in chances])

    def dying(self, share: float) -> tuple[Run, float]:
        """Hard-Yield that is dead in a share of all episodes: episodes, and κ."""
        limit = stats.norm.ppf(share)
        missed, dead = self._missed(), float((self.dead[..., 0] <= 0).mean())
        return self._run(lambda z: z[:, 3] < limit), share * dead + (1 - share) * missed

    def blind(self) -> tuple[Run, float]:
        """Hard-Yield that does not see far-side walkers of 1.1 m/s: episodes, and κ."""
        low, high = blind_quantiles()
        place = int(BINS * (low + high) / 2)
        hit = float(self.dead[1, place, 0] <= 0)
        seen = float(self._chance @ (self.seen[1, :, place, 0] <= 0))
        kappa = self._missed() + 0.5 * (high - low) * (hit - seen)
        ends = stats.norm.ppf(low), stats.norm.ppf(high)
        return self._run(
            lambda z: (z[:, 0] > 0) & (z[:, 1] >= ends[0]) & (z[:, 1] <= ends[1])
        ), kappa

    def _missed(self) -> float:
        return float(self._chance @ (self.seen[..., 0] <= 0).mean(axis=(0, 2)))

    def _run(self, struck: Callable[[FloatArray], np.ndarray]) -> Run:
        def run(episodes: Sequence[Episode]) -> list[Outcome]:
            if not episodes:
                return []
            z = np.array([each.fixed for each in episodes])
            side = (z[:, 0] > 0).astype(int)
            place = np.minimum((BINS * stats.norm.cdf(z[:, 1])).astype(int), BINS - 1)
            # 1 − u = Φ(−z), without rounding.
            wait = np.ceil(np.log(stats.norm.cdf(-z[:, 2])) / np.log1p(-DETECTION_PROBABILITY))
            look = np.clip(wait, 1, LOOKS).astype(int) - 1
            dead, seen = self.dead[side, place], self.seen[side, look, place]
            scores = np.where(struck(z)[:, None], dead, seen).tolist()
            return [Outcome(each[0] <= 0, scores=tuple(each)) for each in scores]

        return run


def _scores(case: str, people: list[Given]) -> FloatArray:
    """Scores of a case's episodes, shape (n, gradings)."""
    runner, event = runner_of(scenario_of(case, 0)), parse_event("crashed")
    pairs = [(0, given) for given in people]
    return np.array(
        [
            event.scores(outcome.record)
            for at in range(0, len(pairs), CHUNK)
            for outcome in runner.run_arm_given(Arm.AV, pairs[at : at + CHUNK], lambda _: None)
        ]
    )


@pytest.fixture(scope="module")
def tables() -> Tables:
    return Tables()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dead-3", "dead-4", "blind"])
def test_what_is_said_of_faulty_strategies_holds(tables: Tables, name: str) -> None:
    """A strategy that is dead in a share of its own draws, and one blind to some walkers."""
    shares = {"dead-3": 1e-3, "dead-4": 1e-4}
    run, truth = tables.dying(shares[name]) if name in shares else tables.blind()
    # By quadrature and products alone (benchmarks.risk); the table's bins are a hundredth wide.
    assert truth == pytest.approx(TRUTH[name], rel=0.01)
    assert sum(is_true(found(run, FAULTY, seed), truth) for seed in range(20)) >= 19


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
