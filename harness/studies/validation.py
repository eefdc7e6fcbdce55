"""Drivers in place of recorded ones: how close they come in time to pass and in who goes first.

Each driver drives every recorded passage, among the people who walk as recorded.  Both scores have
intervals over vehicles, because the passages of one vehicle are not independent.
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import date
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from harness.core.encounter import Contact, Ending, FloatArray, Strategy, Trace, Walk
from harness.core.errors import HarnessError, InputError
from harness.core.seeding import resampling, stream
from harness.core.versions import versions_of_fits
from harness.encounter.arms import check_arms, named_strategy
from harness.encounter.cell_constants import CellConstants
from harness.encounter.loop import run_episode
from harness.engine.plain import PlainEngine
from harness.measures import measure
from harness.measures.ego import crossing_time
from harness.model.interaction import InteractionModel, load_model
from harness.model.mixture.fitting import fit_mixture
from harness.model.sample import LABELS, independent_vehicles, make_sample, row_weights
from harness.model.trajectories import ExtractionRules, extract, read_clips
from harness.model.trajectories.counting import Tally
from harness.model.trajectories.extraction import VEHICLE_KEY
from harness.model.trajectories.tracks import fingerprint, fingerprints_of
from harness.results import estimators
from harness.results.estimators import CONFIDENCE, Sampling
from harness.results.finding import Finding, Form, Plain
from harness.results.notes import Note
from harness.results.result import Column, Result, Shown, Style, Table
from harness.scenario import Scenario, Setting, load_scenario
from harness.strategies.constant_speed import ConstantSpeed
from harness.strategies.parameters import needs
from harness.strategies.registry import find_strategy
from harness.studies.fitting import Settings, vehicle_folds
from harness.studies.recorded_passages import BEYOND_S, RecordedPassage, find_passages

DRAWS = 20
"""Drives of each passage by a driver who draws random numbers."""

RELIABLE_FROM = 200
"""Vehicles from which intervals cover the truth in 93 to 95 %; with 26 vehicles in 89 to 92 %."""

_STANDING_MPS = 0.1
_COUNTS = ("contacts", "contacts_explained", "timed_out")

COLUMNS: Mapping[Column, Style] = {
    Column("pass_time_score_s", "score, s", interval=True): Style(),
    Column("pass_time_error_mean_s", "mean error, s"): Style(digits=1),
    Column("pass_time_error_median_s", "median |error|, s"): Style(digits=1),
    Column("order_right", "order right", interval=True): Style(Form.SHARE, 0),
    Column("contacts", "contacts"): Style(digits=1),
    Column("contacts_explained", "of them explained"): Style(digits=1),
    Column("timed_out", "timed out"): Style(digits=1),
}
"""The numbers of a driver, and how they are written."""

_LEGEND = (
    "score: continuous ranked probability score of the time to pass; without randomness the mean "
    "absolute error. Errors: simulated − recorded. order right: people with whom it is as recorded "
    "who goes first. contacts: passages; recorded people do not react, and the explained contacts "
    "happened only because of this."
)


VehicleId = tuple[str, str, str]


class Drive(NamedTuple):
    """What a driver, recorded or simulated, did in one passage.

    Attributes:
        pass_time_s: from the start until the rear has left the crosswalk, or the time limit.
        first: (n,) whether the vehicle is the first at the crossing place, for everyone to come.
        contact: whether it touched somebody.
        explained: whether that happened only because recorded people do not react: they walked
            into its flank or into it standing, or full braking from their arrival on would not
            have avoided it.
        timed_out: whether the time limit ended the drive.
    """

    pass_time_s: float
    first: np.ndarray
    contact: bool
    explained: bool
    timed_out: bool


def validate(
    paths: Sequence[Path],
    format_: str,
    drivers: Sequence[str],
    settings: Sequence[Setting] = (),
    folds: int = 5,
    progress: Callable[[int, int], None] = lambda _done, _planned: None,
) -> Result:
    """Drive recorded passages with each driver; the nearest to the recorded drivers comes first.

    Args:
        paths, format_: the data, as for ``harness.extract``.
        drivers: names of strategies.
        settings: keys of a scenario, which gives parameters, model, seed, step, and the vehicles'
            width and accelerations; keys without a dot are options of the extraction.
        folds: number of folds of vehicles; a model fitted on the same data is fitted again without
            each fold.  0: it is used as it is.
        progress: is given the numbers of done and planned drivers.

    Raises:
        InputError: a format, option or driver is refused, the data cannot be read or have no
            passage.
        HarnessError: a strategy fails in a passage.
    """
    keys = [setting for setting in settings if "." in setting.key]
    options = {setting.key: setting.value for setting in settings if "." not in setting.key}
    scenario = load_scenario("cctc", keys)
    model, factories = load_model(scenario.model.name, scenario.model.path), {}
    if not drivers:
        raise InputError("--drivers", "names no driver", "e.g. human_gmm,human_yield")
    for name in drivers:
        if name in factories:
            raise InputError("--drivers", f"names {name} twice", "every driver once")
        factories[name] = find_strategy(name, "--drivers")
        check_arms(load_scenario("cctc", [*keys, Setting("arms.av", name, "--drivers")]), model)
    seed, step_s, tally = scenario.experiment.seed, scenario.experiment.step_s, Tally()
    clips = read_clips(paths, format_, tally, **options)
    rules = {name: of for name, of in options.items() if name in ExtractionRules.model_fields}
    passages, left = find_passages(clips, scenario.vehicle(), step_s, ExtractionRules(**rules))
    left_out = ", ".join(f"{why} {count:,}" for why, count in left.most_common())
    if not passages:
        problem = f"no passage can be used ({left_out or 'no vehicle'})"
        raise InputError(str(paths[0]), problem)
    seen, of_vehicle = fingerprints_of(clips), dict[VehicleId, InteractionModel]()
    with_model = [name for name in drivers if "model" in needs(factories[name])]
    known = fitted_on(model, seen) if with_model else False
    if known and folds > 1:
        rows = extract(paths, format_, **options).rows
        of_vehicle = models_without(model, rows, folds, seed)
    sources = {name: getattr(factories[name], "FITTED_ON", None) for name in drivers}
    optimistic = [name for name, of in sources.items() if of and fitted_on(load_model(of), seen)]
    optimistic += with_model if known and not of_vehicle else []
    truths = [_drive(passage, _recorded(passage, step_s)) for passage in passages]
    models = [of_vehicle.get(passage.vehicle_id, model) for passage in passages]
    drives = {}
    for number, name in enumerate(drivers, start=1):
        drives[name] = drives_of(name, passages, truths, models, scenario)
        progress(number, len(drivers))
    sampling = Sampling(resampling(seed, "validation"))
    records: list[dict[str, Any]] = [
        {
            "driver": name,
            "fitted_on_these_data": name in optimistic,
            "folds": len({*of_vehicle.values()}) if name in with_model else 0,
            **findings_of(drives[name], sampling),
        }
        for name in drivers
    ]
    records.sort(key=lambda record: record["pass_time_score_s"].value)
    alike = [
        f"{a} and {b}"
        for a, b in combinations([record["driver"] for record in records], 2)
        if not differ(drives[a], drives[b], sampling)
    ]
    tracks = sorted(fingerprint(track) for clip in clips for track in clip.vehicles.values())
    facts: dict[str, Plain] = {
        "data": ", ".join(sorted({clip.source for clip in clips})),
        "tracks": hashlib.sha256("".join(tracks).encode()).hexdigest()[:16],
        "passages": len(passages),
        "vehicles": len({passage.vehicle_id for passage in passages}),
        "encounters": sum(len(truth.first) for truth in truths),
        "contacts_recorded": sum(truth.contact for truth in truths),
        "seed": seed,
        "date": date.today().isoformat(),
        **versions_of_fits(),
    }
    table = [
        (of["driver"], *(Shown(of[column.key], style) for column, style in COLUMNS.items()))
        for of in records
    ]
    return Result(
        command="validate",
        title=f"Drivers in place of those recorded in {facts['data']}, the nearest first",
        scope=f"{len(passages):,} passages of {facts['vehicles']} vehicles, "
        f"{facts['encounters']:,} encounters; recorded contacts {facts['contacts_recorded']}",
        about="",
        screen=Table("", (Column("driver", ""), *COLUMNS), tuple(table)),
        full=(),
        notes=tuple(_notes(records, left_out, alike, tally, known is None)),
        closing=("All notes: --full. Page: --out PAGE.html",),
        remarks=(_LEGEND,),
        facts=facts,
        records=records,
    )


def fitted_on(model: InteractionModel, seen: frozenset[str]) -> bool | None:
    """Whether a model's card lists one of the tracks ``seen``; None if it lists none at all."""
    tracks = model.provenance.get("tracks")
    return not seen.isdisjoint(map(str, tracks)) if isinstance(tracks, list) and tracks else None


