"""Fits ``human_recorded`` to recorded passages, with folds over vehicles.

    python -m benchmarks.human_recorded ../shared/data/dut --format vci

Draws sets of parameters from stated ranges, drives every passage with each, and takes the set with
the smallest mean absolute error of the pass time.  For the held-out figures this is done again
without each fold of vehicles; ``human_yield`` gets the same treatment.
"""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.encounter import Strategy, Trace
from harness.model.trajectories import read_clips
from harness.scenario import load_scenario
from harness.strategies.human_recorded import HumanRecorded
from harness.strategies.human_yield import HumanYield
from harness.studies.calibration import vehicle_folds
from harness.studies.validation.closed_loop import drive, recorded_trace
from harness.studies.validation.figures import pass_time_score
from harness.studies.validation.finding import find_passages
from harness.studies.validation.outcomes import order_of, pass_time_of
from harness.studies.validation.passages import Passage

SETS, FOLDS, SEED = 60, 5, 1
DRAWS = 4

GRID: Mapping[str, Sequence[float]] = {
    "horizon_s": (0.5, 1.0, 1.5, 2.0, 3.0),
    "go_first_s": (-1.0, -0.5, 0.0, 0.5),
    "let_go_s": (-0.5, 0.0, 0.5),
    "reaction_time_s": (0.0, 0.5, 1.0),
    "comfortable_deceleration_mps2": (0.5, 1.0, 2.0, 3.0),
    "speed_among_people_mps": (1.0, 1.5, 2.0, 3.0),
    "pulling_away_mps2": (1.0, 2.0, 3.0),
}
"""What the sets are drawn from: round values, because 26 vehicles bear no finer ones."""

YIELD_RATES = (0.0, 0.25, 0.5, 0.74, 1.0)


Driven = list[tuple[float, np.ndarray]]
"""Of every passage the pass time, and of everybody in it whether the vehicle was first."""


def driven(passages: Sequence[Passage], make: Callable[[int], Strategy]) -> Driven:
    """Every passage once; ``make`` is given its number."""
    return [seen(passage, drive(passage, make(number))) for number, passage in enumerate(passages)]


def seen(passage: Passage, trace: Trace) -> tuple[float, np.ndarray]:
    """What is compared of a trace."""
    return pass_time_of(passage, trace)[0], order_of(passage, trace)


def scores(outcomes: Driven, recorded: Driven) -> np.ndarray:
    """(passages, 2): absolute error of the pass time, share of the order that is right."""
    return np.array(
        [
            (abs(time - real_time), float((first == real_first).mean()))
            for (time, first), (real_time, real_first) in zip(outcomes, recorded, strict=True)
        ]
    )


def chosen(errors: np.ndarray, fold_of: np.ndarray) -> tuple[int, list[int], np.ndarray]:
    """The best set of all, the best without each fold, and the held-out errors (passages,)."""
    held_out, of_folds = np.empty(errors.shape[1]), []
    for fold in range(int(fold_of.max()) + 1):
        others = fold_of != fold
        of_folds.append(int(errors[:, others].mean(axis=1).argmin()))
        held_out[~others] = errors[of_folds[-1], ~others]
    return int(errors.mean(axis=1).argmin()), of_folds, held_out


def main() -> None:
    """Fit, print the card as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("paths", nargs="+", type=Path)
    parser.add_argument("--format", default="vci")
    given = parser.parse_args()
    limits = load_scenario("cctc").vehicle()
    passages = find_passages(read_clips(given.paths, given.format), limits, 0.1).used
    recorded = [seen(passage, recorded_trace(passage)) for passage in passages]
    vehicles = list(dict.fromkeys(passage.vehicle_id for passage in passages))
    number = np.array([vehicles.index(passage.vehicle_id) for passage in passages])
    fold_of = vehicle_folds(number, np.ones(len(number)), FOLDS, SEED)
    rng = np.random.default_rng(SEED)
    sets: list[dict[str, float]] = [
        {name: float(rng.choice(values)) for name, values in GRID.items()} for _ in range(SETS)
    ]
    found = []
    for parameters in sets:
        outcomes = driven(passages, lambda _, p=parameters: HumanRecorded(**p))
        found.append(scores(outcomes, recorded))
    table = np.array(found)
    best, of_folds, held_out = chosen(table[:, :, 0], fold_of)
    order = np.empty(len(passages))
    for fold, choice in enumerate(of_folds):
        order[fold_of == fold] = table[choice, fold_of == fold, 1]
    weights = np.array([len(first) for _, first in recorded])
    card: dict[str, Any] = {
        "passages": len(passages),
        "vehicles": len(vehicles),
        "parameters": sets[best],
        "parameters_of_folds": [sets[choice] for choice in of_folds],
        "fitted": float(table[best, :, 0].mean()),
        "held_out": float(held_out.mean()),
        "held_out_median": float(np.median(held_out)),
        "held_out_order_right": float(order @ weights / weights.sum()),
        "next_best": [
            (float(table[one, :, 0].mean()), sets[one])
            for one in table[:, :, 0].mean(axis=1).argsort()[1:6].tolist()
        ],
    }
    errors = np.array([yielding(passages, recorded, rate) for rate in YIELD_RATES])
    best, of_folds, held_out = chosen(errors, fold_of)
    card["human_yield"] = {
        "yield_rate": YIELD_RATES[best],
        "fitted": float(errors[best].mean()),
        "held_out": float(held_out.mean()),
        "default": float(errors[YIELD_RATES.index(0.74)].mean()),
    }
    print(json.dumps(card, indent=1))


def yielding(passages: Sequence[Passage], recorded: Driven, rate: float) -> np.ndarray:
    """(passages,) scores of ``human_yield`` at a yield rate, over a few draws."""
    times = [
        [
            time
            for time, _ in driven(
                passages,
                lambda number, d=draw: HumanYield(
                    rng=np.random.default_rng((number, d)), yield_rate=rate
                ),
            )
        ]
        for draw in range(DRAWS if 0 < rate < 1 else 1)
    ]
    return np.array(
        [
            pass_time_score(of, real)
            for of, (real, _) in zip(np.array(times).T, recorded, strict=True)
        ]
    )


if __name__ == "__main__":
    main()
