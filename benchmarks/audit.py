"""Statistical audit on an experiment of which the truth is known: ``python -m benchmarks.audit``.

Repeats the paper's experiment (``known_truth``) from 2,000 root seeds and counts how often each
interval that the program prints holds the truth, on which side it misses, and how far the means of
the estimates are from it.  Pedestrians are planned as the program does; what comes of a pair is
looked up at the nearest of the truth's nodes, and some experiments are simulated to compare.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping

import numpy as np
import pyarrow as pa

from benchmarks import known_truth, pairing_worth
from benchmarks.coverage import LEVEL, Named, holds, names_with_intervals
from benchmarks.known_truth import CELLS, COMPARED, SWEPT
from benchmarks.tally import BAND, Tally
from harness.core.encounter import FloatArray
from harness.core.seeding import resampling
from harness.report.drawing.tau_figures import running_mean
from harness.scenario import Cell, Options, Precision, Study
from harness.statistics import (
    CONFIDENCE,
    Interval,
    mcnemar,
    paired_difference,
    proportion,
    swept_value,
    zero_bound,
)
from harness.store.summaries import confidence_of, looks, pair_columns, summarise_cell
from harness.studies.batch.plan import Plan
from harness.studies.batch.until import reach_precision

SUMMARISED = ("soft", "constant")
"""Cells of which every interval is tried: the paper's AV, which never crashes, and one that does.

Both have the same human, who is tried in the first."""

EQUAL = ("brake", "bold")
"""Cells with the same crash rate: McNemar's test should reject in at most 5 %."""

BANDED = (5, 20)
"""Where on the running mean, besides N, its band is tried."""

UNTIL = (("soft", Precision("mu", 0.0135)), ("constant", Precision("kappa", 0.0226)))
UNTIL_PAIRS = 4_000

NOT_AUDITED = (
    *("serious_", "fatal_"),
    *("acceleration_rms", "max_deceleration_p95", "jerk_rms", "max_jerk"),
)
"""Intervals of numbers whose truth ``known_truth`` does not compute: injuries and comfort."""

Cells = Mapping[str, pa.Table]
Draw = Callable[[int, int], Cells]
"""The ``episodes`` of every cell in an experiment of so many pairs from a root seed."""


def of_a_cell(name: str, episodes: pa.Table, seed: int) -> Iterator[Named]:
    """Everything printed of a cell with an interval: summary, conflicts, running mean."""
    scenario = known_truth.scenario_of(CELLS[name], seed)
    summary = summarise_cell(episodes, Cell(0, {}, scenario), CONFIDENCE)
    yield from (
        (f"{name}: {key}", getattr(summary, key))
        for key in names_with_intervals()
        if not key.startswith(NOT_AUDITED)
    )
    tau = known_truth.tau_of(episodes)
    tau = tau[~np.isnan(tau)]
    mean, half = running_mean(tau)
    for n in (*BANDED, len(tau)):
        at = Interval(*(float(mean[n - 1] + sign * half[n - 1]) for sign in (0, -1, 1)))
        yield f"{name}: {BAND}{'all' if n == len(tau) else n}", at


def of_differences(cells: Cells, seed: int) -> Iterator[Named]:
    """What ``harness compare`` gives an interval; resampled as there."""
    for a, b in COMPARED:
        first, second = (pair_columns(cells[name]) for name in (a, b))
        tau = [columns.time_s[0] / columns.time_s[1] for columns in (first, second)]
        rng = resampling(seed, "comparison")
        yield f"{a} − {b}: mu_difference", paired_difference(*tau, rng)
        delays = (first.delay_s[0], second.delay_s[0])
        yield f"{a} − {b}: delay_difference_s", paired_difference(*delays, rng)


def intervals(cells: Cells, seed: int) -> Iterator[Named]:
    """Every interval of an experiment."""
    for name in SUMMARISED:
        for key, interval in of_a_cell(name, cells[name], seed):
            if name == SUMMARISED[0] or "human" not in key:
                yield key, interval
    yield from of_differences(cells, seed)


def claims(cells: Cells, truth: Mapping[str, float], seed: int) -> Iterator[tuple[str, bool]]:
    """Everything claimed in an experiment beside intervals, and whether it is wrong."""
    yield from errors(cells, truth)
    if set(SWEPT) <= set(cells):
        yield from of_a_sweep(cells, truth, seed)


