"""Recorded passages and drivers in; how close each driver comes to the recorded one out.

Each driver drives every recorded passage, among the people who walk as recorded.  Both scores have
intervals over vehicles, because the passages of one vehicle, or of its copies, are not independent.
``VALIDATED`` marks the keys of a scenario that have an effect here.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

from harness.core.errors import HarnessError, InputError, inside
from harness.core.seeding import resampling, stream
from harness.core.versions import versions_of_fits
from harness.core.vocabulary import Ending, Progress, Strategy, StrategyFactory, Trace, ignore
from harness.encounter.arms import check_arms, named_strategy, uses_of
from harness.encounter.cell_constants import CellConstants
from harness.encounter.loop import Episode, drive
from harness.engine.plain import PlainEngine
from harness.measures import measure
from harness.measures.ego import crossing_time_s
from harness.model.interaction import InteractionModel, load_model
from harness.model.sample import independent_vehicles, make_sample, row_weights
from harness.model.trajectories.extraction import VEHICLE_KEY, extract, read_clips
from harness.model.trajectories.rules import ExtractionRules, Tally
from harness.model.trajectories.tracks import Clip, fingerprint, fingerprints_of
from harness.results import estimators
from harness.results.estimators import Sampling
from harness.results.finding import Finding, Form, Plain, Style
from harness.results.notes import Note
from harness.results.result import Column, Result, Shown, Table
from harness.scenario import Scenario, Setting, load_scenario
from harness.scenario.file import parts_of
from harness.scenario.pedestrians import PedestriansSection
from harness.scenario.sections import VALIDATED, Section, marked
from harness.strategies.parameters import knows_the_model
from harness.strategies.registry import find_strategy
from harness.studies.models.fits import FitSettings, fit_weighted, vehicle_folds
from harness.studies.models.recorded_passages import BEYOND_S, RecordedPassage, find_passages

DRIVES = 20
"""Drives of each passage by a driver who draws random numbers."""

RELIABLE_VEHICLES = 200
"""Vehicles from which intervals cover the truth in 93 to 95 %; with 26 vehicles in 89 to 92 %."""

FOLDS = 5
"""Folds of vehicles: a model that was fitted on the same data is fitted again without each."""

SCORES: Mapping[Column, Style] = MappingProxyType({
    Column("pass_time_score_s", "score, s", interval=True): Style(),
    Column("pass_time_error_mean_s", "mean error, s"): Style(digits=1),
    Column("pass_time_error_median_s", "median |error|, s"): Style(digits=1),
    Column("order_right", "order right", interval=True): Style(Form.SHARE, 0),
    Column("contacts", "contacts"): Style(digits=1),
    Column("timed_out", "timed out"): Style(digits=1),
})  # fmt: skip
"""The numbers of a driver, and how they are written."""

_LEGEND = (
    "score: continuous ranked probability score of the time to pass; without randomness the mean "
    "absolute error. Errors: simulated − recorded. order right: people with whom it is as recorded "
    "who goes first. contacts: passages; recorded people do not react, so compare only drivers."
)


VehicleId = tuple[str, str, str]


def validate(
    paths: Sequence[Path],
    format_: str,
    drivers: Sequence[str],
    settings: Sequence[Setting] = (),
    progress: Progress = ignore,
) -> Result:
    """Drive recorded passages with each driver; the nearest to the recorded drivers comes first.

    Args:
        paths, format_: the data, as for ``extraction.extract``.
        drivers: names of strategies.
        settings: keys of a scenario, which gives parameters, model, seed, step, and what all
            vehicles have in common; keys without a dot are options of the extraction.
        progress: is given the numbers of done and planned drivers.

    Raises:
        InputError: a format, option or driver is refused, a key has no effect, the data cannot be
            read or have no passage.
        HarnessError: a strategy fails in a passage.
    """
    keys = [setting for setting in settings if "." in setting.key]
    options = {setting.key: setting.value for setting in settings if "." not in setting.key}
    scenario = load_scenario("cctc", keys)
    model = load_model(scenario.model.name, scenario.model.path)
    factories = _factories(drivers, keys, model)
    seed, step_s, tally = scenario.experiment.seed, scenario.experiment.step_s, Tally()
    clips = read_clips(paths, format_, tally, **options)
    rules = {name: value for name, value in options.items() if name in ExtractionRules.model_fields}
    passages, left = find_passages(clips, scenario.vehicle(), step_s, ExtractionRules(**rules))
    left_out = ", ".join(f"{why} {count:,}" for why, count in left.most_common())
    if not passages:
        raise InputError(str(paths[0]), f"no passage can be used ({left_out or 'no vehicle'})")
    seen, of_vehicle = fingerprints_of(clips), dict[VehicleId, InteractionModel]()
    with_model = [name for name, factory in factories.items() if knows_the_model(factory)]
    known = fitted_on(model, seen) if with_model else False
    if known:
        of_vehicle = models_without(model, extract(paths, format_, **options).rows, FOLDS, seed)
    models = [of_vehicle.get(passage.vehicle_id, model) for passage in passages]
    sampling = Sampling(resampling(seed, "validation"))
    records, folds = list[dict[str, Any]](), len({*of_vehicle.values()})
    for number, (name, factory) in enumerate(factories.items(), start=1):
        fit = getattr(factory, "FITTED_ON", None)
        told = {fitted_on(load_model(fit), seen) if fit else False}
        told.add(name in with_model and known and not of_vehicle)
        record: dict[str, Any] = {"driver": name, "folds": folds if name in with_model else 0}
        record["fitted_on_these_data"] = True in told or (None if None in told else False)
        records.append(record | scores_of(drives_of(name, passages, models, scenario), sampling))
        progress(number, len(factories))
    records.sort(key=lambda record: record["pass_time_score_s"].value)
    notes = _notes(records, left_out, tally)
    return _result(records, notes, passages, {**_recordings(clips), "seed": seed})


def _factories(
    drivers: Sequence[str], keys: Sequence[Setting], model: InteractionModel
) -> dict[str, StrategyFactory]:
    """The strategies, each of which can drive with these keys.

    The state at the trigger is each passage's own, so ``cctc``'s may be outside the model's data.

    Raises:
        InputError: a strategy or a parameter is refused, or a key has no effect.
    """
    found = {name: find_strategy(name, f"driver {name}") for name in drivers}
    sections = {name: type(of) for name, of in Scenario() if isinstance(of, Section)}
    own = [f"{name}.{key}" for name, of in sections.items() for key in marked(of, VALIDATED)]
    allowed = [*(f"strategies.{name}" for name in found), *own]
    for key in keys:
        if ".".join(parts_of(key)[:2]) not in allowed:
            problem = "has no effect on recorded passages"
            raise InputError(inside(key.source, key.key), problem, ", ".join(allowed))
    for name in found:
        drives = Setting("arms.av", name, f"driver {name}"), Setting("model.extrapolate", True)
        check_arms(load_scenario("cctc", [*keys, *drives]), model)
    return found


def _recordings(clips: Sequence[Clip]) -> dict[str, Plain]:
    """The names of the data sets, and a digest of their tracks."""
    tracks = sorted(fingerprint(track) for clip in clips for track in clip.vehicles.values())
    digest = hashlib.sha256("".join(tracks).encode()).hexdigest()[:16]
    return {"data": ", ".join(sorted({clip.source for clip in clips})), "tracks": digest}


def _result(
    records: Sequence[Mapping[str, Any]],
    notes: Iterable[Note],
    passages: Sequence[RecordedPassage],
    known: Mapping[str, Plain],
) -> Result:
    """What ``harness validate`` shows."""
    vehicles = len({passage.track for passage in passages})
    encounters = sum(len(passage.to_come) for passage in passages)
    facts = {**known, "passages": len(passages), "vehicles": vehicles, "encounters": encounters}
    facts |= versions_of_fits()
    rows = (
        (record["driver"], *(Shown(record[column.key], style) for column, style in SCORES.items()))
        for record in records
    )
    return Result(
        command="validate",
        title=f"Drivers in place of those recorded in {known['data']}, the nearest first",
        scope=f"{len(passages):,} passages of {vehicles} vehicles, {encounters:,} encounters",
        about="",
        screen=Table("", (Column("driver", ""), *SCORES), tuple(rows)),
        full=(),
        notes=tuple(notes),
        closing=("All notes: --full. Page: --out PAGE.html",),
        remarks=(_LEGEND,),
        facts=facts,
        records=records,
    )


def fitted_on(model: InteractionModel, seen: frozenset[str]) -> bool | None:
    """Whether a model's card lists one of the tracks ``seen``; None if it lists none at all."""
    tracks = model.provenance.get("tracks")
    return not seen.isdisjoint(map(str, tracks)) if isinstance(tracks, tuple) and tracks else None