def models_without(
    model: InteractionModel, rows: pd.DataFrame, folds: int, seed: int
) -> dict[VehicleId, InteractionModel]:
    """For each vehicle, a model of as many components that was fitted without its fold.

    Args:
        model: the model; the others have its box.
        rows: the rows of the data.  ``harness fit`` makes the same weights and folds of them.
        folds: number of folds, at most one for each vehicle.
        seed: seed of the folds and of the fits' starts.
    """
    whole, size, vehicle = model.mixture, len(model.mixture.weights), independent_vehicles(rows)
    assert vehicle is not None  # rows from tracks name their vehicle
    number = min(folds, int(vehicle.max()) + 1)
    fold_of = vehicle_folds(vehicle, row_weights(rows, "encounter"), number, seed)
    models = []
    for fold in range(number):
        sample = make_sample(rows[fold_of != fold], lower=whole.lower, upper=whole.upper)
        fitted = fit_mixture(
            sample.data,
            size,
            whole.lower,
            whole.upper,
            sample_weight=sample.weights,
            n_init=Settings((size,)).starts,
            seed=np.random.SeedSequence(seed, spawn_key=(size, fold + 1)),
            names=LABELS,
        )
        models.append(InteractionModel(fitted.mixture, f"{model.name}, fold {fold}", {}, ""))
    names = rows[list(VEHICLE_KEY)].itertuples(index=False, name=None)
    return {name: models[fold] for name, fold in zip(names, fold_of, strict=True)}


