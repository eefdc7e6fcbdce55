"""The drivers of a validation: made anew for each passage, with a model that has not seen it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.encounter import Ending, Strategy
from harness.core.errors import HarnessError
from harness.core.seeding import stream
from harness.episode.arms import named_strategy
from harness.model.interaction import InteractionModel
from harness.model.mixture import fit_mixture
from harness.model.trajectories import extract, row_weights
from harness.model.trajectories.extraction import VEHICLE_KEY
from harness.scenario import Scenario
from harness.studies.calibration import make_sample, vehicle_folds
from harness.studies.calibration.jobs import Settings
from harness.studies.calibration.sample import LABELS, independent_vehicles
from harness.studies.validation.closed_loop import drive
from harness.studies.validation.outcomes import DriverOutcome, outcome_of
from harness.studies.validation.passages import Passage

DRAWS = 20
"""Drives of every passage by a model that draws random numbers."""

ModelOf = Callable[[Passage], InteractionModel]


def outcomes_of(
    name: str, passages: Sequence[Passage], scenario: Scenario, model_of: ModelOf
) -> list[list[DriverOutcome]]:
    """Every passage driven by one driver, ``DRAWS`` times if it drew a number in the first drive.

    Args:
        name: of the strategy; its parameters are the scenario's.
        passages: to be driven.
        scenario: gives parameters, seed and step.
        model_of: the interaction model for a passage.

    Raises:
        HarnessError: the strategy fails in a passage.
    """

    def drive_once(number: int, draw: int) -> tuple[DriverOutcome, bool]:
        """The outcome, and whether the driver drew a number."""
        # Streams are keyed by a pair: each drive of a passage has one of its own.
        rng = stream(scenario.experiment.seed, "strategy", number * DRAWS + draw)
        untouched, passage = rng.bit_generator.state, passages[number]
        strategy = named_strategy(scenario, name, model_of(passage), lambda: rng)
        return _outcome(name, passage, strategy), rng.bit_generator.state != untouched

    first = [drive_once(number, 0) for number in range(len(passages))]
    more = range(1, DRAWS) if any(drew for _, drew in first) else ()
    return [
        [outcome, *(drive_once(number, draw)[0] for draw in more)]
        for number, (outcome, _) in enumerate(first)
    ]


def _outcome(name: str, passage: Passage, strategy: Strategy) -> DriverOutcome:
    trace = drive(passage, strategy)
    if trace.ending is Ending.ENGINE_FAILED:
        raise HarnessError(f"{name} in {passage.name}: {trace.reason}")
    return outcome_of(passage, trace)


STRATEGIES_FITTED_ON = {"human_recorded": "dut"}
"""Strategies whose rules and default parameters come from the data of a shipped model."""


def fitted_on(card: Mapping[str, Any], seen: frozenset[str]) -> bool | None:
    """Whether a model's card has a track among those seen, see ``fingerprints_of``.

    None where the card has no tracks: it is of an earlier version, or of rows that had none.
    """
    tracks = card.get("tracks")
    if not isinstance(tracks, list) or not tracks:
        return None
    return not seen.isdisjoint(map(str, tracks))


@dataclass(frozen=True, eq=False)
class FoldModels:
    """Models fitted without a fold of vehicles each, and the one fitted on all."""

    whole: InteractionModel
    of_fold: Sequence[InteractionModel]
    fold_of: Mapping[tuple[str, ...], int]

    def __call__(self, passage: Passage) -> InteractionModel:
        """The model that has not seen the passage's vehicle."""
        fold = self.fold_of.get(passage.vehicle_id)
        return self.whole if fold is None else self.of_fold[fold]


def refit_without_folds(
    model: InteractionModel,
    paths: Sequence[Path],
    format_: str,
    options: Mapping[str, Any],
    folds: int,
    seed: int,
    progress: Callable[[int], None] = lambda _: None,
) -> FoldModels:
    """Fit a model's number of components to the data again, without each fold of vehicles.

    Rows, weights, box and folds are as ``harness extract`` and ``harness fit`` make them.

    Args:
        model: fitted on the same data.
        paths, format_, options: the data, as for ``extract``.
        folds: at most as many as there are vehicles.
        seed: of folds and starts.
        progress: told how many fits are done.
    """
    whole = model.mixture
    rows = extract(list(paths), format_, **options).rows
    code = independent_vehicles(rows)
    assert code is not None  # rows of tracks say which vehicle they are of
    number = min(folds, int(code.max()) + 1)
    fold_of = vehicle_folds(code, row_weights(rows, "encounter"), number, seed)
    models = []
    for fold in range(number):
        sample = make_sample(rows[fold_of != fold], lower=whole.lower, upper=whole.upper)
        fit = fit_mixture(
            sample.data,
            len(whole.weights),
            whole.lower,
            whole.upper,
            sample_weight=sample.weights,
            n_init=Settings((len(whole.weights),)).starts,
            seed=np.random.SeedSequence(seed, spawn_key=(len(whole.weights), fold + 1)),
            names=LABELS,
        )
        models.append(InteractionModel(fit.mixture, f"{model.name}, fold {fold}", {}, ""))
        progress(fold + 1)
    names = rows[list(VEHICLE_KEY)].itertuples(index=False, name=None)
    return FoldModels(model, models, dict(zip(names, fold_of.tolist(), strict=True)))