def models_without(
    model: InteractionModel, rows: pd.DataFrame, folds: int, seed: int
) -> dict[VehicleId, InteractionModel]:
    """For each vehicle, a model of as many components that was fitted without its fold.

    Args:
        model: the model; the others have its box.
        rows: the rows of the data.  ``harness fit`` makes the same weights and folds of them.
        folds: number of folds, at most one for each vehicle.
        seed: seed of the folds and of the fits' starts.

    Returns:
        None of one vehicle: no rows are left without it.
    """
    box, size, vehicle = model.mixture, len(model.mixture.weights), independent_vehicles(rows)
    assert vehicle is not None  # rows from tracks name their vehicle
    number, models = min(folds, int(vehicle.max()) + 1), []
    if number < 2:
        return {}
    fold_of = vehicle_folds(vehicle, row_weights(rows, "encounter"), number, seed)
    for fold in range(number):
        sample = make_sample(rows[fold_of != fold], lower=box.lower, upper=box.upper)
        how = FitSettings((size,), seed=seed)
        fitted, _ = fit_weighted(sample, how, sample.weights, (size, fold + 1))
        models.append(InteractionModel(fitted.mixture, f"{model.name}, fold {fold}", {}, ""))
    names = rows[list(VEHICLE_KEY)].itertuples(index=False, name=None)
    return {name: models[fold] for name, fold in zip(names, fold_of, strict=True)}


