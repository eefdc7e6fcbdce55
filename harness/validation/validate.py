"""A whole validation: recorded passages found, driven by every driver, compared."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.errors import InputError
from harness.interaction import load_model
from harness.scenario import Scenario
from harness.strategies.parameters import check_complete, check_parameters, needs
from harness.strategies.registry import find_strategy, table_key
from harness.trajectories import read_clips
from harness.trajectories.counting import Tally
from harness.trajectories.extraction_rules import split_options
from harness.trajectories.fingerprints import fingerprints_of
from harness.trajectories.formats import FORMATS
from harness.validation.bootstrap import few_vehicles
from harness.validation.closed_loop import recorded_trace
from harness.validation.drivers import (
    STRATEGIES_FITTED_ON,
    ModelOf,
    fitted_on,
    outcomes_of,
    refit_without_folds,
)
from harness.validation.figures import DriverFigures, figures_of
from harness.validation.finding import find_passages
from harness.validation.outcomes import DriverOutcome, outcome_of
from harness.validation.passages import Passages
from harness.validation.ranking import Ranked, ranking

_NO_TRACKS = (
    "The card of model {} has no fingerprints of tracks: whether it was fitted on these data is "
    "not known."
)

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class Validation:
    """Drivers held against recorded passages.

    Attributes:
        sources: names of the data sets.
        passages: those that were driven, and what was left out.
        recorded: of the recorded vehicles, for each passage.
        outcomes: driver → passages → draws.
        figures: driver → figures.
        ranked: the nearest first.
        folds: driver → folds of vehicles, without each of which its model was fitted again.
        in_sample: drivers that were fitted on these data and not fitted again.
        remarks: what was left out of the records and assumed of them, and how far intervals over
            so few vehicles can be trusted.
    """

    sources: tuple[str, ...]
    passages: Passages
    recorded: Sequence[DriverOutcome]
    outcomes: Mapping[str, Sequence[Sequence[DriverOutcome]]]
    figures: Mapping[str, DriverFigures]
    ranked: Sequence[Ranked]
    folds: Mapping[str, int]
    in_sample: tuple[str, ...]
    remarks: tuple[str, ...]


def validate(
    paths: Sequence[Path],
    format_: str,
    drivers: Sequence[str],
    scenario: Scenario,
    *,
    folds: int = 5,
    options: Mapping[str, Any] | None = None,
    progress: Progress = lambda _done, _planned, _what: None,
) -> Validation:
    """Put drivers into recorded passages and say how near each comes to the recorded ones.

    Args:
        paths, format_: the data, as for ``harness.extract``.
        drivers: names of strategies.
        scenario: gives their parameters, the interaction model, the vehicles' width and
            accelerations, step and seed.
        folds: of vehicles; a model fitted on the same data is fitted again without each.
        options: of the extraction, and of the format's reader.
        progress: told (steps done, steps planned, what they are).

    Raises:
        InputError: unknown format, option or driver, data that cannot be read, no passage.
    """
    _check_drivers(drivers, scenario)
    given = dict(options or {})
    if format_ in FORMATS:
        rules, _ = split_options(given, FORMATS[format_].options, f"format {format_}")
    else:
        rules = None  # read_clips refuses the format
    progress(0, 1, "reading")
    tally = Tally()
    clips = read_clips(list(paths), format_, tally, **given)
    found = find_passages(clips, scenario.vehicle(), scenario.experiment.step_s, rules)
    if not found.used:
        told = ", ".join(f"{reason}: {count}" for reason, count in found.left_out.items() if count)
        raise InputError(str(paths[0]), f"no passage can be used ({told or 'no vehicle'})")
    with_model = [name for name in drivers if "model" in needs(find_strategy(name, "--drivers"))]
    model = load_model(scenario.model.name, scenario.model.path)
    seen = fingerprints_of(clips)
    known = fitted_on(model.provenance, seen) if with_model else False
    model_of: ModelOf = lambda _: model  # noqa: E731
    refitted = 0
    if known and folds > 1:
        of_folds = refit_without_folds(
            model,
            paths,
            format_,
            given,
            folds,
            scenario.experiment.seed,
            lambda done: progress(done, folds, "folds"),
        )
        model_of, refitted = of_folds, len(of_folds.of_fold)
    recorded = [outcome_of(passage, recorded_trace(passage)) for passage in found.used]
    outcomes, figures = {}, {}
    for number, name in enumerate(drivers):
        progress(number, len(drivers), "drivers")
        outcomes[name] = outcomes_of(name, found.used, scenario, model_of)
        figures[name] = figures_of(
            name, found.used, outcomes[name], recorded, scenario.experiment.seed
        )
    progress(len(drivers), len(drivers), "drivers")
    sources = tuple(sorted({passage.source for passage in found.used}))
    return Validation(
        sources=sources,
        passages=found,
        recorded=recorded,
        outcomes=outcomes,
        figures=figures,
        ranked=ranking(list(figures.values()), found.used, scenario.experiment.seed),
        folds=dict.fromkeys(with_model, refitted),
        in_sample=(
            *(with_model if known and not refitted else ()),
            *(
                name
                for name in drivers
                if name in STRATEGIES_FITTED_ON
                and fitted_on(load_model(STRATEGIES_FITTED_ON[name]).provenance, seen)
            ),
        ),
        remarks=(
            *tally.remarks(),
            *([] if known is not None else [_NO_TRACKS.format(model.name)]),
            *few_vehicles(found.vehicles),
        ),
    )


def _check_drivers(drivers: Sequence[str], scenario: Scenario) -> None:
    """Refuse unknown drivers and parameters, and SUMO's own driver, before anything is read."""
    if not drivers:
        raise InputError("--drivers", "names nobody", "e.g. human_gmm,human_yield")
    for name in drivers:
        factory = find_strategy(name, "--drivers")
        if drivers.count(name) > 1:
            raise InputError("--drivers", f"names {name} twice", "every driver once")
        if name == "sumo_driver":
            raise InputError("--drivers", "sumo_driver drives in SUMO alone", "any other strategy")
        table = scenario.strategies.get(name, {})
        check_parameters(factory, table, table_key(name))
        check_complete(factory, table, table_key(name))
