"""What surrogates of crashes would have predicted where the probability of a crash is known.

``python -m benchmarks.surrogates`` simulates 100,000 episodes of each of ten scenarios
(``surrogate_cases``) and predicts κ from the episodes *without* a crash: by counts of conflicts and
by the tail of a measure (``tails``), from disjoint samples of 1,000, 10,000 and 100,000 episodes.
It writes and prints ``surrogates_scenarios.csv``, ``surrogates_ordering.csv``,
``surrogates_tails.csv`` and ``surrogates_totals.csv`` in ``data``.

``python -m benchmarks.surrogates CASE …`` only simulates these, so that several processes can share
the work.  What is in the folder (``--out``) is not simulated again.
"""

import argparse
import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from benchmarks.surrogate_cases import CASES, COLUMNS, Truth, episodes
from benchmarks.tails import Tail, fit_tail
from harness.core.encounter import FloatArray

DATA = Path(__file__).parent / "data"
EPISODES = 100_000
SIZES = (1_000, 10_000, 100_000)

CONFLICTS = (
    ("min_ttc_s", "<", 1.5),
    ("pet_s", "<", 1.5),
    ("pet_s", "<", 1.0),
    ("max_drac_mps2", ">", 3.35),
    ("max_drac_mps2", ">", 8.0),
)
"""Thresholds in use (docs/surrogates.md)."""

COUNTS = ("samples", "no_fit", "no_crash", "held", "too_low", "too_high")
"""Of the samples' fits."""

NO_CRASH = 1e-9
"""A fit that predicts less says that there is no crash: its tail ends at 0, or before it."""

CRASHES_PER_CONFLICT = 1 / 20_000
"""Of conflicts with TTC < 1.5 s at 83 signalized intersections: Gettman et al. 2008."""

TAILS = tuple((column, crashes) for column in COLUMNS[:2] for crashes in ("left out", "as 0"))
"""The measures that are 0 at a crash, and what a fit takes a crash for."""


class Sample(NamedTuple):
    """Episodes of a scenario: crashes, shape (n,), and ``COLUMNS`` without them, shape (n, 3)."""

    truth: Truth
    crashed: NDArray[np.bool_]
    values: FloatArray

    def part(self, number: int, size: int) -> "Sample":
        """The ``number``-th of the disjoint samples of ``size`` episodes."""
        of = slice(number * size, (number + 1) * size)
        return Sample(self.truth, self.crashed[of], self.values[of])


def conflicts(sample: Sample, column: str, sign: str, limit: float) -> int:
    """Number of episodes without a crash whose measure is beyond the limit.

    An undefined measure is not beyond it, and neither is one that equals the limit.
    """
    values = sample.values[:, COLUMNS.index(column)]
    return int(((values < limit) if sign == "<" else (values > limit)).sum())


def tail_of(sample: Sample, column: str, crashes: str) -> Tail | None:
    """The tail fitted to a measure."""
    values = sample.values[:, COLUMNS.index(column)]
    values = values[~np.isnan(values)]
    if crashes == "as 0":
        values = np.concatenate([values, np.zeros(int(sample.crashed.sum()))])
    return fit_tail(values, len(sample.crashed))


def scenario_rows(samples: Mapping[str, Sample]) -> Iterator[dict[str, Any]]:
    """κ of each scenario, and crashes, defined measures and conflicts in its episodes."""
    for name, sample in samples.items():
        size = len(sample.crashed)
        published = conflicts(sample, *CONFLICTS[0]) / size * CRASHES_PER_CONFLICT
        yield {
            "case": name,
            "kappa": f"{sample.truth.kappa:.4g}",
            "standard_error": f"{sample.truth.standard_error:.2g}",
            "how": sample.truth.how,
            "episodes": size,
            "crashed": int(sample.crashed.sum()),
            **{
                f"{column} defined": int((~np.isnan(sample.values[:, at])).sum())
                for at, column in enumerate(COLUMNS)
            },
            **{_text(conflict): conflicts(sample, *conflict) for conflict in CONFLICTS},
            "published_ratio": f"{published / sample.truth.kappa:.2g}",
        }


def ordering_rows(samples: Mapping[str, Sample]) -> Iterator[dict[str, Any]]:
    """How conflicts order the scenarios: rank correlations with κ."""
    kappa = [sample.truth.kappa for sample in samples.values()]
    for conflict in CONFLICTS:
        for size in SIZES:
            yield {
                "conflict": _text(conflict),
                "episodes": size,
                "rank_correlation": _ordering(samples, kappa, conflict, size),
            }


