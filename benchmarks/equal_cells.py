"""How often cells that are equal are told apart: ``python -m benchmarks.equal_cells``.

Cells equal in law over the same pairs, of which few differ: in each cell Poisson(2.5) pairs wait
for a time of their own, and others miss, so that Poisson(5) differ between two.  They are tested as
``harness compare`` does; every place but "undecided" and "on the front" is wrong, and so is every
"better".
"""

import argparse
from collections import Counter
from itertools import combinations

import numpy as np

from harness.core.encounter import FloatArray
from harness.statistics import (
    Place,
    Relation,
    holm,
    mcnemar,
    pareto_front,
    ratio_difference,
    relation_of_crashes,
    relation_of_times,
    sign_flip_p,
)

LEVEL = 0.05
FREE_S = 7.4


def equal_cells(
    rng: np.random.Generator, cells: int, pairs: int, differing: float
) -> tuple[FloatArray, np.ndarray]:
    """Times and misses of cells, each of shape (cells, pairs)."""
    times, missed = np.full((cells, pairs), FREE_S), np.zeros((cells, pairs), dtype=bool)
    for cell in range(cells):
        waits = rng.choice(pairs, min(pairs, rng.poisson(differing / 2)), replace=False)
        times[cell, waits] += rng.lognormal(1.0, 1.0, len(waits))
        missed[cell, rng.choice(pairs, rng.poisson(differing / 2), replace=False)] = True
    return times, missed


def verdicts(times: FloatArray, missed: np.ndarray, rng: np.random.Generator) -> Counter[str]:
    """How many relations are decided, and places given, among these cells."""
    both = list(combinations(range(len(times)), 2))
    ran = np.ones(times.shape[1], dtype=bool)
    tests = [mcnemar(missed[a], missed[b], ran, ran) for a, b in both]
    adjusted = holm([sign_flip_p(times[a] - times[b]) for a, b in both] + [of.p for of in tests])
    relations = {}
    for at, (a, b) in enumerate(both):
        by_time = Relation.UNDECIDED
        if adjusted[at] < LEVEL or not (times[a] != times[b]).any():
            difference = ratio_difference(times[a], times[b], times[0], rng)
            by_time = relation_of_times(difference, 0, adjusted[at], LEVEL)
        misses = relation_of_crashes(tests[at], adjusted[len(both) + at], LEVEL)
        relations[a, b] = (by_time, misses)
    places = Counter(standing.place for standing in pareto_front(len(times), relations))
    decided = [of for pair in relations.values() for of in pair]
    return Counter(
        better=sum(of in (Relation.BETTER, Relation.WORSE) for of in decided),
        dominated=places[Place.DOMINATED],
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, nargs="+", default=[2, 5, 8, 20])
    parser.add_argument("--pairs", type=int, default=2_000)
    parser.add_argument("--differing", type=float, nargs="+", default=[5.0, 50.0, 500.0])
    parser.add_argument("--sweeps", type=int, default=1_000)
    options = parser.parse_args()
    for differing in options.differing:
        for cells in options.cells:
            rng = np.random.default_rng(20173)
            wrong: Counter[str] = Counter()
            for _ in range(options.sweeps):
                drawn = equal_cells(rng, cells, options.pairs, differing)
                wrong.update(word for word, count in verdicts(*drawn, rng).items() if count)
            print(
                f"{cells} cells, Poisson({differing:g}) pairs differ: of {options.sweeps} sweeps "
                f"{wrong['better']} call one better, {wrong['dominated']} one dominated",
                flush=True,
            )


if __name__ == "__main__":
    main()