def drives_of(
    name: str,
    passages: Sequence[RecordedPassage],
    truths: Sequence[Drive],
    models: Sequence[InteractionModel],
    scenario: Scenario,
) -> pd.DataFrame:
    """A row for each drive of one driver: ``DRAWS`` of each passage if a first drive draws.

    Args:
        name: name of the strategy.
        passages, truths, models: the passages, what the recorded drivers did, and the interaction
            model that has not seen them.
        scenario: gives parameters, seed and step.

    Raises:
        HarnessError: the strategy fails in a passage.
    """
    rows, drew = [], False
    for draw in range(DRAWS):
        for number, (passage, truth) in enumerate(zip(passages, truths, strict=True)):
            # Streams are keyed by a pair, so each drive of a passage has a stream of its own.
            rng = stream(scenario.experiment.seed, "strategy", number * DRAWS + draw)
            begun = rng.bit_generator.state
            strategy = named_strategy(scenario, name, models[number], iter([rng]).__next__)
            trace = _simulated(passage, strategy, scenario.experiment.step_s)
            if trace.ending is Ending.ENGINE_FAILED:
                raise HarnessError(f"{name} in {'/'.join(passage.vehicle_id)}: {trace.reason}")
            drew = drew or rng.bit_generator.state != begun
            drive = _drive(passage, trace)
            rows.append(
                {
                    "vehicle": passage.vehicle_id,
                    "passage": number,
                    "error_s": drive.pass_time_s - truth.pass_time_s,
                    "right": float(np.count_nonzero(drive.first == truth.first)),
                    "people": float(len(truth.first)),
                    **dict(zip(_COUNTS, map(float, drive[2:]), strict=True)),
                }
            )
        if not drew:
            break
    return pd.DataFrame(rows)


def _simulated(passage: RecordedPassage, strategy: Strategy, step_s: float) -> Trace:
    """A drive from the recorded start until the rear has left, or the time limit."""
    steps = len(passage.x_m) - 1 + round(BEYOND_S / step_s)
    # An engine begins at v0.  Here the start speed differs from v0, except for the driver at
    # constant speed, whose v0 is the start speed.
    begun = replace(passage.vehicle, initial_speed_mps=passage.start_speed_mps)
    rules = CellConstants(
        vehicle=begun if isinstance(strategy, ConstantSpeed) else passage.vehicle,
        crossing=passage.crossing,
        kerb_wait_s=0.0,
        step_s=step_s,
        timeout_s=steps * step_s,
        behaviour="constant",
    )
    arrivals = [person.arrival for person in passage.people]
    engine = PlainEngine(begun, step_s)
    # Recorded people never ask for a walking speed.
    trace = run_episode(engine, strategy, arrivals, lambda *_seen: float("nan"), rules)
    return replace(trace, vehicle=passage.vehicle)


def _recorded(passage: RecordedPassage, step_s: float) -> Trace:
    """The recorded passage as a trace; speeds are central differences."""
    walks = []
    for arrival, *_ in passage.people:
        legs = arrival.path or ()
        walks.append(Walk(arrival, arrival.arrival_s, abs(legs[-1].y_mps), legs=legs))
    return Trace(
        vehicle=passage.vehicle,
        crossing=passage.crossing,
        step_s=step_s,
        x_m=passage.x_m,
        speed_mps=np.gradient(passage.x_m, step_s),
        walks=tuple(walks),
        ending=Ending.CROSSED,
        reason=None,
        sumo_collision=None,
        fallback=False,
    )


