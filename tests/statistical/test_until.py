"""``--until``: looking again and again must not spoil the interval that is reported at the end.

Whole experiments are simulated on a population of which the truth is known; the procedure that
decides when to stop is the program's own, its episodes come from the population.
"""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from benchmarks.coverage import population
from harness.scenario import Options, Precision, Study
from harness.statistics import ENCOUNTERS, Interval, bootstrap, summary
from harness.store import summaries as looking
from harness.store.schemas import EPISODES
from harness.store.summaries import confidence_of, looks, pair_columns, summarise_cell
from harness.studies.batch.plan import Plan
from harness.studies.batch.until import reach_precision
from tests.batches import one_cell


class Drawn:
    """Stands for a run folder and for the work on it: its pairs are draws from a population."""

    def __init__(self, tau: np.ndarray, crashed: np.ndarray) -> None:
        self.tau, self.crashed = tau, crashed
        self.pairs = 0
        self.looks: list[int] = []

    def reach(self, goals: dict[int, int]) -> None:
        self.pairs = goals[0]
        self.looks.append(self.pairs)

    def episodes_of(self, _cell: int) -> pa.Table:
        n = self.pairs
        av = np.arange(2 * n) % 2 == 0
        crashed = np.repeat(self.crashed[:n], 2) & av
        times = np.where(av, np.repeat(self.tau[:n], 2), 1.0)
        columns: dict[str, Any] = {
            "arm": np.where(av, "av", "human"),
            "ending": np.where(crashed, "crashed", "crossed"),
            "pass_time_s": pa.array(times, mask=crashed),
            "fallback": np.zeros(2 * n, dtype=bool),
            "pedestrians": (np.repeat(self.tau[:n], 2) != 1.0).astype(np.int32),
            "pair": np.repeat(np.arange(n), 2),
        }
        whole = [
            pa.array(columns[field.name]).cast(field.type)
            if field.name in columns
            else pa.nulls(2 * n, field.type)
            for field in EPISODES
        ]
        return pa.table(whole, schema=EPISODES)


def study_of(pairs: int, seed: int) -> Study:
    # The seed keys the resampling: every experiment has its own.
    return one_cell("cctc", {"experiment.pairs": pairs, "experiment.seed": seed})


def stopped(
    tau: np.ndarray, crashed: np.ndarray, until: Precision, pairs: int, seed: int
) -> tuple[Interval, list[int]]:
    """The interval at the end of one experiment, and the numbers of pairs it looked at."""
    study, options = study_of(pairs, seed), Options(until=until)
    work = Drawn(tau, crashed)
    reach_precision(Plan(study, {}, options, {}), until, work.reach, work.episodes_of)
    cell, confidence = study.cells[0], confidence_of(study, options)
    found = summarise_cell(work.episodes_of(0), cell, confidence)
    return getattr(found, until.measure), work.looks


def enough(holds: int, trials: int) -> bool:
    """Whether that many hits are believable of a coverage of 95 % (one-sided, 1 in 1,000)."""
    return holds >= int(stats.binom.ppf(0.001, trials, 0.95))


def contains(interval: Interval, truth: float) -> bool:
    assert interval.low is not None
    assert interval.high is not None
    return interval.low <= truth <= interval.high


def test_looks_double_and_each_spends_its_share_of_the_error() -> None:
    assert looks(20_000) == [1_000, 2_000, 4_000, 8_000, 16_000, 20_000]
    assert looks(4_000) == [1_000, 2_000, 4_000]
    assert looks(1_000) == [1_000]
    assert looks(50) == [50]
    options = Options(until=Precision("mu", 0.01))
    # Bonferroni: 5 % shared by 6 looks.
    assert confidence_of(study_of(20_000, 1), options) == pytest.approx(1 - 0.05 / 6)
    assert confidence_of(study_of(20_000, 1), Options()) == 0.95


