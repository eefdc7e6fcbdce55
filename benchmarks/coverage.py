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

from harness.encounter.pairing import PairRunner
from harness.engine.plain import PlainEngine
from harness.model.interaction import load_model
from harness.results import estimators
from harness.results.cell_findings import cell_findings
from harness.results.columns import AV, PairSample
from harness.results.estimators import CONFIDENCE
from harness.results.finding import Finding
from harness.results.rows import episode_rows
from harness.scenario import Cell, Scenario, Setting, load_scenario
from harness.studies.differences import DIFFERENCES

SWEPT = 8
"""Values of the parameter sweep whose upper bound of μ is tried."""

Named = tuple[str, Finding]
"""A finding with its name."""

Cells = tuple[pa.Table, pa.Table]
"""``episodes`` of the AV's cell and of another AV's, of the same pairs."""


def population(scenario_name: str, pairs: range, av: str | None = None) -> pa.Table:
    """The ``episodes`` of these pairs; ``av`` drives instead of the scenario's."""
    settings = [] if av is None else [Setting("arms.av", av)]
    scenario = load_scenario(scenario_name, settings)
    model = load_model(scenario.model.name, scenario.model.path)
    runner = PairRunner(scenario, model, lambda: plain_engine(scenario))
    return episode_rows(0, [*runner.run(pairs)])


def plain_engine(scenario: Scenario) -> PlainEngine:
    """The plain engine of a scenario."""
    return PlainEngine(scenario.vehicle(), scenario.experiment.step_s)


def simulate(scenario_name: str, size: int, av: str | None, workers: int) -> pa.Table:
    """The population, in blocks on several processes."""
    blocks = [range(begin, min(begin + 500, size)) for begin in range(0, size, 500)]
    count = len(blocks)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        parts = pool.map(population, [scenario_name] * count, blocks, [av] * count)
        return pa.concat_tables(parts).combine_chunks()


def chosen_pairs(episodes: pa.Table, chosen: np.ndarray) -> pa.Table:
    """These pairs of a table as the pairs 0, 1, 2 … of an experiment."""
    rows = np.stack([2 * chosen, 2 * chosen + 1], axis=1).ravel()
    place = episodes.schema.get_field_index("pair")
    numbers = pa.array(np.repeat(np.arange(len(chosen)), 2))
    return episodes.take(rows).set_column(place, "pair", numbers)


def of_a_cell(cells: Cells, scenario: Scenario) -> Iterator[Named]:
    """Every finding of a cell."""
    yield from cell_findings(
        Cell(0, {}, scenario), {"episodes": cells[0]}, CONFIDENCE
    ).findings.items()


def of_differences(cells: Cells, scenario: Scenario) -> Iterator[Named]:
    """What a comparison of two cells gives an interval."""
    first, second = (PairSample(of, scenario, CONFIDENCE) for of in cells)
    for each in DIFFERENCES:
        yield f"A − B: {each.key}", each.of(first, second, first.samplings[AV])


def of_a_sweep(cells: Cells, scenario: Scenario) -> Iterator[Named]:
    """The upper bound of μ at one of ``SWEPT`` values; it should hold in 1 − 0.05/16."""
    sample = PairSample(cells[0], scenario, CONFIDENCE)
    sampling = sample.samplings[AV]._replace(confidence=1 - (1 - CONFIDENCE) / SWEPT)
    mu = estimators.mean(sample["tau_all"], sampling)
    yield "mu_bound", Finding(mu.value, None if mu.low is None else -np.inf, mu.high, mu.n)


INTERVALS = {"cell": of_a_cell, "differences": of_differences, "sweep": of_a_sweep}


def holds(finding: Finding, truth: float) -> bool:
    """Whether the interval contains the truth."""
    if finding.low is None or finding.high is None:
        return False
    # A truth that is the same in every pair is met up to rounding.
    slack = 1e-12 * max(1.0, abs(truth))
    return finding.low - slack <= truth <= finding.high + slack


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
    scenario = load_scenario(options.scenario)
    both = [
        simulate(options.scenario, options.population, strategy, options.workers)
        for strategy in (None, options.other)
    ]

    def found(cells: list[pa.Table]) -> dict[str, Finding]:
        first, second = cells
        kinds = (INTERVALS[kind]((first, second), scenario) for kind in options.what)
        return dict(named for kind in kinds for named in kind)

    truth = {name: of.value for name, of in found(both).items() if isinstance(of.value, float)}
    print(f"{options.scenario}, {options.population} pairs, differences to {options.other}")
    print(
        "  truth: " + ", ".join(f"{name} {value:.5g}" for name, value in truth.items()), flush=True
    )
    rng = np.random.default_rng(20171)
    for n, experiments in zip(options.pairs, options.experiments, strict=True):
        hits, trials = dict.fromkeys(truth, 0), dict.fromkeys(truth, 0)
        for _ in range(experiments):
            chosen = rng.integers(0, options.population, n)
            for name, of in found([chosen_pairs(each, chosen) for each in both]).items():
                if name in truth and of.low is not None:
                    trials[name] += 1
                    hits[name] += holds(of, truth[name])
        shares = ", ".join(
            f"{name} {hits[name] / tried:.1%}{'' if tried == experiments else f' of {tried}'}"
            for name, tried in trials.items()
            if tried
        )
        print(f"  N = {n}, {experiments} experiments: {shares}", flush=True)


if __name__ == "__main__":
    main()