def _drive(passage: RecordedPassage, trace: Trace) -> Drive:
    """What the driver did in a trace of a passage."""
    record = measure([trace])[0]
    passed_s = crossing_time(trace, passage.crossing.width_m / 2 + passage.vehicle.length_m)
    at = [(person, crossing_time(trace, person.conflict_x_m)) for person in passage.to_come]
    struck_mps = record.contact_speed_mps
    into_it = record.contact is Contact.SIDE or (struck_mps or 0.0) < _STANDING_MPS
    return Drive(
        # An engine ends within 1 nm of the edge, so the rear may not quite have left.
        (len(trace.x_m) - 1) * trace.step_s if passed_s is None else passed_s,
        np.array([time is not None and time <= person.passing_s for person, time in at]),
        record.contact is not None,
        record.contact is not None and (into_it or not record.avoidable),
        passed_s is None and trace.ending is Ending.TIMED_OUT,
    )


def pass_time_score(error_s: FloatArray) -> float:
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


def findings_of(drives: pd.DataFrame, sampling: Sampling) -> dict[str, Finding]:
    """The numbers of a driver; the intervals are over vehicles, by the bootstrap of runs.

    Args:
        drives: as of ``drives_of``.
        sampling: the same for every driver, so that drivers are compared in pairs.
    """
    sums = _by_vehicle(drives)

    def ratio(above: str, below: str = "passages") -> Finding:
        found = estimators.ratio(sums[above].to_numpy(), sums[below].to_numpy(), sampling)
        if len(sums) >= RELIABLE_FROM:
            return found
        reason = f"{len(sums)} vehicles, reliable from {RELIABLE_FROM} on"
        return replace(found, reliable=found.reliable and False, reason=reason)

    return {
        "pass_time_score_s": ratio("score_s"),
        "pass_time_error_mean_s": ratio("error_s"),
        "pass_time_error_median_s": Finding(float(drives["error_s"].abs().median())),
        "order_right": ratio("right", "people"),
        **{name: Finding(float(sums[name].sum())) for name in _COUNTS},
    }


def differ(a: pd.DataFrame, b: pd.DataFrame, sampling: Sampling) -> bool:
    """Whether the scores of two drivers differ by the sign-flip test over vehicles."""
    one, other = _by_vehicle(a), _by_vehicle(b)
    scores = one["score_s"].to_numpy(), other["score_s"].to_numpy()
    found = estimators.ratio_difference(*scores, one["passages"].to_numpy(), sampling)
    return found.p is not None and found.p < 1 - CONFIDENCE


def _by_vehicle(drives: pd.DataFrame) -> pd.DataFrame:
    """Sums over the passages of each vehicle; the draws of a passage share its weight."""
    of_passage = drives.groupby(["vehicle", "passage"], sort=False)
    means = of_passage.mean()
    scores = of_passage["error_s"].agg(lambda errors: pass_time_score(errors.to_numpy()))
    return means.assign(score_s=scores, passages=1.0).groupby(level=0, sort=False).sum()


def _notes(
    records: Sequence[Mapping[str, Any]],
    left_out: str,
    alike: Sequence[str],
    tally: Tally,
    unknown: bool,
) -> Iterator[Note]:
    """Yield the sentences without which the numbers mislead, the worst first."""
    few = records[0]["pass_time_score_s"].reason
    late = [f"{of['driver']} {n:.3g}" for of in records if (n := of["timed_out"].value)]
    optimistic = [of["driver"] for of in records if of["fitted_on_these_data"]]
    card = [
        "no fingerprints of tracks, so it is unknown whether the model was fitted on these data"
    ]
    lists = {
        "few vehicles": ("Unreliable or no intervals", [few] if few else []),
        "fitted on these data": (
            "Fitted on these passages, so better here than elsewhere",
            optimistic,
        ),
        "fitted on unknown data": ("The model's card", card if unknown else []),
        "time-outs": ("Timed out, so the limit counts as their time; passages", late),
        "not told apart": ("No significant difference", alike),
        "left out": ("Left out", [left_out] if left_out else []),
        "records": ("Records", tally.remarks()),
    }
    for rank, (label, (what, words)) in enumerate(lists.items()):
        if words:
            yield Note(label.replace(" ", "_"), rank, label, f"{what}: {'; '.join(words)}.")
