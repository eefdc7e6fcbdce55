"""Compares drivers with recorded trajectories."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.core.errors import InputError
from harness.model.interaction import load_model
from harness.model.trajectories import read_clips
from harness.model.trajectories.counting import Tally
from harness.model.trajectories.extraction_rules import split_options
from harness.model.trajectories.fingerprints import fingerprints_of
from harness.model.trajectories.formats import FORMATS
from harness.old.statistics.findings import Note, Rank
from harness.old.studies.validation.bootstrap import few_vehicles, resamples
from harness.old.studies.validation.closed_loop import recorded_trace
from harness.old.studies.validation.drivers import (
    STRATEGIES_FITTED_ON,
    ModelOf,
    fitted_on,
    outcomes_of,
    refit_without_folds,
)
from harness.old.studies.validation.figures import drives_of, findings_of
from harness.old.studies.validation.finding import find_passages
from harness.old.studies.validation.findings import DriverFindings, ValidationFindings
from harness.old.studies.validation.outcomes import DriverOutcome, outcome_of
from harness.old.studies.validation.passages import Passages
from harness.old.studies.validation.ranking import ranking
from harness.scenario import Scenario
from harness.strategies.parameters import check_complete, check_parameters, needs
from harness.strategies.registry import find_strategy, table_key

_NO_TRACKS = (
    "The card of model {} has no fingerprints of tracks, so it is unknown whether the model was "
    "fitted to these data."
)

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class Validation:
    """Drivers compared with recorded passages.

    Attributes:
        passages: the driven passages and the counts of excluded ones.
        recorded: outcome of the recorded vehicle in each passage.
        outcomes: outcomes by driver, passage and draw.
        findings: the findings of the validation.
    """

    passages: Passages
    recorded: Sequence[DriverOutcome]
    outcomes: Mapping[str, Sequence[Sequence[DriverOutcome]]]
    findings: ValidationFindings


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
    """Drive recorded passages with each driver and compare it with the recorded drivers.

    Args:
        paths, format_: the data, as for ``harness.extract``.
        drivers: names of strategies.
        scenario: gives the drivers' parameters, the interaction model, the vehicles' width and
            accelerations, step and seed.
        folds: number of folds of vehicles; a model fitted to the same data is refitted without
            each fold.
        options: options of the extraction and of the format's reader.
        progress: called with the numbers of done and planned steps, and the unit.

    Raises:
        InputError: a format, option or driver is unknown, or the data cannot be read or contain no
            passage.
    """
    _check_drivers(drivers, scenario)
    given, seed = dict(options or {}), scenario.experiment.seed
    # ``read_clips`` refuses an unknown format.
    rules = None
    if format_ in FORMATS:
        rules, _ = split_options(given, FORMATS[format_].options, f"format {format_}")
    progress(0, 1, "reading")
    tally = Tally()
    clips = read_clips(list(paths), format_, tally, **given)
    passages = find_passages(clips, scenario.vehicle(), scenario.experiment.step_s, rules)
    if not passages.used:
        reasons = [f"{reason}: {count}" for reason, count in passages.left_out.items() if count]
        why = ", ".join(reasons) or "no vehicle"
        raise InputError(str(paths[0]), f"no passage can be used ({why})")
    with_model = [name for name in drivers if "model" in needs(find_strategy(name, "--drivers"))]
    model = load_model(scenario.model.name, scenario.model.path)
    seen = fingerprints_of(clips)
    known = fitted_on(model.provenance, seen) if with_model else False
    model_of: ModelOf = lambda _: model  # noqa: E731
    refitted = 0
    if known and folds > 1:
        fold_models = refit_without_folds(
            model, paths, format_, given, folds, seed, lambda done: progress(done, folds, "folds")
        )
        model_of, refitted = fold_models, len(fold_models.fold_models)
    in_sample = {
        *(with_model if known and not refitted else ()),
        *(
            name
            for name, source in STRATEGIES_FITTED_ON.items()
            if name in drivers and fitted_on(load_model(source).provenance, seen)
        ),
    }
    recorded = [outcome_of(passage, recorded_trace(passage)) for passage in passages.used]
    outcomes = {}
    for number, name in enumerate(drivers):
        progress(number, len(drivers), "drivers")
        outcomes[name] = outcomes_of(name, passages.used, scenario, model_of)
    drives = {name: drives_of(driven, recorded) for name, driven in outcomes.items()}
    samples, doubt = resamples(passages.used, seed), few_vehicles(passages.vehicles)
    ranked = ranking({name: drives[name].score_s for name in drivers}, samples)
    driver_findings = tuple(
        DriverFindings(
            driver=name,
            rank=rank,
            not_told_apart=alike,
            score_difference_s=difference_s,
            score_difference_interval_s=interval_s,
            draws=drives[name].error_s.shape[1],
            fitted_on_these_data=name in in_sample,
            folds=refitted if name in with_model else 0,
            findings=findings_of(drives[name], samples, doubt),
        )
        for rank, (name, difference_s, interval_s, alike) in enumerate(ranked, start=1)
    )
    progress(len(drivers), len(drivers), "drivers")
    unknown = _NO_TRACKS.format(model.name) if known is None else None
    findings = ValidationFindings(
        sources=tuple(sorted({passage.source for passage in passages.used})),
        passages=len(passages.used),
        vehicles=passages.vehicles,
        encounters=passages.encounters,
        contacts_recorded=sum(drive.contact for drive in recorded),
        left_out=passages.left_out,
        remarks=(*tally.remarks(), *filter(None, (unknown, doubt))),
        notes=tuple(_notes(passages, driver_findings, tally.remarks(), unknown, doubt)),
        drivers=driver_findings,
    )
    return Validation(passages, recorded, outcomes, findings)


def _notes(
    passages: Passages,
    drivers: Sequence[DriverFindings],
    remarks: Sequence[str],
    unknown: str | None,
    doubt: str | None,
) -> Iterator[Note]:
    """Yield the notes about the numbers, sorted by rank."""
    for driver in drivers:
        if driver.findings["timed_out"].value:
            yield Note(
                Rank.TIME_OUTS,
                f"{driver.driver} timed out in {driver.findings['timed_out'].value:g} of "
                f"{len(passages.used):,} passages; the time limit counts as their pass time.",
            )
    left_out = {reason: count for reason, count in passages.left_out.items() if count}
    if left_out:
        reasons = ", ".join(f"{reason} {count:,}" for reason, count in left_out.items())
        total = sum(left_out.values())
        yield Note(Rank.LEFT_OUT, f"Excluded ways of vehicles: {total:,} ({reasons}).")
    if remarks:
        yield Note(Rank.LEFT_OUT, "; ".join(remarks) + ".")
    for driver in drivers:
        if driver.fitted_on_these_data:
            words = "was fitted to these passages, so its result is optimistic."
            yield Note(Rank.REFERENCE, f"{driver.driver} {words}")
    if unknown:
        yield Note(Rank.REFERENCE, unknown)
    pairs = [
        f"{driver.driver} and {other}"
        for place, driver in enumerate(drivers)
        for other in driver.not_told_apart
        if other in {later.driver for later in drivers[place:]}
    ]
    if pairs:
        yield Note(
            Rank.FEW_PAIRS, f"These drivers do not differ significantly: {', '.join(pairs)}."
        )
    if doubt:
        yield Note(Rank.FEW_PAIRS, doubt)


def _check_drivers(drivers: Sequence[str], scenario: Scenario) -> None:
    """Refuse unknown drivers and parameters, and SUMO's driver, before data are read."""
    if not drivers:
        raise InputError("--drivers", "names no driver", "e.g. human_gmm,human_yield")
    for name in drivers:
        factory = find_strategy(name, "--drivers")
        if drivers.count(name) > 1:
            raise InputError("--drivers", f"names {name} twice", "every driver once")
        if name == "sumo_driver":
            raise InputError(
                "--drivers", "sumo_driver drives only with [simulation]", "any other strategy"
            )
        table = scenario.strategies.get(name, {})
        check_parameters(factory, table, table_key(name))
        check_complete(factory, table, table_key(name))
