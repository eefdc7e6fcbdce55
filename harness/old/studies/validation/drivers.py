"""Drives passages with a driver whose model was fitted without the passage."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.encounter import Ending, Strategy
from harness.core.errors import HarnessError
from harness.core.seeding import stream
from harness.encounter.arms import named_strategy
from harness.model.interaction import InteractionModel
from harness.model.mixture.fitting import fit_mixture
from harness.model.sample import LABELS, independent_vehicles, make_sample
from harness.model.trajectories import extract, row_weights
from harness.model.trajectories.extraction import VEHICLE_KEY
from harness.old.studies.validation.closed_loop import drive
from harness.old.studies.validation.outcomes import DriverOutcome, outcome_of
from harness.old.studies.validation.passages import Passage
from harness.scenario import Scenario
from harness.studies.fitting import Settings, vehicle_folds

DRAWS = 20
"""Number of drives of each passage by a model that draws random numbers."""

ModelOf = Callable[[Passage], InteractionModel]


def outcomes_of(
    name: str, passages: Sequence[Passage], scenario: Scenario, model_of: ModelOf
) -> list[list[DriverOutcome]]:
    """Drive every passage with one driver, ``DRAWS`` times if the driver draws random numbers.

    Args:
        name: name of the strategy.  The scenario gives its parameters.
        passages: the passages to drive.
        scenario: gives parameters, seed and step.
        model_of: the interaction model for a passage.

    Raises:
        HarnessError: the strategy fails in a passage.
    """

    def drive_once(number: int, draw: int) -> tuple[DriverOutcome, bool]:
        """Return the outcome, and whether the driver drew a number."""
        # Streams are keyed by a pair, so each drive of a passage has a separate stream.
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
    """Return whether a model's card lists one of the tracks ``seen`` (see ``fingerprints_of``).

    The result is None if the card lists no tracks, because it is older or its rows had no tracks.
    """
    tracks = card.get("tracks")
    if not isinstance(tracks, list) or not tracks:
        return None
    return not seen.isdisjoint(map(str, tracks))


@dataclass(frozen=True, eq=False)
class FoldModels:
    """One model fitted without each fold of vehicles, and the model fitted to all vehicles."""

    whole: InteractionModel
    fold_models: Sequence[InteractionModel]
    vehicle_fold: Mapping[tuple[str, ...], int]

    def __call__(self, passage: Passage) -> InteractionModel:
        """Return the model that was fitted without the passage's vehicle."""
        fold = self.vehicle_fold.get(passage.vehicle_id)
        return self.whole if fold is None else self.fold_models[fold]


def refit_without_folds(
    model: InteractionModel,
    paths: Sequence[Path],
    format_: str,
    options: Mapping[str, Any],
    folds: int,
    seed: int,
    progress: Callable[[int], None] = lambda _: None,
) -> FoldModels:
    """Refit mixtures with the model's number of components, each without one fold of vehicles.

    ``harness extract`` and ``harness fit`` would make the same rows, weights, box and folds.

    Args:
        model: a model fitted to the same data.
        paths, format_, options: the data, as for ``extract``.
        folds: number of folds, at most the number of vehicles.
        seed: seed of folds and starts.
        progress: called with the number of finished fits.
    """
    whole = model.mixture
    rows = extract(list(paths), format_, **options).rows
    code = independent_vehicles(rows)
    assert code is not None  # rows from tracks identify their vehicle
    number = min(folds, int(code.max()) + 1)
    row_folds = vehicle_folds(code, row_weights(rows, "encounter"), number, seed)
    models = []
    for fold in range(number):
        sample = make_sample(rows[row_folds != fold], lower=whole.lower, upper=whole.upper)
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
    return FoldModels(model, models, dict(zip(names, row_folds.tolist(), strict=True)))
