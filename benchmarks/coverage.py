"""How often the printed intervals hold the truth: ``python -m benchmarks.coverage SCENARIO``.

A large population of pairs is simulated on the plain engine, with the scenario's AV and with
another; what they show together is the truth.  Experiments of N pairs are drawn from them with
replacement and summarised and compared as a run is, and the share of their intervals that contain
the truth is counted.  Standard error of a coverage of 95 % in 1,000 experiments: 0.7 %.
"""

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pyarrow as pa

from harness.core.encounter import FloatArray
from harness.engine.plain import PlainEngine
from harness.episode.pairing import PairRunner
from harness.model.interaction import load_model
from harness.old.statistics import (
    ENCOUNTERS,
    EncounterColumns,
    Interval,
    PairColumns,
    bootstrap_ratio,
    paired_difference,
    summarise,
    swept_value,
)
from harness.old.store.episode_tables import episode_rows
from harness.old.store.summaries import pair_columns
from harness.scenario import Scenario, Setting, load_scenario

SWEPT = 8
"""Values of the parameter sweep whose upper bound of μ is tried."""

LEVEL = 0.05

Named = tuple[str, Interval]
"""An interval with the name it is printed under."""


def population(scenario_name: str, pairs: range, av: str | None = None) -> pa.Table:
    """The ``episodes`` of these pairs; ``av`` drives instead of the scenario's."""
    settings = [] if av is None else [Setting("arms.av", av)]
    scenario = load_scenario(scenario_name, settings)
    model = load_model(scenario.model.name, scenario.model.path)
    runner = PairRunner(scenario, model, lambda: plain_engine(scenario))
    return episode_rows(0, runner.run(pairs))


def plain_engine(scenario: Scenario) -> PlainEngine:
    """The plain engine of a scenario."""
    return PlainEngine(scenario.vehicle(), scenario.experiment.step_s)


def simulate(scenario_name: str, size: int, av: str | None, workers: int) -> PairColumns:
    """The population, in blocks on several processes."""
    blocks = [range(begin, min(begin + 500, size)) for begin in range(0, size, 500)]
    count = len(blocks)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        parts = pool.map(population, [scenario_name] * count, blocks, [av] * count)
        return pair_columns(pa.concat_tables(parts))


Times = tuple[float, float]
"""Time-out and free pass time in s."""


def times_of(scenario_name: str) -> Times:
    """Those of a shipped scenario."""
    scenario = load_scenario(scenario_name)
    return scenario.experiment.timeout_s, scenario.vehicle().free_pass_time_s(scenario.crosswalk())


def of_a_cell(
    av: PairColumns, _other: PairColumns, times: Times, rng: np.random.Generator
) -> Iterator[Named]:
    """Everything that a summary gives an interval."""
    summary = summarise(EncounterColumns(av, *times, rng))
    yield from ((name, getattr(summary, name)) for name in names_with_intervals())


def names_with_intervals() -> Iterator[str]:
    """The reported numbers of a cell that have an interval."""
    for entry in ENCOUNTERS:
        if entry.interval is not None:
            yield from filter(None, entry.names)


def of_differences(
    av: PairColumns, other: PairColumns, times: Times, rng: np.random.Generator
) -> Iterator[Named]:
    """What a comparison of two cells gives an interval."""
    yield "mu_difference", paired_difference(_tau(av), _tau(other), rng)
    yield "delay_difference_s", paired_difference(av.delay_s[0], other.delay_s[0], rng)
    (av_s, human_s), (other_s, _) = (of.times_counted(times[0]) for of in (av, other))
    counted = ~np.isnan(av_s - other_s)
    saved = (av_s - other_s)[counted]
    yield "time_ratio_difference", bootstrap_ratio(saved, human_s[counted], rng)


def of_a_sweep(
    av: PairColumns, _other: PairColumns, _times: Times, rng: np.random.Generator
) -> Iterator[Named]:
    """The upper bound of μ at one of ``SWEPT`` values; it should hold in 1 − 0.05/16."""
    bound = swept_value(av.tau_all, av.av_missed, av.av_tried, rng, SWEPT, LEVEL).mu
    yield "mu_bound", Interval(bound.value, None if bound.high is None else -np.inf, bound.high)


INTERVALS = {"cell": of_a_cell, "differences": of_differences, "sweep": of_a_sweep}


def _tau(pairs: PairColumns) -> FloatArray:
    tau: FloatArray = pairs.time_s[0] / pairs.time_s[1]
    return tau


def holds(interval: Interval, truth: float) -> bool:
    """Whether the interval contains the truth."""
    if interval.low is None or interval.high is None:
        return False
    # A truth that is the same in every pair is met up to rounding.
    slack = 1e-12 * max(1.0, abs(truth))
    return interval.low - slack <= truth <= interval.high + slack


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="cctc")
    parser.add_argument("--other", default="hard_yield", help="the AV of the paired differences")
    parser.add_argument("--population", type=int, default=20_000)
    parser.add_argument("--pairs", type=int, nargs="+", default=[50, 200, 1_000])
    parser.add_argument("--experiments", type=int, nargs="+", default=[1_000, 1_000, 400])
    parser.add_argument("--what", nargs="+", choices=INTERVALS, default=list(INTERVALS))
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    times = times_of(options.scenario)
    av, other = (
        simulate(options.scenario, options.population, strategy, options.workers)
        for strategy in (None, options.other)
    )
    rng = np.random.default_rng(20171)

    def intervals(*columns: PairColumns) -> list[Named]:
        kinds = (INTERVALS[kind](*columns, times, rng) for kind in options.what)
        return [named for kind in kinds for named in kind]

    truth = {name: found.value for name, found in intervals(av, other)}
    print(f"{options.scenario}, {options.population} pairs, differences to {options.other}")
    print(
        "  truth: " + ", ".join(f"{name} {value:.5g}" for name, value in truth.items()), flush=True
    )
    for n, experiments in zip(options.pairs, options.experiments, strict=True):
        hits = dict.fromkeys(truth, 0)
        for _ in range(experiments):
            chosen = rng.integers(0, options.population, n)
            for name, interval in intervals(av.where(chosen), other.where(chosen)):
                hits[name] += holds(interval, truth[name])
        shares = ", ".join(f"{name} {hit / experiments:.1%}" for name, hit in hits.items())
        print(f"  N = {n}, {experiments} experiments: {shares}", flush=True)


if __name__ == "__main__":
    main()