def _ordering(
    samples: Mapping[str, Sample],
    kappa: Sequence[float],
    conflict: tuple[str, str, float],
    size: int,
) -> str:
    """The median of Spearman's rank correlation with κ over disjoint samples."""
    found = []
    for number in range(EPISODES // size):
        counts = [conflicts(sample.part(number, size), *conflict) for sample in samples.values()]
        if len(set(counts)) > 1:
            found.append(float(spearmanr(kappa, counts).statistic))
    return f"{np.median(found):.2f}" if found else ""


def tail_rows(samples: Mapping[str, Sample]) -> Iterator[dict[str, Any]]:
    """What the fitted tails predict, counted over disjoint samples."""
    for name, sample in samples.items():
        for column, crashes in TAILS:
            for size in SIZES:
                parts = [sample.part(number, size) for number in range(EPISODES // size)]
                fits = [tail_of(part, column, crashes) for part in parts]
                yield {
                    "case": name,
                    "measure": column,
                    "crashes": crashes,
                    "episodes": size,
                    **verdict(fits, sample.truth.kappa),
                }


def verdict(fits: Sequence[Tail | None], kappa: float) -> dict[str, Any]:
    """Ratios of the predictions to κ, and how many intervals hold κ, of the samples' fits.

    ``ratio``, ``low`` and ``high`` are medians over the fits: prediction and limits, divided by κ.
    """
    done = [fit for fit in fits if fit is not None]
    tails = np.array([(fit.probability, fit.low, fit.high) for fit in done]).reshape(-1, 3) / kappa
    return {
        "samples": len(fits),
        "no_fit": len(fits) - len(done),
        "no_crash": sum(fit.probability < NO_CRASH for fit in done),
        "held": sum(fit.low <= kappa <= fit.high for fit in done),
        "too_low": sum(fit.high < kappa for fit in done),
        "too_high": sum(fit.low > kappa for fit in done),
        **{
            key: f"{np.median(tails[:, at]):.3g}" if done else ""
            for at, key in enumerate(("ratio", "low", "high"))
        },
        "ratio_5": f"{np.quantile(tails[:, 0], 0.05):.3g}" if done else "",
        "ratio_95": f"{np.quantile(tails[:, 0], 0.95):.3g}" if done else "",
        "shape": f"{np.median([fit.shape for fit in done]):.2f}" if done else "",
    }


def total_rows(
    tails: Sequence[Mapping[str, Any]], kappa: Mapping[str, float]
) -> Iterator[dict[str, Any]]:
    """The counts of ``tail_rows`` over all scenarios, and over those with κ n < 1."""
    for which in ("all", "less than one crash expected"):
        for column, crashes in TAILS:
            for size in SIZES:
                rows = [
                    row
                    for row in tails
                    if (row["measure"], row["crashes"], row["episodes"]) == (column, crashes, size)
                    and (which == "all" or kappa[row["case"]] * size < 1)
                ]
                yield {
                    "scenarios": which,
                    "measure": column,
                    "crashes": crashes,
                    "episodes": size,
                    **{key: sum(row[key] for row in rows) for key in COUNTS},
                }


def _text(conflict: tuple[str, str, float]) -> str:
    column, sign, limit = conflict
    return f"{column}{sign}{limit:g}"


def simulate(name: str, folder: Path) -> Sample:
    """Read a case's episodes from the folder, or simulate them and write them there."""
    path = folder / f"{name}.npz"
    if not path.exists():
        case = CASES[name]
        truth = case.truth(case)
        crashed, values = episodes(case, EPISODES)
        folder.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, crashed=crashed, values=values, truth=np.array(truth, dtype=str))
        print(name, truth, f"{crashed.sum()} of {len(crashed)} crashed", flush=True)
    with np.load(path) as file:
        kappa, error, how = file["truth"].tolist()
        return Sample(Truth(float(kappa), float(error), how), file["crashed"], file["values"])


def _write(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    table = list(rows)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)
    print(f"{path.name}\n" + "\n".join(" | ".join(map(str, row.values())) for row in table))


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--out", type=Path, default=Path("runs/surrogates"))
    asked = parser.parse_args()
    unknown = set(asked.cases) - set(CASES)
    if unknown:
        parser.error(f"unknown case {min(unknown)}; allowed: {', '.join(CASES)}")
    samples = {name: simulate(name, asked.out) for name in asked.cases or CASES}
    if asked.cases:
        return
    _write(DATA / "surrogates_scenarios.csv", scenario_rows(samples))
    _write(DATA / "surrogates_ordering.csv", ordering_rows(samples))
    tails = list(tail_rows(samples))
    _write(DATA / "surrogates_tails.csv", tails)
    kappa = {name: sample.truth.kappa for name, sample in samples.items()}
    _write(DATA / "surrogates_totals.csv", total_rows(tails, kappa))


if __name__ == "__main__":
    main()
