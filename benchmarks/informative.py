"""How often intervals hold by what they rest on: ``python -m benchmarks.informative --flow 50``.

At a low flow most pairs meet nobody, and what an interval rests on are the others.  Pairs of a flow
in which somebody comes before the ego could have passed are simulated on the plain engine; all
others are alike.  Experiments of so many pairs that about M are informative are drawn from both, in
the flow's own proportion but with at most ``EMPTIEST`` empty pairs to each other one: beyond that
their number no longer matters.  They are summarised and compared as a run is.
"""

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import count
from multiprocessing import get_context

import numpy as np
import pyarrow as pa

from benchmarks.coverage import Named, holds, of_a_cell, plain_engine
from harness.episode.arrivals import planned_arrivals
from harness.episode.pairing import PairRunner
from harness.model.interaction import load_model
from harness.scenario import Scenario, Setting, load_scenario
from harness.statistics import (
    PairColumns,
    Resampled,
    bootstrap,
    paired_difference,
    ratio_difference,
)
from harness.store.episode_tables import episode_rows
from harness.store.summaries import pair_columns

EMPTIEST = 2


def scenario_at(name: str, flow: float | None, av: str | None) -> Scenario:
    """A shipped scenario at another flow, with another AV."""
    given = {"pedestrians.flow_per_hour": flow, "arms.av": av}
    return load_scenario(name, [Setting(key, of) for key, of in given.items() if of is not None])


def chosen(scenario: Scenario, size: int) -> tuple[list[int], int]:
    """The first ``size`` pairs in which somebody comes in time, then one in which nobody does.

    With the number of pairs looked through; in a scenario without empty pairs there is none.
    """
    free_s = scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    come, empty = [], []
    for pair in count():
        (come if planned_arrivals(scenario, pair, horizon_s=free_s) else empty).append(pair)
        if len(come) == size:
            return [*come, *empty[:1]], pair + 1
    raise AssertionError


def episodes(scenario: Scenario, pairs: list[int]) -> pa.Table:
    """The ``episodes`` of these pairs."""
    model = load_model(scenario.model.name, scenario.model.path)
    runner = PairRunner(scenario, model, lambda: plain_engine(scenario))
    return episode_rows(0, runner.run(pairs))


def simulate(scenario: Scenario, pairs: list[int], workers: int) -> PairColumns:
    """These pairs, in blocks on several processes."""
    blocks = [pairs[begin : begin + 200] for begin in range(0, len(pairs), 200)]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        parts = pool.map(episodes, [scenario] * len(blocks), blocks)
        return pair_columns(pa.concat_tables(parts))


def intervals(
    av: PairColumns, other: PairColumns, scenario: Scenario, rng: np.random.Generator
) -> Iterator[Named]:
    """What is printed of a cell, and of two cells."""
    timeout_s = scenario.experiment.timeout_s
    times = timeout_s, scenario.vehicle().free_pass_time_s(scenario.crosswalk())
    yield from of_a_cell(av, other, times, rng)
    yield "mu_difference", paired_difference(av.tau, other.tau, rng)
    yield "delay_difference_s", paired_difference(av.delay_s[0], other.delay_s[0], rng)
    (first, human), (second, _) = (of.times_counted(timeout_s) for of in (av, other))
    yield "time_ratio_difference", ratio_difference(first, second, human, rng)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="cctc_flow")
    parser.add_argument("--flow", type=float, help="pedestrians per hour")
    parser.add_argument("--other", default="hard_yield", help="the AV of the differences")
    parser.add_argument("--population", type=int, default=5_000)
    parser.add_argument("--informative", type=int, nargs="+", default=[50, 200, 1_000])
    parser.add_argument("--experiments", type=int, nargs="+", default=[400, 300, 200])
    parser.add_argument("--resamples", type=int, default=bootstrap.RESAMPLES)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    bootstrap.RESAMPLES = options.resamples
    bootstrap.FEWEST_RESAMPLES = min(options.resamples, bootstrap.FEWEST_RESAMPLES)
    scenario = scenario_at(options.scenario, options.flow, None)
    pairs, looked_through = chosen(scenario, options.population)
    size, empty = options.population, len(pairs) - options.population
    av, other = (
        simulate(scenario_at(options.scenario, options.flow, of), pairs, options.workers)
        for of in (None, options.other)
    )
    share = max(size / looked_through, 1 / (1 + EMPTIEST)) if empty else 1.0
    whole = np.concatenate([np.arange(size), np.full(round(size / share) - size, size)])
    rng = np.random.default_rng(20172)
    truth = dict(intervals(av.where(whole), other.where(whole), scenario, rng))
    differ = truth["mu"].informative / len(whole)  # type: ignore[attr-defined]
    print(
        f"{options.scenario}, flow {options.flow}: somebody came in {size} of {looked_through} "
        f"pairs; drawn with a share of {share:.3f}, {differ:.3f} informative for μ\n  truth: "
        + ", ".join(f"{name} {of.value:.5g}" for name, of in truth.items()),
        flush=True,
    )
    for wanted, experiments in zip(options.informative, options.experiments, strict=True):
        n = round(wanted / differ)
        hits, rests = dict.fromkeys(truth, 0), dict.fromkeys(truth, 0)
        for _ in range(experiments):
            drawn = whole[rng.integers(0, len(whole), n)]
            found = intervals(av.where(drawn), other.where(drawn), scenario, rng)
            for name, interval in found:
                hits[name] += holds(interval, truth[name].value or 0.0)
                rests[name] += interval.informative if isinstance(interval, Resampled) else 0
        line = ", ".join(
            f"{name} {hit / experiments:.1%} [{rests[name] / experiments:.0f}]"
            for name, hit in hits.items()
        )
        print(f"  N = {n}, {experiments} experiments: {line}", flush=True)


if __name__ == "__main__":
    main()