@pytest.mark.parametrize("trials", [30, pytest.param(120, marks=pytest.mark.slow)])
def test_mean_of_made_up_ratios(trials: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(looking, "FIRST_LOOK", 100)
    monkeypatch.setattr(bootstrap, "RESAMPLES", 999)
    entries = [replace(of, reliable_from=100) if of.key == "mu" else of for of in ENCOUNTERS]
    monkeypatch.setattr(summary, "ENCOUNTERS", entries)
    rng = np.random.default_rng(1)
    holds, ends = 0, set()
    for seed in range(trials):
        # Gamma of shape 16 and mean 0.8: spread 0.2, skewness 0.5.
        tau = rng.gamma(16, 0.05, 400)
        until = Precision("mu", 0.034)
        interval, seen = stopped(tau, np.zeros(400, dtype=bool), until, 400, seed)
        holds += contains(interval, 0.8)
        ends.add(seen[-1])
        width = (interval.high - interval.low) / 2
        assert width <= 0.034 or seen[-1] == 400
    assert len(ends) > 1, "the stopping time has to be random for this to be a test"
    assert enough(holds, trials), f"{holds} of {trials}"


@pytest.mark.parametrize(("share", "at"), [(1.0, 1_000), (0.1, 2_000), (0.0, 2_000)])
def test_pairs_that_met_nobody_do_not_stop_it(monkeypatch, share, at) -> None:
    """Their interval of μ is narrow at 1,000 pairs in every case; so is that of nobody met."""
    monkeypatch.setattr(bootstrap, "RESAMPLES", 199)
    rng = np.random.default_rng(5)
    tau = np.where(rng.random(2_000) < share, rng.gamma(16, 0.05, 2_000), 1.0)
    _, seen = stopped(tau, np.zeros(2_000, dtype=bool), Precision("mu", 0.1), 2_000, 1)
    assert seen[-1] == at


@pytest.mark.slow
def test_crash_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(looking, "FIRST_LOOK", 50)
    monkeypatch.setattr(summary, "bootstrap_mean_and_cv", lambda *_: (bootstrap.UNKNOWN,) * 2)
    rng = np.random.default_rng(2)
    trials, holds, ends = 200, 0, set()
    for seed in range(trials):
        crashed = rng.random(400) < 0.08
        interval, seen = stopped(np.ones(400), crashed, Precision("kappa", 0.06), 400, seed)
        holds += contains(interval, 0.08)
        ends.add(seen[-1])
    assert len(ends) > 1
    assert enough(holds, trials), f"{holds} of {trials}"


@cache
def simulated(scenario: str) -> tuple[np.ndarray, np.ndarray]:
    """τ (NaN where undefined) and crashes of pairs of a shipped scenario, on the plain engine."""
    pairs = pair_columns(population(scenario, range(3_000)))
    return pairs.time_s[0] / pairs.time_s[1], pairs.crashed[0]


@pytest.mark.slow
@pytest.mark.parametrize(("measure", "width"), [("mu", 0.02), ("kappa", 0.006)])
@pytest.mark.parametrize("scenario", ["cctc", "cctc_flow"])
def test_shipped_scenarios(scenario: str, measure: str, width: float) -> None:
    tau, crashed = simulated(scenario)
    truth = float(np.nanmean(tau)) if measure == "mu" else float(np.mean(crashed))
    rng = np.random.default_rng(3)
    trials, holds = 120, 0
    for seed in range(trials):
        chosen = rng.integers(0, len(tau), 4_000)
        undefined = np.isnan(tau[chosen])
        drawn = np.where(undefined, 1.0, tau[chosen])
        # A pair without τ is one in which the AV crashed, as far as μ is concerned.
        marked = crashed[chosen] if measure == "kappa" else undefined
        interval, _ = stopped(drawn, marked, Precision(measure, width), 4_000, seed)
        holds += contains(interval, truth)
    assert enough(holds, trials), f"{holds} of {trials}"
