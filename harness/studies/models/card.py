"""Fits a model to rows, and makes its card: rows, fits over K, warnings."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from statistics import NormalDist
from types import MappingProxyType
from typing import Any

import numpy as np

from harness.core.errors import InputError, refused_at
from harness.core.versions import versions_of_fits
from harness.core.vocabulary import Progress
from harness.model.interaction import (
    INVERSE_RANGE,
    VARIABLES,
    VEHICLE_SPEED,
    InteractionModel,
    write_model,
)
from harness.model.sample import RowFile, Sample, box_of, effective_number, make_sample, read_rows
from harness.results.estimators import CONFIDENCE
from harness.results.finding import Finding
from harness.studies.models import fits
from harness.studies.models.fits import TARGETS, FitSettings, Fitted, HeldOut

NEAR = MappingProxyType(
    {"range_m": 30.0, "vehicle_speed_mps": 5.0, "within_m": 5.0, "within_mps": 1.0}
)
"""The state at the paper's trigger, and by how much rows near it differ from it at most."""

_NORMAL = NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
"""The normal quantile at the ends of a score's interval."""

SCORE_RELIABLE_FROM = 100
"""Vehicles from which a score's interval is reliable."""

FEW_NEAR = 10
"""The card warns if fewer vehicles or effective rows than this are near the scenario's state."""


def card(
    sample: Sample, settings: FitSettings, fitted: Fitted, file: RowFile, command: str
) -> dict[str, Any]:
    """The model's card, as plain data for the model file's ``provenance``.

    Args:
        sample: the fitted rows.
        settings: the settings of the fits.
        fitted: the result of the fits.
        file: the file of the rows, with the command of the extraction.
        command: the exact command of the fit.
    """
    near, rows = near_state(sample), len(sample.data)
    bic = {each.components: each.fit.bic for each in fitted.candidates}
    rule = None
    with suppress(InputError):  # there are not enough K
        rule = fits.by_rule(bic)
    outside, extracted = dict(sample.outside or {}), file.extraction.get("command")
    return {
        "source": sample.sources,
        "commands": [*[extracted] * isinstance(extracted, str), command],
        "rows_sha256": file.sha256,
        "rows_read": sample.rows_read,
        "rows_outside_box": {**outside, "any": sample.rows_read - rows},
        "rows": rows,
        "copied_rows": sample.copies,
        **_counted(sample, np.ones(rows, bool)),
        "tracks": sample.tracks,
        "near_state": near,
        "weigh": sample.weigh,
        "weight_sum": float(sample.weights.sum()),
        "bounds": dict(
            zip(VARIABLES, np.stack((sample.lower, sample.upper), 1).tolist(), strict=True)
        ),
        "components": fitted.chosen.components,
        "chosen_by": fitted.criterion,
        "candidates": list(_candidates(fitted, fits.relative_gain(bic))),
        "rule": {
            "words": f"smallest K with BIC_K - BIC_K+1 < {fits.RULE_SHARE:g} (BIC_1 - BIC_2)",
            "components": rule,
        },
        "folds_of_vehicles": fitted.folds,
        **{name: getattr(settings, name) for name in ("starts", "seed")},
        "extraction": file.extraction.get("counts"),
        "warnings": [
            *(["What the rows' file says of its extraction is damaged."] if file.damaged else []),
            *_data_warnings(sample, near),
            *fitted.warnings,
        ],
        "versions": versions_of_fits(),
    }


def near_state(sample: Sample) -> dict[str, Any]:
    """How many rows, encounters and vehicles are near the state of ``NEAR``."""
    range_m, speed_mps, within_m, within_mps = NEAR.values()
    near = np.abs(1.0 / sample.data[:, INVERSE_RANGE] - range_m) <= within_m
    near &= np.abs(sample.data[:, VEHICLE_SPEED] - speed_mps) <= within_mps
    return {**NEAR, "rows": int(near.sum()), **_counted(sample, near)}


