"""What it is worth that all arms and cells meet the same pedestrians: variances with and without.

The difference of two means over N pairs has the variance var(x − y)/N with the same pedestrians on
both sides and (var x + var y)/N with others on either side; their ratio is how many times as many
pairs it takes without common random numbers.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from benchmarks import known_truth
from benchmarks.coverage import plain_engine
from benchmarks.known_truth import columns_of, model_of
from harness.core.encounter import FloatArray
from harness.episode.pairing import PairRunner
from harness.scenario import Setting, load_scenario
from harness.store.episode_tables import episode_rows

SEEDS = (101, 102)
"""Root seeds of the pedestrians, and of those whom the other side meets without pairing."""

CCTC_PAIRS = 100_000

EXPERIMENT = 50
"""Pairs of the experiments whose means are compared."""

RESAMPLES = 1_000


class Times(NamedTuple):
    """Pass times of each pair in s, NaN where the arm did not cross: two AVs and the human."""

    soft: FloatArray
    hard: FloatArray
    human: FloatArray


class Difference(NamedTuple):
    """Something of two arms or cells of which the means are compared."""

    name: str
    first: Callable[[Times], FloatArray]
    second: Callable[[Times], FloatArray]


DIFFERENCES = (
    Difference("pass time, Soft-Yield − human", lambda t: t.soft, lambda t: t.human),
    Difference("pass time, Hard-Yield − human", lambda t: t.hard, lambda t: t.human),
    Difference("delay, Soft-Yield − Hard-Yield", lambda t: t.soft, lambda t: t.hard),
    Difference(
        "μ, Soft-Yield − Hard-Yield", lambda t: t.soft / t.human, lambda t: t.hard / t.human
    ),
)


def ratio(first: FloatArray, second: FloatArray) -> float:
    """(var x + var y)/var(x − y) over the pairs in which both are defined."""
    defined = ~np.isnan(first - second)
    x, y = first[defined], second[defined]
    return float((x.var() + y.var()) / (x - y).var())


def ratio_of_experiments(paired: FloatArray, unpaired: FloatArray) -> float:
    """Of the variances of the differences that whole experiments found."""
    return float(unpaired.var() / paired.var())


def experiments(values: FloatArray) -> FloatArray:
    """Means over each experiment's defined pairs."""
    whole = len(values) // EXPERIMENT * EXPERIMENT
    return np.asarray(np.nanmean(values[:whole].reshape(-1, EXPERIMENT), axis=1))


def spread(
    statistic: Callable[..., float], columns: tuple[FloatArray, ...], rng: np.random.Generator
) -> tuple[float, float]:
    """95 % percentile interval of a statistic of aligned columns, by the bootstrap."""
    n = len(columns[0])
    found = []
    for _ in range(RESAMPLES):
        chosen = rng.integers(0, n, n)
        found.append(statistic(*(column[chosen] for column in columns)))
    low, high = np.quantile(found, [0.025, 0.975])
    return float(low), float(high)


def simulated(scenario_name: str, pairs: int, seed: int) -> Times:
    """Pairs as the program runs them; the human's arm is the same beside either AV."""
    found = []
    for av in ("soft_yield", "hard_yield"):
        settings = [Setting("arms.av", av), Setting("experiment.seed", seed)]
        if found:
            settings.append(Setting("arms.human", "constant_speed"))
        scenario = load_scenario(scenario_name, settings)
        engine = plain_engine(scenario)
        runner = PairRunner(scenario, model_of(scenario), lambda engine=engine: engine)
        found.append(episode_rows(0, runner.run(range(pairs))))
    return times_of(*found)


def times_of(soft: pa.Table, hard: pa.Table) -> Times:
    """Of the episodes of two cells with the same human."""
    (av, human), (other, _) = columns_of(soft), columns_of(hard)
    return Times(av["pass_time_s"], other["pass_time_s"], human["pass_time_s"])


def rows(name: str, same: Times, others: Times, exact: Times | None) -> Iterator[str]:
    """A scenario's rows of the table; ``others`` are pairs with other pedestrians."""
    rng = np.random.default_rng(SEEDS)
    for what, first, second in DIFFERENCES:
        x, y, strangers = first(same), second(same), second(others)
        if exact is None:
            low, high = spread(ratio, (x, y), rng)
            value = f"{ratio(x, y):.2f} ({low:.2f} … {high:.2f})"
        else:
            value = f"{ratio(first(exact), second(exact)):.2f}"
        paired, unpaired = experiments(x - y), experiments(x) - experiments(strangers)
        low, high = spread(ratio_of_experiments, (paired, unpaired), rng)
        yield (
            f"| `{name}` | {what} | {paired.std():.4f} | {unpaired.std():.4f} | {value} | "
            f"{ratio_of_experiments(paired, unpaired):.2f} ({low:.2f} … {high:.2f}) |"
        )


def report(cells: Mapping[str, pa.Table], pairs: int) -> None:
    """Print the table for both shipped scenarios.

    Args:
        cells: the nodes of the known truth, which give the exact ratio of ``cctc`` and its pairs.
        pairs: of ``cctc_flow`` and each seed, simulated.
    """
    exact = times_of(cells["soft"], cells["hard"])
    per_side = len(exact.soft) // 2
    looked_up = (known_truth.planned_nodes(CCTC_PAIRS, seed, per_side) for seed in SEEDS)
    cctc = [Times(*(column[planned] for column in exact)) for planned in looked_up]
    flow = [simulated("cctc_flow", pairs, seed) for seed in SEEDS]
    print("\n| scenario | difference | s.d. paired | s.d. unpaired | ratio | of experiments |")
    print("|---|---|---|---|---|---|")
    print("\n".join(rows("cctc", *cctc, exact)))
    print("\n".join(rows("cctc_flow", *flow, None)))
    print()
    for name, (same, others) in (("cctc", cctc), ("cctc_flow", flow)):
        paired, strangers = same.soft / same.human, same.soft / others.human
        print(
            f"- `{name}`: τ has mean {np.nanmean(paired):.4f} and s.d. {np.nanstd(paired):.4f}; "
            f"of two strangers {np.nanmean(strangers):.4f} and {np.nanstd(strangers):.4f}",
            flush=True,
        )