def errors(cells: Cells, truth: Mapping[str, float]) -> Iterator[tuple[str, bool]]:
    """Claims that are no intervals, and whether each is wrong."""
    a, b = (pair_columns(cells[name]) for name in EQUAL)
    test = mcnemar(a.crashed[0], b.crashed[0], ~a.failed[0], ~b.failed[0])
    yield "McNemar rejects equal κ", test.p < LEVEL
    crashes = pair_columns(cells["soft"]).crashed[1]
    bound = zero_bound(proportion(0, len(crashes)).high or 1.0)
    wrong = not crashes.any() and bound < truth["soft: kappa_human"]
    yield "no crash of the human, and κ beyond its one-sided bound", wrong


def of_a_sweep(cells: Cells, truth: Mapping[str, float], seed: int) -> Iterator[tuple[str, bool]]:
    """Whether any of the bounds that a sweep's verdict rests on is wrong."""
    upper, lower = [], []
    for name in SWEPT:
        pairs = pair_columns(cells[name])
        rng, missed = resampling(seed, "comparison"), (pairs.av_missed, pairs.av_tried)
        value = swept_value(pairs.tau_all, *missed, rng, len(SWEPT), LEVEL)
        for measure in ("mu", "kappa"):
            found: Interval = getattr(value, measure)
            upper.append((measure, found.high < truth[f"{name}: {measure}_all"] - 1e-12))
            lower.append((measure, found.low > truth[f"{name}: {measure}_all"] + 1e-12))
    for measure in ("mu", "kappa"):
        yield f"sweep: an upper bound of {measure}", any(bad for of, bad in upper if of == measure)
        yield f"sweep: a lower bound of {measure}", any(bad for of, bad in lower if of == measure)


def repeat(draw: Draw, pairs: int, experiments: int, truth: Mapping[str, float]) -> Tally:
    """So many experiments, with progress on standard error; the table on standard output."""
    tally = Tally(truth)
    for seed in range(experiments):
        cells = draw(pairs, seed)
        tally.add(intervals(cells, seed), claims(cells, truth, seed))
        progress(f"N = {pairs}", seed + 1, experiments)
    print(f"\nN = {pairs}, {experiments} experiments\n")
    print("\n".join(tally.table()), flush=True)
    return tally


def progress(title: str, done: int, planned: int) -> None:
    """One line that overwrites itself."""
    end = "\n" if done == planned else "\r"
    print(f"{title}: {done} of {planned}", end=end, file=sys.stderr, flush=True)


def planning(cells: Cells) -> Draw:
    """Experiments of the pairs that the program plans from a root seed, looked up by node."""
    per_side = next(iter(cells.values())).num_rows // 4

    def draw(pairs: int, seed: int) -> Cells:
        planned = known_truth.planned_nodes(pairs, seed, per_side)
        return {
            name: known_truth.chosen_pairs(episodes, planned) for name, episodes in cells.items()
        }

    return draw


def agreement(cells: Cells, pairs: int, experiments: int) -> None:
    """Simulate experiments as the program does, and hold them against what was looked up."""
    model, draw = known_truth.model_of(known_truth.scenario_of({})), planning(cells)
    worst, others = {"mu": 0.0, "cv": 0.0}, 0
    for seed in range(experiments):
        looked_up = draw(pairs, seed)
        for name, episodes in known_truth.simulated(CELLS, pairs, seed, model).items():
            a, b = (known_truth.truth_of_cell(of) for of in (episodes, looked_up[name]))
            if any(a[kappa] != b[kappa] for kappa in ("kappa", "kappa_human")):
                others += 1
            else:
                worst = {key: max(most, abs(a[key] - b[key])) for key, most in worst.items()}
        progress("simulated", seed + 1, experiments)
    cells_of_all = experiments * len(CELLS)
    print(
        f"\n{experiments} experiments of {pairs} pairs simulated, each with {len(CELLS)} AVs: "
        f"another number of crashes than looked up in {others} of {cells_of_all} cells; in the "
        f"others μ differs by at most {worst['mu']:.2g}, c_v by {worst['cv']:.2g}",
        flush=True,
    )