def _counted(sample: Sample, rows: np.ndarray) -> dict[str, float | int | None]:
    """Encounters, vehicles, and effective rows and vehicles among some rows; None if unknown.

    Effective numbers are (Σw)²/Σw², where w is the weight of a distinct row or of a vehicle.
    """
    weights = sample.weights[rows]
    items = {"vehicles": sample.vehicle, "encounters": sample.encounter}
    chosen = {name: None if item is None else item[rows] for name, item in items.items()}
    return {
        **{name: None if item is None else len(np.unique(item)) for name, item in chosen.items()},
        "effective_rows": effective_number(sample.row[rows], weights),
        "effective_vehicles": effective_number(chosen["vehicles"], weights),
    }


def _data_warnings(sample: Sample, near: Mapping[str, Any]) -> Iterable[str]:
    """Yield warnings about copies of rows and vehicles, and about few of them near the state."""
    if copies := sample.copies:
        yield (
            f"{copies} of {len(sample.row)} rows are copies of another row. A row in m encounters "
            f"has weight 1/m in each, and BIC's n is {sample.weights.sum():.4g}."
        )
    if sample.vehicles != sample.named_vehicles:
        yield (
            f"The {sample.named_vehicles} vehicle names count as {sample.vehicles} vehicles, "
            "because some share rows or tracks; each vehicle is in one fold."
        )
    place = f"({near['range_m']:g} m, {near['vehicle_speed_mps']:g} m/s)"
    for key, words in (("vehicles", "vehicles"), ("effective_rows", "effective rows")):
        if near[key] is not None and near[key] < FEW_NEAR:
            yield f"Near {place} the model has only {near[key]:.3g} {words}, fewer than {FEW_NEAR}."


def _candidates(fitted: Fitted, gain: Mapping[int, float]) -> Iterable[dict[str, Any]]:
    """Yield an entry for each K."""
    best = fitted.chosen.scores.get("held_out")
    for k, found, scores in fitted.candidates:
        own = scores.get("held_out")
        less = HeldOut(own.totals - best.totals, own.weights) if own and best else None
        all_scores = {name: scores.get(name) for name in TARGETS} | {"held_out_less_chosen": less}
        yield {
            "components": k,
            "log_likelihood": found.log_likelihood,
            "bic": found.bic,
            "bic_gain_share": gain.get(k),
            "converged": found.converged,
            "gradient_norm": found.gradient_norm,
            "steps": found.n_iter,
            **{
                name: score and {"mean": score.mean, "standard_error": score.standard_error}
                for name, score in all_scores.items()
            },
        }


def score_of(mean: float, error: float | None, vehicles: int | None) -> Finding:
    """A mean score with its 95 % interval, from its standard error over so many vehicles."""
    if error is None or vehicles is None:
        return Finding(mean)
    found = Finding(mean, mean - _NORMAL * error, mean + _NORMAL * error, vehicles, reliable=True)
    return found.reliable_above(SCORE_RELIABLE_FROM, "vehicles")


def fit_model(
    rows: Path,
    out: Path,
    *,
    name: str,
    command: str,
    settings: FitSettings,
    workers: int,
    progress: Progress,
) -> InteractionModel:
    """Fit a model to a file of rows and write it.

    Args:
        rows: the file of rows.
        out: the file of the model.
        name: its name.
        command: the exact command, for its card.
        settings: see ``FitSettings``.
        workers: number of processes.
        progress: called with the numbers of finished and planned fits.
    """
    file, box = read_rows(rows), box_of(settings.bounds)
    with refused_at(str(rows)):
        sample = make_sample(file.rows, settings.weigh, *box)
    with fits.processes(workers) as executor:
        fitted = fits.fit(sample, settings, executor, progress)
        made = fitted.chosen.fit.mixture
        return write_model(out, made, name, card(sample, settings, fitted, file, command))
