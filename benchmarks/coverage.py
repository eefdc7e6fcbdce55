"""How often the printed intervals hold the truth: ``python -m benchmarks.coverage SCENARIO``.

A large population of pairs is simulated on the plain engine; its μ, c_v and κ are the truth.
Experiments of N pairs are drawn from it with replacement, and the share of their intervals that
contain the truth is counted.  Standard error of a coverage of 95 % in 1,000 experiments: 0.7 %.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from harness.comparison import Interval, bootstrap_mean_and_cv, proportion
from harness.encounter import Arm, Ending
from harness.engine.plain import PlainEngine
from harness.interaction import load_model
from harness.pairing import PairRunner
from harness.scenario import Scenario, load_scenario


def population(scenario_name: str, pairs: range) -> list[tuple[float, bool]]:
    """(τ or NaN, AV crashed) of every pair."""
    scenario = load_scenario(scenario_name)
    model = load_model(scenario.model.name, scenario.model.path)
    runner = PairRunner(scenario, model, lambda: plain_engine(scenario))
    rows: dict[int, dict[Arm, tuple[float, bool]]] = {}
    for outcome in runner.run(pairs):
        record = outcome.record
        time = float("nan") if record.pass_time_s is None else record.pass_time_s
        crashed = record.ending is Ending.CRASHED
        rows.setdefault(outcome.pair, {})[outcome.arm] = (time, crashed)
    return [(arms[Arm.AV][0] / arms[Arm.HUMAN][0], arms[Arm.AV][1]) for arms in rows.values()]


def plain_engine(scenario: Scenario) -> PlainEngine:
    """The plain engine of a scenario."""
    return PlainEngine(scenario.vehicle(), scenario.experiment.step_s)


def holds(interval: Interval, truth: float) -> bool:
    """Whether the interval contains the truth."""
    if interval.low is None or interval.high is None:
        return False
    return interval.low <= truth <= interval.high


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="cctc")
    parser.add_argument("--population", type=int, default=20_000)
    parser.add_argument("--experiments", type=int, default=1_000)
    options = parser.parse_args()
    block = 500
    blocks = [
        range(begin, min(begin + block, options.population))
        for begin in range(0, options.population, block)
    ]
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        parts = pool.map(population, [options.scenario] * len(blocks), blocks)
        rows = np.array([row for part in parts for row in part], dtype=float)
    tau, crashed = rows[:, 0], rows[:, 1]
    defined = ~np.isnan(tau)
    mu = float(np.mean(tau[defined]))
    cv = float(np.std(tau[defined])) / mu
    kappa = float(np.mean(crashed))
    print(f"{options.scenario}: population {len(tau)}, mu {mu:.4f}, cv {cv:.4f}, kappa {kappa:.5f}")
    rng = np.random.default_rng(20171)
    for n in (50, 200, 1_000, 4_000):
        experiments = max(200, min(options.experiments, options.experiments * 300 // n))
        hits = np.zeros(3)
        for _ in range(experiments):
            chosen = rng.integers(0, len(tau), n)
            drawn = tau[chosen]
            mean, spread = bootstrap_mean_and_cv(drawn[~np.isnan(drawn)], rng)
            rate = proportion(int(crashed[chosen].sum()), n)
            hits += holds(mean, mu), holds(spread, cv), holds(rate, kappa)
        covered = hits / experiments
        print(
            f"N = {n:5d}: mu {covered[0]:.1%}, cv {covered[1]:.1%}, kappa {covered[2]:.1%} "
            f"({experiments} experiments)"
        )


if __name__ == "__main__":
    main()