def drives_of(
    name: str,
    passages: Sequence[RecordedPassage],
    models: Sequence[InteractionModel],
    scenario: Scenario,
) -> pd.DataFrame:
    """A row for each drive of one driver: ``DRIVES`` of each passage if a first drive draws.

    Args:
        name: name of the strategy.
        passages, models: the passages, each with the interaction model that has not seen it.
        scenario: gives parameters, seed and step.

    Raises:
        HarnessError: the strategy fails in a passage.
    """
    rows, drew, step_s = [], False, scenario.experiment.step_s
    for draw in range(DRIVES):
        for number, passage in enumerate(passages):
            rng = stream(scenario.experiment.seed, "recorded_drive", number, draw)
            begun = str((rng.bit_generator.state, rng.bit_generator.seed_seq))
            strategy = named_strategy(scenario, name, models[number], lambda: rng)  # noqa: B023
            trace = _simulated(passage, strategy, step_s)
            if trace.ending is Ending.FAILED:
                raise HarnessError(f"{name} in {'/'.join(passage.vehicle_id)}: {trace.reason}")
            now = str((rng.bit_generator.state, rng.bit_generator.seed_seq))
            drew = drew or now != begun
            pass_time_s, first = _passing(passage, trace)
            recorded = replace(trace, x_m=passage.x_m, speed_mps=np.gradient(passage.x_m, step_s))
            truth_s, truth = _passing(passage, recorded)
            row = {
                "vehicle": passage.track,
                "passage": number,
                "error_s": pass_time_s - truth_s,
                "right": float(np.count_nonzero(first == truth)),
                "people": float(len(truth)),
                "contacts": float(measure([trace])[0].contact is not None),
                "timed_out": float(trace.ending is Ending.TIMED_OUT),
            }
            rows.append(row | uses_of(strategy)._asdict())
        if not drew:
            break
    return pd.DataFrame(rows)


def _simulated(passage: RecordedPassage, strategy: Strategy, step_s: float) -> Trace:
    """A drive from the recorded start until the rear has left, or the time limit."""
    steps = len(passage.x_m) - 1 + round(BEYOND_S / step_s)
    # An engine begins at v0.  Here the start speed differs from v0, except for a driver who keeps
    # the start speed.
    begun = replace(passage.vehicle, initial_speed_mps=passage.start_speed_mps)
    rules = CellConstants(
        vehicle=begun if getattr(strategy, "KEEPS_START_SPEED", False) else passage.vehicle,
        crossing=passage.crossing,
        pedestrians=PedestriansSection(kerb_wait_s=0.0),
        step_s=step_s,
        timeout_s=steps * step_s,
    )
    arrivals = [person.arrival._replace(index=index) for index, person in enumerate(passage.people)]
    # Recorded people never ask for a walking speed.
    episode = Episode(PlainEngine(begun, step_s), arrivals, lambda *_: np.nan, rules)
    return replace(drive(episode, strategy), vehicle=passage.vehicle)