class Work:
    """Stands for a run folder whose pairs are nodes that have been drawn."""

    def __init__(self, episodes: pa.Table) -> None:
        self.episodes, self.pairs = episodes, 0

    def reach(self, goals: Mapping[int, int]) -> None:
        """As a run does it."""
        self.pairs = goals[0]

    def episodes_of(self, _cell: int) -> pa.Table:
        """So far."""
        return self.episodes.slice(0, 2 * self.pairs)


def until(cells: Cells, truth: Mapping[str, float], experiments: int) -> None:
    """Coverage of the interval at which ``--until`` stops."""
    print(f"\n--until, at most {UNTIL_PAIRS} pairs, {experiments} experiments\n", flush=True)
    for name, precision in UNTIL:
        draw = planning({name: cells[name]})
        held, ends = 0, Counter[int]()
        for seed in range(experiments):
            changes = {**CELLS[name], "experiment.pairs": UNTIL_PAIRS}
            scenario = known_truth.scenario_of(changes, seed)
            study = Study("audit", scenario, (Cell(0, {}, scenario),))
            options, work = Options(until=precision), Work(draw(UNTIL_PAIRS, seed)[name])
            plan = Plan(study, {}, options, {})
            reach_precision(plan, precision, work.reach, work.episodes_of)
            confidence = confidence_of(study, options)
            found = summarise_cell(work.episodes_of(0), study.cells[0], confidence)
            held += holds(getattr(found, precision.measure), truth[f"{name}: {precision.measure}"])
            ends[work.pairs] += 1
            progress(f"--until {precision.measure}", seed + 1, experiments)
        share = held / experiments
        print(
            f"- {name}, {precision.measure} ± {precision.half_width}: holds {100 * share:.1f} % "
            f"(s.e. {100 * np.sqrt(share * (1 - share) / experiments):.1f}); stopped at "
            + ", ".join(f"{n}: {ends[n]}" for n in looks(UNTIL_PAIRS)),
            flush=True,
        )


def bias_of_cv(tau: FloatArray, pairs: float) -> float:
    """Leading term, in 1/N, of the bias of c_v = s/m, s the population standard deviation.

    With c = σ/μ, skewness γ and kurtosis k of τ, expanding √V/M about (σ², μ) to second order,
    with E V − σ² = −σ²/N, var V = (k − 1) σ⁴/N, var M = σ²/N and cov(M, V) = γ σ³/N, gives
    (c/N) (−1/2 − (k − 1)/8 − γ c/2 + c²).
    """
    mean, spread = tau.mean(), tau.std()
    z = (tau - mean) / spread
    c, skewness, kurtosis = spread / mean, np.mean(z**3), np.mean(z**4)
    bias: float = c / pairs * (-0.5 - (kurtosis - 1) / 8 - skewness * c / 2 + c**2)
    return bias


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, nargs="*", default=[50, 200], help="N")
    parser.add_argument("--experiments", type=int, default=2_000, help="of each N")
    parser.add_argument("--per-side", type=int, default=5_000, help="nodes of the truth")
    parser.add_argument("--simulated", type=int, default=300, help="experiments that are simulated")
    parser.add_argument("--until", type=int, default=300, help="experiments with --until")
    parser.add_argument("--flow-pairs", type=int, default=10_000, help="for the pairing's worth")
    options = parser.parse_args()
    cells = known_truth.nodes(CELLS | SWEPT, options.per_side)
    truth = known_truth.every_truth(cells, COMPARED)
    draw = planning(cells)
    tallies = {n: repeat(draw, n, options.experiments, truth) for n in options.pairs}
    print("\nBias of c_v, against its leading term\n")
    for name in SUMMARISED:
        tau = known_truth.tau_of(cells[name])
        for n, tally in tallies.items():
            mean, error = tally.bias(f"{name}: cv")
            defined = tau[~np.isnan(tau)]
            expected = bias_of_cv(defined, n * len(defined) / len(tau))
            print(f"- {name}, N = {n}: {mean:+.5f} (s.e. {error:.5f}), expected {expected:+.5f}")
    if options.simulated:
        agreement(cells, min(options.pairs), options.simulated)
    if options.flow_pairs:
        pairing_worth.report(cells, options.flow_pairs)
    if options.until:
        until(cells, truth, options.until)


if __name__ == "__main__":
    main()