def _passing(passage: RecordedPassage, trace: Trace) -> tuple[float, np.ndarray]:
    """The time to pass, in s, and whether the vehicle goes first, for everyone to come: (n,).

    The rear has left the crosswalk then, or the time limit is reached.  Of whoever never
    crosses it counts when the front is at x = 0, the median of the crossing places.
    """
    passed_s = crossing_time_s(trace, passage.crossing.width_m / 2 + passage.vehicle.length_m)
    places = [(person.conflict_x_m, person.passing_s) for person in passage.to_come]
    at = [(crossing_time_s(trace, 0.0 if x is None else x), by_s) for x, by_s in places]
    first = np.array([time is not None and time <= by_s for time, by_s in at])
    # An engine ends within 1 nm of the edge, so the rear may not quite have left.
    return (len(trace.x_m) - 1) * trace.step_s if passed_s is None else passed_s, first


def pass_time_score(error_s: np.ndarray) -> float:
    """The continuous ranked probability score of one passage's times to pass, in s.

    It is E|X − y| − ½ E|X − X'| over draws X, X' of the driver and the recorded y; without
    randomness the absolute error.  It penalises a spread that is too wide or too narrow.  It is
    unbiased for any number of draws, because X and X' are different draws.

    Source: Gneiting, Raftery 2007, Journal of the American Statistical Association 102.

    Args:
        error_s: (draws,) X − y.

    >>> pass_time_score(np.array([2.0])), pass_time_score(np.array([-1.0, 1.0]))
    (2.0, 0.0)
    """
    n = len(error_s)
    spread = float(np.abs(error_s[:, None] - error_s[None]).sum()) / max(n * (n - 1), 1)
    return float(np.abs(error_s).mean()) - spread / 2


def scores_of(drives: pd.DataFrame, sampling: Sampling) -> dict[str, Finding]:
    """The numbers of a driver; the intervals are over vehicles, by the bootstrap of runs.

    Args:
        drives: as of ``drives_of``.
        sampling: how intervals are made.
    """
    # The draws of a passage share its weight.
    of_passage = drives.groupby(["vehicle", "passage"], sort=False)
    scores = of_passage["error_s"].agg(lambda errors: pass_time_score(errors.to_numpy()))
    each = of_passage.mean().assign(score_s=scores, passages=1.0)
    sums = each.groupby(level=0, sort=False).sum()

    def ratio(above: str, below: str = "passages") -> Finding:
        found = estimators.ratio(sums[above].to_numpy(), sums[below].to_numpy(), sampling)
        if len(sums) >= RELIABLE_VEHICLES:
            return found
        reason = f"{len(sums)} vehicles, reliable from {RELIABLE_VEHICLES} on"
        return replace(found, reliable=None if found.low is None else False, reason=reason)

    uses, clamped = drives[["uses", "clamped"]].sum().tolist()
    return {
        "pass_time_score_s": ratio("score_s"),
        "pass_time_error_mean_s": ratio("error_s"),
        "pass_time_error_median_s": Finding(float(drives["error_s"].abs().median())),
        "order_right": ratio("right", "people"),
        **{name: Finding(float(sums[name].sum())) for name in ("contacts", "timed_out")},
        "clamped_share": Finding(clamped / uses) if uses else Finding(None, reason="no use"),
    }


def _notes(records: Sequence[Mapping[str, Any]], left_out: str, tally: Tally) -> Iterator[Note]:
    """Yield the sentences without which the numbers mislead, the worst first."""
    late = "; ".join(f"{one['driver']} {n:.3g}" for one in records if (n := one["timed_out"].value))
    outside = "; ".join(
        f"{one['driver']} {100 * n:.3g} %" for one in records if (n := one["clamped_share"].value)
    )
    optimistic = "; ".join(one["driver"] for one in records if one["fitted_on_these_data"])
    unknown = any(one["fitted_on_these_data"] is None for one in records)
    few, remarks = records[0]["pass_time_score_s"].reason, "; ".join(tally.remarks())
    better = "fitted on these passages, so better here than elsewhere"
    card = "The model's card has no tracks, so it is unknown whether the model was fitted on them"
    sentences = {
        "few vehicles": few and f"Unreliable or no intervals: {few}",
        "fitted on these data": optimistic and f"{optimistic}: {better}",
        "fitted on unknown data": card if unknown else "",
        "time-outs": late and f"Timed out, so the limit counts as their time; passages: {late}",
        "outside model": outside and f"Outside the model's data, by share of uses: {outside}",
        "left out": left_out and f"Left out: {left_out}",
        "records": remarks and f"Records: {remarks}",
    }
    for rank, (label, text) in enumerate(sentences.items()):
        if text:
            yield Note(label.replace(" ", "_"), rank, label, f"{text}.")
